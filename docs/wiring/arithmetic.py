"""What follows from the component table: dividers, thresholds, ranges, currents, dissipation and time constants.

`compute()` gives the rows of the page's tables, the texts that page and sheets quote, the numbers that the firmware
must agree with, and the bounds that the design must keep. Run alone, it prints them.
"""

import front
import guard
import power
import touch
from book import Book


def compute():
    """Later ones use what earlier ones have found."""
    book = Book()
    for one in (
        front.gap,
        front.filters,
        front.comparators,
        front.gap_current,
        power.drive,
        power.motor_current,
        power.bus,
        guard.signals,
        guard.live,
        touch.sense,
        power.axis,
    ):
        one(book)
    return book


if __name__ == "__main__":
    book = compute()
    for name, rows in book.tables.items():
        print(f"\n[{name}]")
        for what, how, text in rows:
            print(f"  {what:<50} {how:<70} {text}")
    print("\n[bounds]")
    for what, number, low, high, name in book.bounds:
        good = (low is None or number >= low) and (high is None or number <= high)
        print(f"  {'ok ' if good else 'BAD'} {what}: {number:.4g} {name} (from {low} to {high})")
