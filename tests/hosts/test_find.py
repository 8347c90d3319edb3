"""Edges and centres are found by touching: a second axis moves the work under a virtual head."""

import argparse
import pathlib
import subprocess
import sys

import pytest

from heads import HANGS, Server

sys.path.append(str(pathlib.Path(__file__).parents[2] / "examples"))

import find  # noqa: E402
from head import Head, connect  # noqa: E402

# The work is as wide as this along the second axis, mm, and 2 mm below the head's upper stop.
LEFT, RIGHT = -1.2345, 2.7182


class Table:
    """A second axis with the work on it: beside the work there is nothing."""

    def __init__(self, server):
        self.server = server
        self.moves = []

    def move(self, to_mm):
        self.moves.append(to_mm)
        raised = 0.0 if LEFT <= to_mm <= RIGHT else -100.0
        self.server.tell(f"workpiece.raised_mm={raised}")


@pytest.fixture
def head_and_table(tmp_path):
    server = Server(tmp_path)
    args = argparse.Namespace(interface="slcan", channel=server.tcp, host=None, port=None)
    with Head(connect(args), 1) as head:
        head.enable()
        head.home_here()
        yield head, Table(server)
    server.stop()


def test_an_edge_is_found_between_a_place_with_work_and_one_without(head_and_table):
    head, table = head_and_table
    assert abs(find.edge(head, table, 0.0, 4.0, to_mm=0.02) - RIGHT) <= 0.01
    assert len(table.moves) < 15


def test_the_centre_is_the_middle_of_both_edges(head_and_table):
    head, table = head_and_table
    assert abs(find.centre(head, table, 0.5, -3.0, 4.0, to_mm=0.02) - (LEFT + RIGHT) / 2) <= 0.01


def test_a_place_without_an_edge_or_without_work_is_said(head_and_table):
    head, table = head_and_table
    with pytest.raises(SystemExit, match="at 2 mm there is work as well"):
        find.edge(head, table, 0.0, 2.0)
    with pytest.raises(SystemExit, match="no surface at 5 mm"):
        find.edge(head, table, 5.0, 0.0)


def test_the_program_moves_another_drive_between_the_touches(tmp_path):
    server = Server(tmp_path, "--nodes", "2")
    words = [sys.executable, find.__file__, "edge", "--channel", server.tcp, "--right-mm", "1"]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=HANGS)
    # The work of a virtual head is endless.
    assert "at 1 mm there is work as well" in ended.stderr and "the head is disabled" in ended.stdout
    server.stop()
