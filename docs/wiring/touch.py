"""Arithmetic of the sense supply on sheet 5: contact with pulses off."""

import itertools
import math

from book import unit
from components import LOGIC_V, PARTS, data, given, label, value
from front import amplifier


def sense(b):
    volts, tol = data("U504", "volts"), PARTS["U504"].tolerance
    r = value("R505") + value("R506")
    drop_on, drop_open = 2 * data("D503", "on_v"), 2 * data("D503", "open_v")
    ratio = b.numbers["gap.ratio"]
    scale, zero, error = b.numbers["gap.volts_per_code"], b.numbers["gap.zero"], b.numbers["gap.offset_error"]
    load = 10 * value("R201")
    threshold = given("contact_v")

    def open_v(supply, drop):
        return (supply - drop) * load / (load + r)

    nominal = open_v(volts, drop_open)
    least = open_v(volts * (1 - tol), drop_open * 1.3) * (1 - b.numbers["gap.scale_error"] - given("regulator")) - error
    most = open_v(volts * (1 + tol), drop_open * 0.7) * (1 + b.numbers["gap.scale_error"] + given("regulator")) + error
    b.row(
        "sense", "sense.open", "open gap",
        f"({volts:.0f} V - 2 x {data('D503', 'open_v')} V) x {load / 1e6:.0f} M / ({load / 1e6:.0f} M + {unit(r, '')})",
        nominal,
        f"{nominal:.1f} V = code {zero + nominal / scale:.0f}; {least:.1f} to {most:.1f} V with all tolerances",
    )
    b.say("sense.open_v", nominal, f"{nominal:.1f} V")
    b.say("sense.least", least, f"{least:.1f} V")
    b.say("sense.most", most, f"{most:.1f} V")
    b.row(
        "sense", "sense.contact_v", "contact below (proposed threshold)", "between the rows above and below", threshold,
        f"{threshold:.1f} V = code {zero + threshold / scale:.0f}",
    )
    b.say("sense.threshold", threshold, f"{threshold:.1f} V")
    broken = (amplifier(None, 0.0) - amplifier(0.0, 0.0)) * ratio
    b.row(
        "sense", "sense.broken", "lead of the electrode broken (GAP+)", "R211, R212 through the one row that is left",
        broken, f"{broken:.1f} V, {broken + error:.1f} V with the offset error: contact",
    )
    # The workpiece is control 0 V: its lead only adds accuracy.
    lost = (amplifier(nominal, None) - amplifier(0.0, 0.0)) * ratio
    touch = (amplifier(0.0, None) - amplifier(0.0, 0.0)) * ratio
    b.row(
        "sense", "sense.earth", "lead of the workpiece broken (GAP-)", "the workpiece is control 0 V", lost,
        f"open {lost:.1f} V, contact {touch:.1f} V: still correct",
    )
    b.say("sense.earth_v", lost, f"{lost:.1f} V")
    b.row("sense", "sense.missing", "sense supply missing", "nothing drives the gap", 0.0, "0 V: contact")
    amps = (volts - drop_on) / r
    b.row(
        "sense", "sense.amps", "current into a contact",
        f"({volts:.0f} V - 2 x {data('D503', 'on_v')} V) / {unit(r, 'ohm')}", amps, unit(amps, "A"),
    )
    for ohm in (1, 10, 100):
        v = (volts - drop_on) * ohm / (r + ohm)
        b.row(
            "sense", f"sense.at_{ohm}", f"contact of {ohm} ohm", f"{volts - drop_on:.1f} V x {ohm} / ({r:.0f} + {ohm})",
            v, unit(v, "V", 2),
        )
    limit = r * threshold / (volts - drop_on - threshold)
    b.row(
        "sense", "sense.limit", "largest resistance that reads contact",
        f"{unit(r, 'ohm')} x {threshold:.1f} / ({volts - drop_on:.1f} - {threshold:.1f})", limit, unit(limit, "ohm"),
    )
    b.say("sense.limit_n", limit, unit(limit, "ohm"))
    for key, area, what in (
        ("small", math.pi * 1.5e-3**2, "3 mm round"),
        ("medium", 1e-4, "1 cm^2"),
        ("large", 10e-4, "10 cm^2"),
    ):
        water = limit * given("water_s_m") * area
        b.row(
            "sense", f"sense.water_{key}", f"water of 20 uS/cm, electrode {what}",
            f"gap = {limit:.0f} ohm x 20 uS/cm x area", water, f"reads contact at {unit(water, 'm', 2)}",
        )
    oil = 10e-6 / given("oil_s_m") / 10e-4
    b.row(
        "sense", "sense.oil", "oil of 10 pS/cm, 10 cm^2, gap 10 um",
        "gap / (conductivity x area); new oil conducts less", oil, f"{unit(oil, 'ohm')}: never reads contact",
    )
    leak = r * (threshold * 1.5) / (volts - drop_on - threshold * 1.5)
    b.row(
        "sense", "sense.leak", "least resistance of the generator at rest", f"open still reads 1.5 x {threshold:.1f} V",
        leak, unit(leak, "ohm"),
    )
    cable, rc = given("cable_f"), given("rc_f")
    for key, what, c in (
        ("rc", f"with {rc * 1e12:.0f} pF of an RC generator", rc + cable),
        ("cable", f"cables alone, {cable * 1e12:.0f} pF (assumed)", cable),
    ):
        b.row(
            "sense", f"sense.tau_{key}", f"time constant, gap opens, {what}", f"{unit(r, 'ohm')} x {unit(c, 'F')}",
            r * c, unit(r * c, "s", 2),
        )
        decay = load * c * math.log(nominal / threshold)
        b.row(
            "sense", f"sense.lost_{key}", f"supply lost, to contact, {what}",
            f"{load / 1e6:.0f} M x {unit(c, 'F')} x ln({nominal:.1f} / {threshold:.1f})", decay, unit(decay, "s", 2),
        )
    after = load * (rc + cable) * math.log(given("open_v") / most)
    b.row(
        "sense", "sense.after", f"after pulses of {given('open_v'):.0f} V, to an open reading",
        f"{load / 1e6:.0f} M x {unit(rc + cable, 'F')} x ln({given('open_v'):.0f} / {most:.1f})", after,
        f"{unit(after, 's', 2)} at most; a touch ends it at once",
    )
    b.say("sense.after_s", after, unit(after, "s", 2))
    # One of the four resistors of the amplifier open or short must not look like an open gap.
    wrong = []
    for arm, error_of in itertools.product(range(4), (1e9, -1 + 1e-9)):
        arms = tuple(error_of if i == arm else 0 for i in range(4))
        for volts_there in (0.0, nominal):
            out = min(max(amplifier(volts_there, 0.0, arms=arms), 0.0), LOGIC_V)
            wrong.append((out - amplifier(0.0, 0.0)) * ratio)
    low, high = max(x for x in wrong if x < threshold), min(x for x in wrong if x >= threshold)
    b.row(
        "sense", "sense.parts", "one of R211..R214 open or short", "worst of all, gap open or shorted", high,
        f"below {low:.0f} V, contact, or above {high:.0f} V: implausible",
    )
    b.say("sense.implausible", high, f"{high:.0f} V")
    b.must("lowest implausible reading, one of R211..R214 gone", high, low=2 * most, name="V")
    c = given("rc_f") + given("cable_f")
    spark = c * (volts * (1 + tol)) ** 2 / 2
    b.row(
        "sense", "sense.energy", "energy that a touch discharges", f"{unit(c, 'F')} at {volts * (1 + tol):.1f} V",
        spark, f"{unit(spark, 'J', 2)}; one pulse of the generator has some mJ",
    )
    # A contact discharges the capacitor at once: what delays is the mean of a tick, and the tick that reads it.
    share = 1 - threshold / nominal
    b.row(
        "sense", "sense.delay", "contact to reading below the threshold",
        f"mean of one tick: at most {1 + share:.2f} ticks, and the tick that reads it",
        2 * given("tick_s") + share * given("tick_s"), unit((2 + share) * given("tick_s"), "s", 2),
    )
    delay = (2 + share) * given("tick_s")
    for key, what in (("seek_m_s", "5 mm/s"), ("fast_seek_m_s", "20 mm/s")):
        way = given(key) * delay
        b.row(
            "sense", f"sense.way_{key}", f"travel in that time at {what}", "2 N/um (assumed)", way,
            f"{unit(way, 'm', 2)}, {way * given('stiffness_n_m'):.1f} N",
        )
    # Faults.
    swing = (given("swing_v") + volts) / r
    b.row(
        "sense", "sense.swing", f"continuous reverse voltage of -{given('swing_v'):.0f} V",
        f"({given('swing_v'):.0f} + {volts:.0f}) V / {unit(r, 'ohm')}; "
        f"rating 2 x {data('R505', 'watts'):.0f} W, F501 {label('F501')}",
        swing, f"{unit(swing, 'A', 2)}, {swing**2 * r:.1f} W",
    )
    reverse = (given("open_v") + volts) / r
    b.row(
        "sense", "sense.reverse", f"generator reversed, -{given('open_v'):.0f} V",
        f"({given('open_v'):.0f} + {volts:.0f}) V / {unit(r, 'ohm')}", reverse,
        f"{unit(reverse, 'A', 2)}, {reverse / value('F501'):.1f} times F501: it opens, contact",
    )
    b.row(
        "sense", "sense.diodes", f"D503 and D504 both short, +{given('open_v'):.0f} V",
        f"({given('open_v'):.0f} - {data('D502', 'volts'):.0f}) V / {unit(r, 'ohm')} into D502",
        (given("open_v") - data("D502", "volts")) / r,
        f"{unit((given('open_v') - data('D502', 'volts')) / r, 'A', 2)}: F501 opens, "
        f"D502 holds {data('D502', 'volts'):.0f} V, U504 insulates",
    )
    recovery = (given("open_v") / r) * data("D503", "recovery_s") * 100e3
    b.row(
        "sense", "sense.recovery", "diodes turning off, 100 kHz of pulses, at most",
        f"{given('open_v'):.0f} V / {unit(r, 'ohm')} x {data('D503', 'recovery_s') * 1e9:.0f} ns x 100 kHz", recovery,
        unit(recovery, "A", 2),
    )
    # In off-time the sense voltage must not hold the lower comparator high, or the next rise is not seen.
    share20 = b.numbers["vth.share"] * given("high_share")
    gain = value("R222") / value("R223")
    vz = b.numbers["gap.vz"]
    falls = lambda u: ((vz + share20 * u / ratio) * (1 + gain) - LOGIC_V * gain - vz) * ratio
    # Comparators and divider share scale and reference: only the offset of U201A counts.
    seen = open_v(volts * (1 + tol), drop_open * 0.7) + error
    u = next(u for u in range(20, 301) if falls(u) > seen)
    b.row(
        "sense", "sense.least_u", "least U with the lower comparator low in off-time",
        f"its lower trip point lies above {seen:.1f} V", u, f"{u} V",
    )
    b.must("open reading, worst, over the contact threshold", least / threshold, low=1.5)
    b.must("reading with the electrode's lead broken, worst", broken + error, high=threshold * 0.75, name="V")
    b.must(
        "open reading with the workpiece's lead broken, worst", least + lost - nominal, low=threshold * 1.5, name="V",
    )
    b.must("reading of a 100 ohm contact, worst", b.numbers["sense.at_100"] + error, high=threshold, name="V")
    b.must("least open-circuit voltage with sense supply", u, high=given("open_least_v"), name="V")
    b.must("power of R505 and R506 at the continuous reverse voltage", swing**2 * r, high=2 * data("R505", "watts") * 0.7, name="W")
    b.must("current at the continuous reverse voltage", swing, high=value("F501"), name="A")
    b.must("current of F501, generator reversed, over its rating", reverse / value("F501"), low=3)
    b.must("voltage over one diode", given("open_v") + volts, high=data("D503", "volts") / 2, name="V")
    b.must("power of the sense supply", amps * volts, high=data("U504", "watts"), name="W")
