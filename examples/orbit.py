"""Writes the G-code of an orbit: a cavity that is wider than its electrode by the undersize, all around.

The electrode sinks while it goes around: in circles or along squares whose radius is the undersize, or over a sphere, where the
radius grows as it comes up, so that the gap has the same width on the bottom as at the sides. The path is one path: a short is
retraced along it. What is written runs under LinuxCNC, in `cargo sim bore --path` and in `examples/path.py`.
"""

import argparse
import math

SHAPES = ("circle", "square", "sphere")
# Radius of an arc, mm (docs/path.md).
SMALLEST, LARGEST = 0.01, 500


def number(mm):
    """Tenths of a micrometre, which the path has."""
    return f"{mm:.4f}".rstrip("0").rstrip(".") if abs(mm) >= 5e-5 else "0"


class Program:
    """Lines of G-code, absolute, mm."""

    def __init__(self):
        self.lines, self.at = [], (0.0, 0.0, 0.0)

    def line(self, x, y, z):
        """Straight to a place."""
        self.lines.append(f"G1 X{number(x)} Y{number(y)} Z{number(z)}")
        self.at = (x, y, z)

    def turn(self, z):
        """Once around X0 Y0, and down to a depth."""
        x, y, _ = self.at
        self.lines.append(f"G3 X{number(x)} Y{number(y)} Z{number(z)} I{number(-x)} J{number(-y)}")
        self.at = (x, y, z)

    def square(self, radius, z):
        """Along a square from the middle of its right side, and down to a depth."""
        _, _, top = self.at
        corners = ((1, 1), (-1, 1), (-1, -1), (1, -1))
        for n, (x, y) in enumerate(corners):
            self.line(radius * x, radius * y, top + (z - top) * (2 * n + 1) / 8)
        self.line(radius, 0, z)


def rings(depth, pitch):
    """Depths of the turns: equal steps that end at the depth."""
    count = max(1, math.ceil(depth / pitch - 1e-9))
    return [depth * n / count for n in range(1, count + 1)]


def orbit(shape, undersize, depth, pitch):
    """The lines of a program.

    `undersize` mm: width to be added all around, at most the depth for a sphere. `depth` mm: of the cavity. `pitch` mm: how far it sinks
    in a turn; on a sphere, length of its surface from one ring to the next.
    """
    program = Program()
    if shape == "sphere":
        # Straight down to the depth less the undersize, then over half a sphere from its equator to its pole.
        middle = -(depth - undersize)
        program.line(0, 0, middle)
        for place in [0.0] + rings(undersize * math.pi / 2, pitch)[:-1]:
            angle = place / undersize
            radius, z = undersize * math.cos(angle), middle - undersize * math.sin(angle)
            if radius < SMALLEST:
                break
            program.line(radius, 0, z)
            program.turn(z)
        program.line(0, 0, -depth)
    else:
        program.line(undersize, 0, 0)
        # The last turn stays at the depth: the one before it was deep only at its end.
        for z in [*rings(depth, pitch), depth]:
            if shape == "circle":
                program.turn(-z)
            else:
                program.square(undersize, -z)
        program.line(0, 0, -depth)
    return program.lines


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", choices=SHAPES, default="circle", help="[%(default)s]")
    parser.add_argument("--undersize-mm", type=float, default=0.02, help="of the electrode on each side [%(default)s]")
    parser.add_argument("--depth-mm", type=float, default=0.05, help="of the cavity [%(default)s]")
    parser.add_argument("--pitch-mm", type=float, default=0.01, help="that it sinks in a turn [%(default)s]")
    parser.add_argument("--feed", type=float, default=3.0, help="largest feed, mm/min [%(default)s]")
    args = parser.parse_args()
    if not SMALLEST <= args.undersize_mm <= LARGEST:
        parser.error(f"--undersize-mm {args.undersize_mm:g}: must be from {SMALLEST} to {LARGEST}, as the radius of an arc")
    if not 0 < args.pitch_mm <= args.depth_mm:
        parser.error(f"--pitch-mm {args.pitch_mm:g}: must be above 0 and at most the depth")
    if args.shape == "sphere" and args.undersize_mm > args.depth_mm:
        parser.error(f"--undersize-mm {args.undersize_mm:g}: must be at most the depth, {args.depth_mm:g}, for a sphere")
    print(f"({args.shape}, undersize {args.undersize_mm:g} mm, {args.depth_mm:g} mm deep; Z0 is the surface of the work)")
    print("G21 G90 G17 G94\nG0 X0 Y0\nG0 Z0.1\nM3 S1\nM52 P1")
    for n, line in enumerate(orbit(args.shape, args.undersize_mm, args.depth_mm, args.pitch_mm)):
        print(line if n else f"{line} F{args.feed:g}")
    print("G4 P0.2\nM5\nG4 P0.5\nM52 P0\nG0 Z1.5\nM2")


if __name__ == "__main__":
    main()
