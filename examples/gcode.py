"""A small part of G-code as segments of path: G0, G1, G2, G3, G17 to G19, G20, G21, G90, G91, F, M2.

Z is up, as on a machine; a head counts down. F is read and left alone: the gap decides how fast a path is eroded.
"""

import dataclasses
import re

WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
# Shapes of 200Eh:6 by plane, for G3 and G2: Z is the head's axis turned around.
SHAPES = {17: (1, 2), 18: (4, 3), 19: (6, 5)}
# Axes of the first and second word of a centre, in the order of 200Eh:4 and 5, and their signs.
CENTRES = {17: (("I", 1), ("J", 1)), 18: (("K", -1), ("I", 1)), 19: (("J", 1), ("K", -1))}
NM = {20: 25_400_000, 21: 1_000_000}


class Wrong(Exception):
    """A line that cannot be carried out."""


@dataclasses.dataclass
class Segment:
    """A segment as 200Eh takes it, nm, and the line that it stands in."""

    line: int
    down: int
    x: int
    y: int
    shape: int = 0
    centre: tuple = (0, 0)


def words(number, text):
    """The words of a line, without comments."""
    text = re.sub(r"\([^)]*\)|;.*|%", "", text).upper().strip()
    found, end = [], 0
    for match in WORD.finditer(text):
        if text[end : match.start()].strip():
            break
        found.append((match[1], float(match[2])))
        end = match.end()
    if rest := text[end:].strip():
        raise Wrong(f"line {number}: {rest.split()[0]}: not a word of G-code")
    return [word for word in found if word[0] != "N"]


def segments(text):
    """The path of a program: from X0 Y0 Z0, the surface of the work."""
    at, plane, unit, absolute, motion = dict.fromkeys("XYZ", 0), 17, 21, True, None
    for number, line in enumerate(text.splitlines(), 1):
        given, ends = {}, False
        for letter, value in words(number, line):
            word = f"{letter}{value:g}"
            if letter == "G" and value in (0, 1, 2, 3):
                motion = int(value)
            elif letter == "G" and value in SHAPES:
                plane = int(value)
            elif letter == "G" and value in NM:
                unit = int(value)
            elif letter == "G" and value in (90, 91):
                absolute = value == 90
            elif letter == "M" and value == 2:
                ends = True
            elif letter in "XYZIJK":
                if letter in given:
                    raise Wrong(f"line {number}: {word}: {letter} stands twice in the line")
                given[letter] = round(value * NM[unit])
            elif letter != "F":
                raise Wrong(f"line {number}: {word}: is not among G0 to G3, G17 to G21, G90, G91, F, M2")
        if not given:
            if ends:
                return
            continue
        if motion is None:
            raise Wrong(f"line {number}: no G0 to G3 before the first move")
        end = {axis: given.get(axis, 0 if not absolute else at[axis]) for axis in at}
        if not absolute:
            end = {axis: at[axis] + end[axis] for axis in at}
        segment = Segment(number, -end["Z"], end["X"], end["Y"])
        if motion >= 2:
            centre = CENTRES[plane]
            wrong = [letter for letter in "IJK" if letter in given and letter not in dict(centre)]
            if wrong or not any(letter in given for letter, _ in centre):
                wants = " and ".join(letter for letter, _ in centre)
                raise Wrong(f"line {number}: {''.join(wrong) or f'G{motion}'}: an arc in G{plane} has its centre in {wants}")
            segment.shape = SHAPES[plane][3 - motion]
            segment.centre = tuple(sign * given.get(letter, 0) for letter, sign in centre)
        elif centre := [letter for letter in "IJK" if letter in given]:
            raise Wrong(f"line {number}: {centre[0]}: only an arc has a centre")
        if motion >= 2 or end != at:
            yield segment
        if ends:
            return
        at = end
