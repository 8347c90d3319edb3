"""However an example ends, it leaves the head switched off, and says so."""

import functools
import pathlib
import signal
import subprocess
import sys

import pytest

from drive import Host, eds
from heads import HANGS, Server, eventually

EXAMPLES = pathlib.Path(__file__).parents[2] / "examples"
BORE, NAME, INCH = EXAMPLES / "bore.py", EXAMPLES / "name_heads.py", EXAMPLES / "inch.py"
# States of 2000h:1.
DISABLED, FAULT = 0, 8
# Of 2000h:2.
HOST_SILENT = 6


def boring(server):
    """The example that bores, once it erodes."""
    words = [sys.executable, "-u", BORE, "--channel", server.tcp, "--depth-mm", "0.5"]
    # Who runs these tests in the background of a shell has them ignore Ctrl-C, and a program inherits that.
    heed = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    pipe = subprocess.PIPE
    example = subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True, preexec_fn=heed)
    for line in example.stdout:
        # It tells every two seconds how deep it is.
        if line.endswith(" V\n"):
            return example
    raise AssertionError(example.stderr.read())


def ended(example):
    """What it has said since, on both ways."""
    said, complained = example.communicate(timeout=HANGS)
    assert example.returncode != 0
    return said + complained


def test_heads_that_wait_for_a_node_id_are_named_beside_those_that_have_one(tmp_path):
    options = ("--nodes", "2", "--node-id", "255", "--store", str(tmp_path / "stored"))
    for named in [["serial number 1 is node 5", "serial number 2 is node 6"], []]:
        server = Server(tmp_path, *options)
        words = [sys.executable, NAME, "--channel", server.tcp, "--node", "5"]
        said = subprocess.run(words, capture_output=True, text=True, timeout=HANGS, check=False)
        assert said.returncode == 0, said.stdout + said.stderr
        taken = "none" if named else "5, 6"
        assert said.stdout.splitlines() == [f"in use: {taken}", *named, "no other head waits for a node-ID"]
        server.stop()


@pytest.mark.parametrize("touch", [(), ("--touch",)])
def test_a_hole_deeper_than_the_stroke_is_bored_with_a_coarse_axis(tmp_path, touch):
    # Material that goes five times as fast, and work that begins just above the end of the stroke.
    fast = ("model.removal_um3_uj=2", "feed.max_um_s=500", "workpiece.surface_mm=11.92", "inch.reserve_um=50", "limit.lower_mm=12")
    server = Server(tmp_path, "--coarse-axis", *(word for one in fast for word in ("--set", one)))
    words = [sys.executable, "-u", INCH, "--channel", server.tcp, "--surface-mm", "11.92", "--depth-mm", "0.1"]
    said = subprocess.run([*words, "--step-mm", "3", *touch], capture_output=True, text=True, timeout=HANGS, check=False)
    assert said.returncode == 0, said.stdout + said.stderr
    bored = next(line for line in said.stdout.splitlines() if line.startswith("bored"))
    _, _, depth, _, _, moves, *_, carried, _ = bored.split()
    assert abs(float(depth) - 0.1) <= 0.002 and moves == "1" and abs(float(carried) - 3) <= 0.01, bored
    assert "out of the hole" in said.stdout
    server.stop()


def interrupt(example, _):
    example.send_signal(signal.SIGINT)


def break_bridge(_, server):
    server.tell("bridge.fault=true")


@pytest.mark.parametrize(
    ("end", "state", "says"),
    [(interrupt, DISABLED, "the head is disabled, pulses are off"), (break_bridge, FAULT, "the head is in fault 0x5400")],
)
def test_an_example_that_is_stopped_while_it_erodes_switches_the_head_off(tmp_path, end, state, says):
    server = Server(tmp_path)
    example = boring(server)
    end(example, server)
    assert says in ended(example)
    host = Host(server, "socketcand", eds(tmp_path))
    assert host.drive.sdo[0x2000][1].raw == state
    host.close()
    server.stop()


def test_when_a_program_dies_while_its_head_erodes_the_head_stops_by_itself(tmp_path):
    server = Server(tmp_path)
    example = boring(server)
    example.kill()
    example.wait()
    host = Host(server, "socketcand", eds(tmp_path))
    eventually("a fault", lambda: host.drive.sdo[0x2000][1].raw == FAULT)
    assert host.drive.sdo[0x2000][2].raw == HOST_SILENT
    host.close()
    server.stop()


def test_when_a_head_dies_its_program_ends_and_says_so(tmp_path):
    server = Server(tmp_path)
    example = boring(server)
    server.process.kill()
    server.process.wait()
    said = ended(example)
    assert "the head has been silent for 1 s" in said or "the head may still be on" in said


def test_an_example_that_cannot_switch_the_head_off_says_so(tmp_path):
    server = Server(tmp_path)
    example = boring(server)
    server.process.kill()
    server.process.wait()
    interrupt(example, server)
    assert "the head may still be on" in ended(example)
