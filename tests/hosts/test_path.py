"""The G-code that the examples read, and a path of it on a virtual head."""

import pathlib
import subprocess
import sys

import pytest

from heads import HANGS, Server

EXAMPLES = pathlib.Path(__file__).parents[2] / "examples"
sys.path.append(str(EXAMPLES))
from gcode import Segment, Wrong, segments  # noqa: E402


# F2, um/s.
FEED = 2e3 / 60


def test_a_program_is_lines_and_arcs_in_nm_with_z_turned_around():
    program = "%\nN1 G21 G90 (mm)\nG1 X1 Z-0.5 F2\nG3 X3 I1 ; half around\ng91 g2 x-2 i-1 z-.25\nG18 G3 Z1 X1 K0 I1\nG20 G0 X1\nM2\nG1 X9"
    assert list(segments(program)) == [
        Segment(3, 500_000, 1_000_000, 0, feed=FEED),
        Segment(4, 500_000, 3_000_000, 0, 1, (1_000_000, 0), FEED),
        Segment(5, 750_000, 1_000_000, 0, 2, (-1_000_000, 0), FEED),
        # From down toward X is backward from Z toward X.
        Segment(6, -250_000, 2_000_000, 0, 4, (0, 1_000_000), FEED),
        Segment(7, -250_000, 27_400_000, 0),
    ]


def test_the_planes_turn_as_seen_from_their_third_axis():
    shapes = {17: ("I1", 1, 2), 18: ("I1", 4, 3), 19: ("J1", 6, 5)}
    for plane, (centre, forward, back) in shapes.items():
        found = segments(f"G{plane}\nG3 {centre}\nG2 {centre}")
        assert [segment.shape for segment in found] == [forward, back]


def test_an_arc_by_its_radius_is_the_one_by_its_centre():
    for plane, end, centres in [
        ("G17", "X1 Y1", ["I0 J1", "I1 J0"]),
        ("G18", "Z1 X1", ["K0 I1", "K1 I0"]),
        ("G19", "Y1 Z1", ["J0 K1", "J1 K0"]),
    ]:
        for motion, (minor, major) in (("G3", centres), ("G2", centres[::-1])):
            for radius, centre in (("R1", minor), ("R-1", major)):
                (by_radius,) = segments(f"{plane} {motion} {end} {radius}")
                (by_centre,) = segments(f"{plane} {motion} {end} {centre}")
                assert by_radius == by_centre


def test_what_a_post_writes_around_a_program_is_passed_over():
    post = "%\nN10 G17 G21 G40 G49 G80 G90 G94 (head)\nN20 G01 X1 F2\nN30 M30\n%"
    assert list(segments(post)) == [Segment(3, 0, 1_000_000, 0, feed=FEED)]
    feeds = [segment.feed for segment in segments("G1 X1\nG1 X2 F6\nX3\nG0 X4\nG20 F6 G1 X0")]
    assert feeds == pytest.approx([None, 100, 100, None, 2540])


def test_a_program_of_a_machine_erodes_between_its_switching_pulses_on_and_off():
    found = list(segments((EXAMPLES / "linuxcnc" / "hole.ngc").read_text()))
    assert [(segment.line, segment.down, segment.x, segment.y) for segment in found] == [(9, 20_000, 0, 0)]
    found = segments("G0 X1 Z2\nX0\nM3 S1 G1 Z-1\nM5 G0 Z3\nZ-1\nM3 S1\nX1\nM2")
    assert [(segment.down, segment.x) for segment in found] == [(1_000_000, 0), (1_000_000, 1_000_000)]
    assert len(list(segments("M5\nG1 Z-1\nG4 P1\nX1\nM5"))) == 2, "no M3"


@pytest.mark.parametrize(
    ("program", "says"),
    [
        ("M4 S100", "line 1: M4: must be one of"),
        ("G1 X1 S100", "line 1: S100: must be one of"),
        ("G1 X1 P1", "line 1: P1: must be one of"),
        ("G1 X1 G4 P1", "line 1: G4: G1 is in the same line"),
        ("G10 L2 P2 Z1", "line 1: G10: must be G10 L2 P1"),
        ("M3 M5", "line 1: M5: M3 is in the same line"),
        ("G0 X1\nM3 S1\nG1 Z-1", "line 2: M3: the head is at X0 Y0"),
        ("M3\nG1 Z-1\nM5\nG0 X1\nM3\nG1 Z-2", "line 5: M3: must be where M5 was"),
        ("G1 X1\nG5 X2", "line 2: G5: must be one of"),
        ("G1 X1 Q2", "line 1: Q2: must be one of"),
        ("\nX1", "line 2: no G0 to G3"),
        ("G1 X1 X2", "line 1: X2: X is twice"),
        ("G2 X1 K1", "line 1: K: an arc in G17 has its centre in I and J"),
        ("G3 X1", "line 1: G3: an arc in G17"),
        ("G1 X1 I1", "line 1: I: only an arc"),
        ("G1 Xnan", "line 1: XNAN: not a word"),
        ("G1 X1 hello", "line 1: HELLO: not a word"),
        ("G1 X1 R1", "line 1: R: only an arc"),
        ("G2 X1 R1 J1", "line 1: J: an arc with R"),
        ("G2 X0 Y0 R1", "line 1: R: an arc with R must not end where it begins"),
        ("G2 X2.003 R1", "line 1: R: its ends are 2.003 mm apart"),
        ("G1 X1\nG90 G91 X1", "line 2: G91: G90 is in the same line"),
        ("G0 G1 X1", "line 1: G1: G0 is in the same line"),
        ("G1 X1 F0", "line 1: F0: a feed must be 0.006 or more"),
        ("G20 G1 X1 F-5", "line 1: F-5: a feed must be 0.000237 or more"),
    ],
)
def test_what_is_wrong_is_named_with_line_and_word(program, says):
    with pytest.raises(Wrong) as wrong:
        list(segments(program))
    assert says in str(wrong.value)


def orbit(*words):
    words = [sys.executable, EXAMPLES / "orbit.py", *words]
    return subprocess.run(words, capture_output=True, text=True, timeout=HANGS)


@pytest.mark.parametrize("shape", ["circle", "square", "sphere"])
def test_an_orbit_is_wider_than_the_electrode_by_the_undersize_and_as_deep_as_asked(shape):
    written = orbit("--shape", shape, "--undersize-mm", "0.3", "--depth-mm", "0.5", "--pitch-mm", "0.07")
    found = list(segments(written.stdout))
    assert max(segment.down for segment in found) == found[-1].down == 500_000
    assert (found[-1].x, found[-1].y) == (0, 0)
    for segment, before in zip(found[1:-1], found):
        radius, down = max(abs(segment.x), abs(segment.y)), segment.down
        if shape == "sphere":
            # As far from the centre of the sphere in every place.
            assert abs((radius**2 + (down - 200_000) ** 2) ** 0.5 - 300_000) < 200
        else:
            assert radius == 300_000
        if segment.shape:
            # A whole turn around X0 Y0.
            assert (segment.x, segment.y) == (before.x, before.y) == tuple(-at for at in segment.centre)
        assert down >= before.down
    if shape == "square":
        corners = {(segment.x, segment.y) for segment in found if segment.down == 500_000 and abs(segment.y) == 300_000}
        assert corners == {(x, y) for x in (-300_000, 300_000) for y in (-300_000, 300_000)}
    else:
        assert found[-2].shape == 1 and found[-2].down == found[-3].down, "the last turn stays where it is"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--undersize-mm", "0.005"), "must be from 0.01 to 500"),
        (("--pitch-mm", "0"), "must be above 0"),
        (("--shape", "sphere", "--undersize-mm", "0.1", "--depth-mm", "0.05"), "at most the depth"),
    ],
)
def test_an_orbit_that_cannot_be_says_why(words, says):
    refused = orbit(*words)
    assert refused.returncode == 2 and says in refused.stderr


def eroded(server, *words):
    words = [sys.executable, EXAMPLES / "path.py", "--channel", server.tcp, *words]
    return subprocess.run(words, capture_output=True, text=True, timeout=HANGS)


def test_a_head_erodes_along_a_program_to_its_end(tmp_path):
    server = Server(tmp_path)
    example = eroded(server, EXAMPLES / "cavity.ngc")
    assert example.returncode == 0, example.stderr
    assert "4 segments eroded" in example.stdout
    assert "at X 0.010, Y 0.010, Z -0.03" in example.stdout
    assert "the head is disabled, pulses are off" in example.stdout
    server.stop()


def test_a_segment_that_the_head_cannot_take_is_named_with_its_line(tmp_path):
    server = Server(tmp_path)
    program = tmp_path / "radius.ngc"
    program.write_text("G1 Z-0.01\nG3 X1 I0.7\n")
    example = eroded(server, program)
    assert example.returncode != 0
    assert "line 2: refused, 17" in example.stderr
    assert "the head is disabled, pulses are off" in example.stdout
    server.stop()
