"""What the firmware takes for granted of the wiring, read from its sources and compared with the arithmetic."""

import re
from pathlib import Path

from components import given, value
from pins import PINS

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = "docs/settings.md"
BOARDS = {"f405": "hal-shim/src/board/f405.rs", "disc": "hal-shim/src/board/disc.rs"}
CHIP = "hal-shim/src/board/chip.rs"
INSTALLATION = "host/sim/src/process/installation.rs"
MACHINE = "host/process/src/parameters/mod.rs"

# Half a percent: what rounding a setting to three digits may cost.
TOLERANCE = 0.005
# Settings that scale with the supply of the converter: every board needs its own.
SCALES = ("gap.volts_per_code", "gap.amps_per_code", "motor.amps_per_code", "motor.bus_volts_per_code")


def read(path):
    return (ROOT / path).read_text()


def settings():
    """Defaults of docs/settings.md, which is generated from the firmware."""
    rows = re.findall(r"^\| `([\w.]+)` \| \S+ \| [^|]* \| ([^|]*) \|", read(SETTINGS), re.M)
    return {key: default.split()[0] for key, default in rows}


def constant(path, name):
    """A constant of Rust; its number without underscores."""
    match = re.search(rf"\b{name}: \w+ = ([\d_.]+);", read(path))
    return float(match[1].replace("_", "")) if match else None


def board(path):
    """Default settings and pins of a board."""
    text = read(path)
    defaults = dict(re.findall(r'"([\w.]+)" = ([\d.]+)', re.search(r"defaults: \{(.*?)\}", text, re.S)[1]))
    rows = re.findall(r'^\s*(\w+): \w+\.\w+ (P[A-I]\d+), "([^"]*)"', text, re.M)
    return defaults, {pin: (signal, function) for signal, pin, function in rows}


def claims(function):
    """What of a pin's function collides with others, without CAN, which a board may route as it likes."""
    return {w for w in re.split(r"[ ,]+", function) if ("_" in w or w.startswith("EXTI")) and not w.startswith("CAN")}


class Findings(list):
    """What disagrees: each says what, where it is, what it should be."""

    def equal(self, what, found, expected, tolerance=TOLERANCE):
        if found is None:
            self.append(f"{what}: not there, expected {expected:.4g}")
        elif abs(float(found) - expected) > tolerance * abs(expected):
            self.append(f"{what}: {found}, expected {expected:.4g}")

    def between(self, what, found, low, high):
        if found is None or not low <= float(found) <= high:
            self.append(f"{what}: {found}, expected {low:.4g} to {high:.4g}")


def compare(book):
    """Every disagreement."""
    n, found = book.numbers, Findings()
    have = settings()
    for key, expected in {
        "gap.volts_per_code": n["gap.volts_per_code"],
        "gap.zero_code": n["gap.zero_code"],
        "gap.amps_per_code": n["gap.amps_per_code"],
        "gap.current_zero_code": given("codes") / 2,
        "gap.open_min_v": given("open_least_v"),
        "contact.below_v": given("contact_v"),
        "motor.amps_per_code": n["motor.amps_per_code"],
        "motor.bus_volts_per_code": n["motor.bus_volts_per_code"],
        "axis.mass_kg": given("mass_kg"),
        "axis.resistance_ohm": given("coil_ohm"),
        "axis.inductance_mh": given("coil_h") * 1e3,
        "axis.force_constant_n_a": given("force_n_a"),
        "axis.bus_v": given("bus_v"),
        "axis.counterbalance_n": given("counterbalance_n"),
        "axis.breakaway_n": given("friction_n"),
    }.items():
        found.equal(f"{SETTINGS}, {key}", have.get(key), expected)
    # The reflex must not take the zero error for a current.
    found.between(
        f"{SETTINGS}, gap.short_a",
        have.get("gap.short_a"),
        1.9 * n["current.zero_error"] * n["gap.amps_per_code"],
        given("pulse_a"),
    )
    found.between(f"{SETTINGS}, motor.peak_a", have.get("motor.peak_a"), 0, n["motor.usable"])
    for name, path in BOARDS.items():
        defaults, rows = board(path)
        for key in SCALES:
            expected = n[key] if name == "f405" else n[f"{name}.{key}"]
            found.equal(f"{path}, {key}", defaults.get(key, have.get(key)), expected)
        pins(found, name, path, rows)
    found.equal(f"{CHIP}, TICK_HZ", constant(CHIP, "TICK_HZ"), 1 / given("tick_s"), 0)
    for ref in ("R215", "R216", "R230", "R308"):
        found.between(f"{ref} against {CHIP}, SOURCE_OHM", value(ref), 0, constant(CHIP, "SOURCE_OHM"))
    path = "hal-shim/src/stm32f4/generator.rs"
    found.equal(f"{path}, FULL_SCALE_NS", constant(path, "FULL_SCALE_NS"), n["off.full_s"] * 1e9)
    path = "src/settings/build.rs"
    least = re.search(r"generator_off_time_us < ([\d.]+)", read(path))
    found.equal(f"{path}, least generator.off_time_us", least and least[1], n["off.own"] * 1e6)
    around, machine = read(INSTALLATION), read(MACHINE)
    for key, expected in {
        "front_end.zero_code": n["gap.zero_code"],
        "front_end.volts_per_code": n["gap.volts_per_code"],
        "front_end.amps_per_code": n["motor.amps_per_code"],
        "front_end.bus_volts_per_code": n["motor.bus_volts_per_code"],
    }.items():
        match = re.search(rf'= ([\d.]+), \([^)]*\), "{re.escape(key)}"', around)
        found.equal(f"{INSTALLATION}, {key}", match and match[1], expected)
    for key, expected in {
        "coil_ohm": given("coil_ohm"),
        "coil_mh": given("coil_h") * 1e3,
        "force_n_a": given("force_n_a"),
    }.items():
        match = re.search(rf"^ *{key} = ([\d.]+),", machine, re.MULTILINE)
        found.equal(f"{MACHINE}, {key}", match and match[1], expected)
    return found


def pins(found, name, path, rows):
    """Pins of the page against those of a board."""
    page = {}
    for p in PINS:
        pin, _, function = p.disc.partition(", ") if name == "disc" and p.disc else (p.pin, "", p.function)
        page[pin] = (p.signal, function)
    for pin in sorted(page.keys() | rows.keys()):
        ours, theirs = page.get(pin), rows.get(pin)
        if theirs is None:
            found.append(f"{path}, {pin}: not there, expected {ours[0]}, {ours[1]}")
        elif ours is None:
            found.append(f"{path}, {pin}: {theirs[0]}, {theirs[1]}; docs/wiring/pins.py has nothing there")
        elif ours[0] != theirs[0] or claims(ours[1]) != claims(theirs[1]):
            found.append(f"{path}, {pin}: {theirs[0]}, {theirs[1]}; expected {ours[0]}, {ours[1]}")
