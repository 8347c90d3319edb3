"""Draws computed values into the pages.

What stands between `<!--=name-->` and `<!--/-->` is written here: a value that the arithmetic names, a part as the
component table has it, or a whole table (`<!--=table name-->`). Everything else of a page is written by hand. No line
begins with the marker of a value: Markdown would take the line for HTML.
"""

import re

import components
from book import short, unit
from pins import ALTERNATE, FREE, OTHERS, OTHERS_DISC, PINS

MARKED = re.compile(r"<!--=([\w. ]+)-->(.*?)<!--/-->", re.S)


class Unknown(Exception):
    """A marker whose name nothing computes."""


def plain(text):
    """Pages are written with ohm and u."""
    return text.replace("mΩ", "mohm").replace("Ω", "ohm").replace("µ", "u")


def rows(head, body):
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    lines += ["| " + " | ".join(cells) + " |" for cells in body]
    return "\n\n" + "\n".join(lines) + "\n\n"


def level(text, book):
    """Level and pull of a pin, with what it takes from the tables."""
    values = {ref: components.label(ref) for ref in components.PARTS}
    values |= {
        "scale": f"0..{components.SUPPLY_V['f405']} V, 0 V of gap = code {book.texts['gap.zero_code']}",
        "bus": book.texts["bus.ratio"],
        "own": book.texts["off.own_pin"],
    }
    return text.format(**values)


def with_alternate(function):
    """`TIM1_CH1` -> `TIM1_CH1, AF1`; EXTI lines after an `and`, plain pins as they are."""
    timer = function.split("_")[0]
    return f"{function}, {ALTERNATE[timer]}" if timer in ALTERNATE else function


def pin_table(book):
    body = [
        (p.text, p.pin, str(p.number), with_alternate(p.function), level(p.level, book), str(p.sheet)) for p in PINS
    ] + [(*row[:4], level(row[4], book), row[5]) for row in OTHERS]
    return rows(("signal", "pin", "no.", "function", "level, and pull on the board", "sheet"), body)


def disc_table(_):
    body = [(p.text, p.pin, p.disc, p.why) for p in PINS if p.disc] + OTHERS_DISC
    body.append(("all others", "", "as the 64-pin head", ""))
    return rows(("signal", "64-pin", "DISC1", "why"), body)


def settings_table(book):
    t = book.texts
    body = [
        ("`gap.zero_code`", t["gap.zero_code"], "the same"),
        ("`gap.volts_per_code`", short(book.numbers["gap.volts_per_code"]), t["disc.gap.volts_per_code"]),
        ("`gap.amps_per_code`", short(book.numbers["gap.amps_per_code"]), t["disc.gap.amps_per_code"]),
        ("`contact.below_v`", short(components.given("contact_v"), 2), "the same"),
        ("`motor.amps_per_code`", t["motor.amps_setting"], t["disc.motor.amps_per_code"]),
        ("`motor.bus_volts_per_code`", t["bus.setting"], t["disc.motor.bus_volts_per_code"]),
    ]
    return rows(("setting", "64-pin", "DISC1"), body)


def bounds_table(book):
    def bound(low, high, name):
        return " and ".join(
            f"{word} {shown(x, name)}" for word, x in (("at least", low), ("at most", high)) if x is not None
        )

    def shown(number, name):
        return unit(number, name) if name else short(number)

    body = [(what, shown(number, name), bound(low, high, name)) for what, number, low, high, name in book.bounds]
    return rows(("what", "computed", "allowed"), body)


def text_of(name, book):
    """What belongs between the markers of this name."""
    if name.startswith("table "):
        table = name.removeprefix("table ")
        special = {"pins": pin_table, "disc": disc_table, "settings": settings_table, "bounds": bounds_table}
        if table in special:
            return plain(special[table](book))
        if table in book.tables:
            return plain(rows(("quantity", "arithmetic", "value"), book.tables[table]))
    elif name == "free":
        return FREE
    elif name in book.texts:
        return plain(book.texts[name])
    elif name in components.PARTS:
        return plain(components.label(name))
    raise Unknown(name)


def render(text, book):
    """The page with its values current."""
    if text.count("<!--=") != len(MARKED.findall(text)) or text.count("<!--/-->") != text.count("<!--="):
        raise Unknown("a marker that is not closed")
    return MARKED.sub(lambda m: f"<!--={m[1]}-->{text_of(m[1], book)}<!--/-->", text)
