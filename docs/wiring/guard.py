"""Arithmetic of sheets 4 and 5 without the sense supply: contacts, generator, interlocks, live signal."""

import math

from book import short, unit
from components import LOGIC_V, PARTS, SUPPLY_V, data, given, label, value


def signals(b):
    volts, r = given("mains_contact_v"), value("R412") + value("R413")
    led = data("U407", "forward_v")
    amps = (volts - led) / r
    b.row(
        "signals", "contact.amps", "current of a safety contact", f"({volts:.0f} - {led}) V / (2 x {label('R412')})",
        amps, unit(amps, "A", 2),
    )
    heat = amps**2 * value("R412")
    b.row(
        "signals", "contact.heat", "power of R412",
        f"({unit(amps, 'A', 2)})^2 x {label('R412')}; rating {data('R412', 'watts')} W", heat, unit(heat, "W", 2),
    )
    delay = value("R413") * value("C402") * math.log(amps / data("U407", "off_a"))
    b.row(
        "signals", "contact.delay", "delay of the first edge",
        f"{label('R413')} x {label('C402')}F x ln({short(amps * 1e3, 2)} / {data('U407', 'off_a') * 1e3:.1f})", delay,
        unit(delay, "s", 2),
    )
    way = (delay + 5e-6) * given("fast_m_s")
    b.say("contact.way", way, unit(way, "m", 2))
    enable = given("generator_v") / value("R407")
    b.row(
        "signals", "enable.amps", "current of the enable through K0 and K2",
        f"{given('generator_v'):.0f} V / {label('R407')}", enable, unit(enable, "A", 2),
    )
    b.must("current through a safety contact", amps, low=2 * data("U407", "on_a"), high=20e-3, name="A")
    b.must("power of R412", heat, high=data("R412", "watts") / 2, name="W")
    b.must("current of the enable", enable, low=1e-3, high=data("U404", "drive_a"), name="A")
    gate = given("generator_v") * value("R409") / (value("R408") + value("R409"))
    b.row(
        "signals", "gate.high", "level of the gate at U409",
        f"{given('generator_v'):.0f} V x {label('R409')} / ({label('R408')} + {label('R409')})", gate, f"{gate:.1f} V",
    )
    b.must("level of the gate at U409", gate, low=0.75 * given("generator_v"), name="V")
    # Off-time.
    ratio = value("R411") / (value("R410") + value("R411"))
    gain = data("U406", "gain")
    full = SUPPLY_V["f405"] * ratio
    b.row(
        "signals", "off.full", "off-time, full scale",
        f"{SUPPLY_V['f405']} V x {label('R411')} / ({label('R410')} + {label('R411')}) "
        f"= {full:.2f} V into U405, x {gain}",
        full * gain,
        f"{full * gain:.2f} V = {full * gain / given('off_time_full_v') * given('off_time_full_s') * 1e6:.0f} us",
    )
    b.say("off.full_s", full * gain / given("off_time_full_v") * given("off_time_full_s"), "")
    own = given("off_time_own_v")
    b.row(
        "signals", "off.own", "off-time below which the generator has its own",
        f"{own} V / {given('off_time_full_v'):.0f} V x {given('off_time_full_s') * 1e6:.0f} us",
        own / given("off_time_full_v") * given("off_time_full_s"),
        f"{own / given('off_time_full_v') * given('off_time_full_s') * 1e6:.0f} us, {own / gain / ratio:.2f} V at PA4",
    )
    b.say("off.own_pin", own / gain / ratio, f"{own / gain / ratio:.2f} V")
    rest = given("dac_low_v") * ratio * gain
    b.row(
        "signals", "off.rest", "off-time output for no request",
        f"the buffered DAC does not go below {given('dac_low_v')} V", rest, f"{rest:.2f} V",
    )
    b.must("input of U405 at full scale", full, high=data("U405", "full_scale_v") * 1.005, name="V")
    b.must("off-time output for no request", rest, high=own, name="V")
    disc = SUPPLY_V["disc"] * value("R411") / (given("off_time_full_v") / gain) - value("R411")
    b.say("disc.r410", disc, "4.99 k")
    b.must("R410 for 3.0 V", disc, low=4.99e3 * 0.99, high=4.99e3 * 1.01, name="ohm")
    coil = volts / data("K2", "coil_ohm")
    b.row(
        "signals", "k2.amps", "coil current of K2, through all interlock contacts",
        f"{volts:.0f} V / {data('K2', 'coil_ohm'):.0f} ohm", coil, unit(coil, "A", 2),
    )
    b.say("k0.release", data("K0", "release_s"), f"{data('K0', 'release_s') * 1e3:.0f} ms")
    for ref, pull, what in (("R420", "R406", "U404"), ("R507", "R501", "U501")):
        high = LOGIC_V * value(pull) / (value(ref) + value(pull))
        b.row(
            "signals", f"{ref}.high", f"high level at {what}",
            f"{LOGIC_V} V x {label(pull)} / ({label(ref)} + {label(pull)})", high, f"{high:.1f} V",
        )
        b.must(f"high level at {what}", high, low=0.75 * LOGIC_V, name="V")
    b.row(
        "signals", "k2.release", "interlock open to no enable", "release of K2, its data sheet",
        data("K2", "release_s"), f"{data('K2', 'release_s') * 1e3:.0f} ms",
    )
    door = data("K3", "release_s") + data("K2", "release_s")
    b.row(
        "signals", "k3.release", "door open to no enable", "release of K3, then of K2, their data sheets",
        door, f"{door * 1e3:.0f} ms",
    )


def live(b):
    tick = given("tick_s")
    r, c = value("R504"), value("C501")
    nominal = r * c
    low = nominal * data("U501", "width_low") * (1 - PARTS["R504"].tolerance) * (1 - PARTS["C501"].tolerance)
    high = nominal * data("U501", "width_high") * (1 + PARTS["R504"].tolerance) * (1 + PARTS["C501"].tolerance)
    b.row(
        "live", "live.period", "rising edges of live", f"each second tick of {tick * 1e6:.0f} us", 2 * tick,
        unit(2 * tick, "s"),
    )
    b.row(
        "live", "live.width", "pulse of U501", f"R504 {label('R504')} x C501 {label('C501')}F", nominal,
        unit(nominal, "s"),
    )
    percent = (
        f"U501 {data('U501', 'width_low') * 100 - 100:.0f} .. +{data('U501', 'width_high') * 100 - 100:.0f} % (its data "
        f"sheet), R504 {PARTS['R504'].tolerance * 100:.0f} %, C501 {PARTS['C501'].tolerance * 100:.0f} %"
    )
    b.row("live", "live.least", "shortest", percent, low, unit(low, "s"))
    b.row("live", "live.most", "longest: stopped program to bridge and pulses off", "the same", high, unit(high, "s"))
    lost = int((low - 2 * tick) / tick)
    b.row(
        "live", "live.lost", "ticks that may be missed",
        f"({unit(low, 's')} - {unit(2 * tick, 's')}) / {tick * 1e6:.0f} us", lost, str(lost),
    )
    b.must("shortest pulse of the live signal", low, low=0.25e-3, name="s")
    b.must("longest pulse of the live signal", high, high=1e-3, name="s")
