"""A small part of G-code as segments of path, as docs/path.md lists it.

Z is up, as on a machine; a head counts down. The gap decides how fast a path is eroded: F is a bound for that. A program that
switches pulses (M3, M5), as LinuxCNC runs it, erodes between the two.
"""

import dataclasses
import math
import re

WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
# Shapes of 200Eh:6 by plane, for G3 and G2: Z is the head's axis turned around.
SHAPES = {17: (1, 2), 18: (4, 3), 19: (6, 5)}
# Axes of the first and second word of a centre, in the order of 200Eh:4 and 5, and their signs.
CENTRES = {17: (("I", 1), ("J", 1)), 18: (("K", -1), ("I", 1)), 19: (("J", 1), ("K", -1))}
NM = {20: 25_400_000, 21: 1_000_000}
# Words that contradict each other, and those that say what holds here anyway.
GROUPS = {"G": ((0, 1, 2, 3, 4, 10), (17, 18, 19), (20, 21), (90, 91)), "M": ((3, 5),)}
PASSED = {"G": (4, 40, 49, 54, 80, 94), "M": (52,)}
WORDS = "G0 to G4, G10, G17 to G21, G40, G49, G54, G80, G90, G91, G94, F, M2, M3 S, M5, M30, M52 P"
# Smallest feed, um/s: that of feed.max_um_s. Ends in whole um may be so far too far apart for a half turn, nm.
SLOWEST = 0.1
INCONSISTENCY = 2000


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
    feed: float | None = None
    """F, um/s, if it holds: no faster feed."""


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


def by_radius(number, radius, chord, forward):
    """The centre of an arc from its beginning, nm; with a negative radius it is the longer way around."""
    (u, v), length = chord, math.hypot(*chord)
    if not length:
        raise Wrong(f"line {number}: R: an arc with R must not end where it begins; give a full circle by I, J or K")
    if length > 2 * abs(radius) + INCONSISTENCY:
        raise Wrong(f"line {number}: R: its ends are {length / 1e6:.3f} mm apart, more than two radii")
    aside = math.sqrt(max(0, radius**2 - length**2 / 4)) / length
    left = aside if forward == (radius > 0) else -aside
    return round(u / 2 - left * v), round(v / 2 + left * u)


def segments(text):
    """The path of a program: from X0 Y0 Z0, the surface of the work."""
    path, off, on = [], None, None
    for number, word, at, segment in moves(text):
        if word == "M3" and not on:
            if on is None and (at["X"], at["Y"]) != (0, 0):
                raise Wrong(f"line {number}: M3: the head is at X0 Y0, and erodes from there")
            if off not in (None, at):
                raise Wrong(f"line {number}: M3: must be where M5 was; a head erodes one path")
            if on is None:
                path.clear()
            on = True
        elif word == "M5" and on:
            on, off = False, at
        elif segment and on is not False:
            path.append(segment)
    return iter(path)


def moves(text):
    """The segments of a program, and where it switches pulses: line, word, where it is before, segment."""
    at, plane, unit, absolute, motion, feed = dict.fromkeys("XYZ", 0), 17, 21, True, None, None
    for number, line in enumerate(text.splitlines(), 1):
        given, ends, seen, pulses = {}, False, [], None
        found = words(number, line)
        offset, waits = ("G", 10) in found, ("G", 4) in found
        for letter, value in found:
            word = f"{letter}{value:g}"
            if letter in GROUPS:
                group = next((group for group in GROUPS[letter] if value in group), ())
                if others := [other for of, other in seen if of == letter and other in group]:
                    raise Wrong(f"line {number}: {word}: {letter}{others[0]:g} is in the same line")
                seen.append((letter, value))
            if letter == "G" and value in (0, 1, 2, 3):
                motion = int(value)
            elif letter == "G" and value in SHAPES:
                plane = int(value)
            elif letter == "G" and value in NM:
                unit = int(value)
            elif letter == "G" and value in (90, 91):
                absolute = value == 90
            elif letter == "M" and value in (2, 30):
                ends = True
            elif letter == "M" and value in (3, 5):
                pulses = word
            elif letter == "G" and value == 10:
                # Z0 is the surface, whatever a machine has to be told to have it there.
                if ("P", 1) not in found or not {("L", 2), ("L", 20)} & set(found):
                    raise Wrong(f"line {number}: {word}: must be G10 L2 P1 or G10 L20 P1")
            elif offset and letter in "XYZLP" or letter == "P" and (waits or ("M", 52) in found):
                pass
            elif letter == "S" and ("M", 3) in found:
                pass
            elif letter in "FRXYZIJK":
                if letter in given:
                    raise Wrong(f"line {number}: {word}: {letter} is twice in the line")
                given[letter] = value
            elif value not in PASSED.get(letter, ()):
                raise Wrong(f"line {number}: {word}: must be one of {WORDS}")
        if pulses:
            yield number, pulses, at, None
        # The unit may stand behind them.
        if "F" in given:
            value = given.pop("F")
            feed = value * NM[unit] / 60e3
            if feed < SLOWEST:
                least = math.ceil(SLOWEST * 60e9 / NM[unit]) / 1e6
                raise Wrong(f"line {number}: F{value:g}: a feed must be {least:g} or more, in units a minute")
        given = {letter: round(value * NM[unit]) for letter, value in given.items()}
        if not given:
            if ends:
                return
            continue
        if motion is None:
            raise Wrong(f"line {number}: no G0 to G3 before the first move")
        end = {axis: given.get(axis, 0 if not absolute else at[axis]) for axis in at}
        if not absolute:
            end = {axis: at[axis] + end[axis] for axis in at}
        segment = Segment(number, -end["Z"], end["X"], end["Y"], feed=feed if motion else None)
        if motion >= 2:
            centre = CENTRES[plane]
            segment.shape = SHAPES[plane][3 - motion]
            centres = [letter for letter in "IJK" if letter in given]
            if "R" in given and centres:
                raise Wrong(f"line {number}: {centres[0]}: an arc with R must have no other centre")
            wrong = [letter for letter in centres if letter not in dict(centre)]
            if "R" in given:
                by = {"I": end["X"] - at["X"], "J": end["Y"] - at["Y"], "K": end["Z"] - at["Z"]}
                chord = [sign * by[letter] for letter, sign in centre]
                # Odd shapes lead from the first axis of the plane toward the second.
                segment.centre = by_radius(number, given["R"], chord, segment.shape % 2 == 1)
            elif wrong or not any(letter in given for letter, _ in centre):
                wants = " and ".join(letter for letter, _ in centre)
                raise Wrong(f"line {number}: {''.join(wrong) or f'G{motion}'}: an arc in G{plane} has its centre in {wants}, or a radius in R")
            else:
                segment.centre = tuple(sign * given.get(letter, 0) for letter, sign in centre)
        elif centre := [letter for letter in "IJKR" if letter in given]:
            raise Wrong(f"line {number}: {centre[0]}: only an arc has a centre or a radius")
        if motion >= 2 or end != at:
            yield number, None, at, segment
        if ends:
            return
        at = end
