"""What is computed, and how it is written."""

import math
from dataclasses import dataclass, field


def short(x, digits=3):
    """So many significant digits, without an exponent, without a rounding tail."""
    if x == 0:
        return "0"
    places = digits - 1 - math.floor(math.log10(abs(x)))
    rounded = round(x, places)
    return f"{rounded:.{max(places, 0)}f}"


def unit(x, name, digits=3):
    """With the prefix that leaves one to three figures before the point."""
    for prefix, scale in (("M", 1e6), ("k", 1e3), ("", 1), ("m", 1e-3), ("u", 1e-6), ("n", 1e-9), ("p", 1e-12)):
        if abs(x) >= scale * 0.9995:
            return f"{short(x / scale, digits)} {prefix}{name}"
    return f"{short(x, digits)} {name}"


@dataclass
class Book:
    """Everything computed."""

    numbers: dict = field(default_factory=dict)
    texts: dict = field(default_factory=dict)
    tables: dict = field(default_factory=dict)
    bounds: list = field(default_factory=list)

    def say(self, key, number, text):
        """A number, and how it is quoted."""
        if key in self.texts:
            raise ValueError(f"{key} is computed twice")
        self.numbers[key], self.texts[key] = number, text
        return number

    def row(self, table, key, what, how, number, text):
        """A number that stands in a table, too."""
        self.tables.setdefault(table, []).append((what, how, text))
        return self.say(key, number, text)

    def must(self, what, number, low=None, high=None, name=""):
        """A bound of the design."""
        self.bounds.append((what, number, low, high, name))
