"""One A3 sheet: frame, title block and the few drawing words that all sheets share.

Unit of length: 7.62 mm on paper. The page is 52 by 36 units; y points up.
"""

import re

import schemdraw
import schemdraw.elements as elm
from schemdraw.segments import Segment, SegmentPoly, SegmentText

from components import label

WIDTH, HEIGHT = 52, 36
MM_PER_UNIT = 7.62
SHEETS = 5
LIVE = "#b00020"  # touches the gap voltage
POWER = "#0b5394"  # 48 V or 24 V
TEXT = 8.5
SMALL = 7.5

schemdraw.use("svg")
schemdraw.svgconfig.text = "text"
schemdraw.config(
    inches_per_unit=MM_PER_UNIT / 25.4, fontsize=TEXT, lw=1, font="DejaVu Sans, Verdana, Arial, sans-serif"
)
elm.style(elm.STYLE_IEC)


class Shape(elm.Element):
    """Segments in page coordinates."""

    def __init__(self, *segments):
        super().__init__()
        self.segments.extend(segments)
        self.elmparams["drop"] = (0, 0)


class Sheet:
    """A drawing under construction; every method takes page coordinates."""

    def __init__(self, number, title, book):
        self.number, self.title, self.book = number, title, book
        self.drawing = schemdraw.Drawing(show=False)
        self.box(0, 0, WIDTH, HEIGHT)
        self._title_block()

    def _add(self, element):
        return self.drawing.add(element)

    def _shape(self, *segments):
        self._add(Shape(*segments).at((0, 0)).right())

    def text(self, x, y, text, align="left", valign="center", size=TEXT, color="black"):
        """Text as text; `align` and `valign` say which edge of it lies at the point."""
        self._shape(SegmentText((x, y), text, align=(align, valign), fontsize=size, color=color))

    def value(self, key):
        """A computed value, as sheets write it."""
        text = self.book.texts[key].replace("ohm", "Ω").replace("+-", "±")
        return re.sub(r"(?<=\d )u(?=[A-Z]|s\b|m\b)", "µ", text)

    def heading(self, x, y, text):
        self.text(x, y, text, size=11.5)

    def note(self, x, y, text):
        """Explanation, top left corner at the point."""
        for line in text.split("\n"):
            self.text(x, y, line, valign="top", size=SMALL, color="#333333")
            y -= 0.46

    def wire(self, *points, color="black", style="-", lw=None):
        self._shape(Segment(list(points), color=color, ls=style, lw=lw))

    def dot(self, x, y, color="black"):
        self._add(elm.Dot(radius=0.09).at((x, y)).color(color))

    def box(self, x, y, w, h, style="-", color="black", fill=None, lw=None):
        corners = [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]
        self._shape(SegmentPoly(corners, color=color, ls=style, fill=fill, lw=lw))

    def part(self, kind, a, b, name, value="", side=None, color="black"):
        """Two-terminal part from a to b, with name and value beside it.

        `side`: "above" (default) or "below" a horizontal part, "right" (default) or "left" of a vertical one; `"split"`
        puts the name above and the value below.
        """
        self._add(kind().at(a).to(b).color(color))
        (ax, ay), (bx, by) = a, b
        x, y = (ax + bx) / 2, (ay + by) / 2
        both = f"{name}\n{value}" if value else name
        if ay == by:
            if side == "split":
                self.text(x, y + 0.42, name, "center", "bottom")
                self.text(x, y - 0.42, value, "center", "top")
            elif side == "below":
                self.text(x, y - 0.45, both, "center", "top")
            else:
                self.text(x, y + 0.45, both, "center", "bottom")
        elif side == "left":
            self.text(x - 0.5, y, both, "right")
        else:
            self.text(x + 0.5, y, both, "left")

    def fit(self, kind, a, b, ref, side=None, color="black", name=None, extra=""):
        """A part of the component table, with its value; `extra` is printed after it."""
        self.part(kind, a, b, name or ref, label(ref) + extra, side, color)

    def ground(self, x, y):
        """Control 0 V."""
        self._add(elm.Ground(lead=False).at((x, y)).theta(0))

    def earth(self, x, y):
        """Protective earth, the star point."""
        self._add(elm.GroundChassis(lead=False).at((x, y)).theta(0))

    def floating(self, x, y):
        """0 V of the generator, isolated from control 0 V."""
        self._add(elm.GroundSignal(lead=False).at((x, y)).theta(0))

    def rail(self, x, y, name, color="black"):
        """Supply rail by name, drawn upwards from the point."""
        self.wire((x, y), (x, y + 0.35), color=color)
        self.wire((x - 0.4, y + 0.35), (x + 0.4, y + 0.35), color=color)
        self.text(x, y + 0.45, name, "center", "bottom", color=color)

    def flag(self, x, y, text, to="right", color="black"):
        """Named net that leaves the drawing here; the point is where the wire ends."""
        w = 0.235 * len(text) + 0.7
        s = 1 if to == "right" else -1
        outline = [
            (x, y),
            (x + 0.35 * s, y + 0.36),
            (x + w * s, y + 0.36),
            (x + w * s, y - 0.36),
            (x + 0.35 * s, y - 0.36),
        ]
        self._shape(SegmentPoly(outline, color=color, fill="#f4f4f4"))
        self.text(x + (w / 2 + 0.12) * s, y, text, "center", color=color)

    def terminal(self, x, y, text="", to="left", color="black"):
        """Screw terminal; the text stands outside it."""
        self._add(elm.Dot(open=True, radius=0.17).at((x, y)).color(color))
        if text:
            self.text(x + (-0.4 if to == "left" else 0.4), y, text, "right" if to == "left" else "left", color=color)

    def chip(self, x, y, w, h, name, left=(), right=(), top=(), bottom=(), color="black"):
        """Box with pins; each side is a list of (offset from the corner, label). Returns the pin ends by label."""
        self.box(x, y, w, h, color=color, fill="#fbfbf4")
        self.text(x + w / 2, y + h / 2, name, "center")
        ends = {}
        for offset, pin in left:
            self.wire((x - 0.6, y + offset), (x, y + offset))
            self.text(x + 0.15, y + offset, pin, "left", size=SMALL)
            ends[pin] = (x - 0.6, y + offset)
        for offset, pin in right:
            self.wire((x + w, y + offset), (x + w + 0.6, y + offset))
            self.text(x + w - 0.15, y + offset, pin, "right", size=SMALL)
            ends[pin] = (x + w + 0.6, y + offset)
        for offset, pin in top:
            self.wire((x + offset, y + h), (x + offset, y + h + 0.6))
            self.text(x + offset, y + h - 0.15, pin, "center", "top", size=SMALL)
            ends[pin] = (x + offset, y + h + 0.6)
        for offset, pin in bottom:
            self.wire((x + offset, y), (x + offset, y - 0.6))
            self.text(x + offset, y + 0.15, pin, "center", "bottom", size=SMALL)
            ends[pin] = (x + offset, y - 0.6)
        return ends

    def amplifier(self, x, y, name, plus="below"):
        """Operational amplifier or comparator with its upper input at the point. Returns upper, lower, out."""
        opamp = elm.Opamp().at((x, y)).anchor("in1" if plus == "below" else "in2").right()
        placed = self._add(opamp if plus == "below" else opamp.flip())
        cx, cy = placed.absanchors["center"]
        self.text(cx + 0.05, cy, name, "center", size=SMALL)
        low = placed.absanchors["in2" if plus == "below" else "in1"]
        return (x, y), tuple(low), tuple(placed.absanchors["out"])

    def transistor(self, x, y, name):
        """N-channel MOSFET with its drain at the point; gate 0.83 left and 1.17 below, source 1.67 below."""
        self._add(elm.NMos().at((x, y)).anchor("drain").theta(0))
        self.text(x + 0.3, y - 0.3, name, size=SMALL)

    def spring(self, x, y1, y2):
        """Spring between two heights."""
        turns = 8
        step = (y2 - y1) / (turns + 2)
        zigzag = [(x + (0.5 if i % 2 else -0.5), y1 + step * (i + 1.5)) for i in range(turns)]
        self.wire((x, y1), (x, y1 + step), *zigzag, (x, y2 - step), (x, y2))

    def arrow(self, x1, y1, x2, y2):
        """Arrow from the first point to the second."""
        self._shape(Segment([(x1, y1), (x2, y2)], arrow="->", arrowwidth=0.3, arrowlength=0.45))

    def barrier(self, x1, y1, x2, y2, text, tx, ty):
        """Insulation barrier."""
        self.wire((x1, y1), (x2, y2), color=LIVE, style="--", lw=2.2)
        self.text(tx, ty, text, "left", size=SMALL, color=LIVE)

    def _title_block(self):
        x, y, w = WIDTH - 17, 0, 17
        self.box(x, y, w, 2.6, fill="#ffffff")
        self.wire((x, y + 1.2), (x + w, y + 1.2))
        self.text(x + 0.4, y + 1.9, self.title, size=12)
        self.text(
            x + 0.4,
            y + 0.6,
            f"EDM servo head, wiring, sheet {self.number} of {SHEETS} (A3). Values: docs/wiring.md",
            size=SMALL,
        )

    def legend(self, x, y):
        """Meaning of colours and symbols; top left corner at the point."""
        self.box(x, y - 4.6, 12.4, 4.6)
        self.text(x + 0.3, y - 0.5, "Legend", size=SMALL)
        rows = [
            ("line", LIVE, "conductor that can carry the gap voltage: do not touch"),
            ("line", POWER, "48 V or 24 V power"),
            ("line", "black", "signal, 3.3 V or 5 V"),
            ("barrier", LIVE, "insulation barrier"),
            ("flag", "black", "net name or pin of the microcontroller"),
            ("ground", "black", "control 0 V; slashed: earth; triangle: generator 0 V"),
        ]
        for i, (what, color, meaning) in enumerate(rows):
            yy = y - 1.15 - 0.62 * i
            if what == "line":
                self.wire((x + 0.3, yy), (x + 1.7, yy), color=color)
            elif what == "barrier":
                self.wire((x + 0.3, yy), (x + 1.7, yy), color=color, style="--", lw=2.2)
            elif what == "flag":
                self._shape(
                    SegmentPoly(
                        [
                            (x + 0.3, yy),
                            (x + 0.5, yy + 0.2),
                            (x + 1.6, yy + 0.2),
                            (x + 1.6, yy - 0.2),
                            (x + 0.5, yy - 0.2),
                        ],
                        fill="#f4f4f4",
                    )
                )
            else:
                self.ground(x + 0.6, yy + 0.15)
                self.earth(x + 1.1, yy + 0.15)
                self.floating(x + 1.7, yy + 0.15)
            self.text(x + 2.1, yy, meaning, size=SMALL)

    def svg(self, source):
        """The sheet, A3 wide, with a title that a screen reader finds and the hash of what it is drawn from."""
        svg = self.drawing.get_imagedata("svg").decode()
        mm = lambda units: f"{units * MM_PER_UNIT:.0f}mm"
        svg = re.sub(
            r'height="[^"]*" width="[^"]*"', f'width="{mm(WIDTH + 0.25)}" height="{mm(HEIGHT + 0.25)}"', svg, count=1
        )
        svg = re.sub(r"<[^>]+>", lambda tag: re.sub(r"(\.\d{2})\d+", r"\1", tag[0]), svg)
        head, body = svg.split(">", 1)
        white = '<rect x="-100%" y="-100%" width="300%" height="300%" fill="white"/>'
        return f"{head}><title>{self.title}</title><desc>source {source}</desc>{white}{body}\n"
