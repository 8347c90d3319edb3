"""Arithmetic of sheet 2: gap voltage, filters, comparators, gap current."""

import itertools
import math

from book import short, unit
from components import LOGIC_V, PARTS, SUPPLY_V, data, given, label, value


def amplifier(plus, minus, supply=SUPPLY_V["f405"], legs=(0, 0), arms=(0, 0, 0, 0), zero=0.0, offset=0.0):
    """Output of U201A. `legs` and `arms` are relative errors of the two rows of resistors and of R211..R214.

    `None` for a lead is a broken one.
    """
    row = 5 * value("R201")
    r211, r212, r213, r214 = (value(f"R{211 + i}") * (1 + e) for i, e in enumerate(arms))
    vz = supply * value("R218") / (value("R217") + value("R218")) + zero

    def node(branches):
        """Voltage where conductances meet."""
        return sum(v / r for v, r in branches) / sum(1 / r for _, r in branches)

    branches = [(supply, r212), (vz, r214)]
    if plus is not None:
        branches.append((plus, row * (1 + legs[0])))
    v = node(branches) + offset
    current = (supply - v) / r211
    if minus is not None:
        current += (minus - v) / (row * (1 + legs[1]))
    return v - current * r213


def corners(count, tolerance):
    return itertools.product((-tolerance, tolerance), repeat=count)


def gap(b):
    supply = SUPPLY_V["f405"]
    codes = given("codes")
    arm, one = value("R213"), value("R201")
    row = 5 * one
    ratio = b.row("gap", "gap.ratio", "gain", f"{label('R213')} / (5 x {label('R201')})", row / arm,
                  f"1 / {short(row / arm, 4)}")
    b.say("gap.ratio_n", ratio, short(ratio, 4))
    b.say("gap.leg", row, unit(row, "ohm"))
    scale = {board: v / codes * ratio for board, v in SUPPLY_V.items()}
    b.row(
        "gap", "gap.volts_per_code", "scale", f"{supply} V / {codes} x {short(ratio, 4)}", scale["f405"],
        f"{short(scale['f405'], 4)} V a code",
    )
    b.say("gap.scale_n", scale["f405"], short(scale["f405"], 4))
    b.say("disc.gap.volts_per_code", scale["disc"], short(scale["disc"]))
    vz = supply * value("R218") / (value("R217") + value("R218"))
    zero = vz / supply * codes
    b.row(
        "gap", "gap.zero", "offset",
        f"{supply} V x {label('R218')} / ({label('R217')} + {label('R218')}) = {short(vz)} V", zero,
        f"code {short(zero, 4)}, whatever the supply is",
    )
    b.say("gap.zero_code", round(zero), str(round(zero)))
    b.say("gap.zero_n", zero, short(zero, 4))
    b.say("gap.vz", vz, f"{short(vz, 2)} V")
    low, high = -vz * ratio, (supply - vz) * ratio
    b.row(
        "gap", "gap.range", "range",
        f"(0 - {short(vz)}) x {short(ratio, 4)} .. ({supply} - {short(vz)}) x {short(ratio, 4)}", high,
        f"{low:.0f} .. +{high:.0f} V",
    )
    b.say("gap.low", low, f"{low:.0f} V".replace("-", "−"))
    b.say("gap.high", high, f"{high:.0f} V")
    tolerance = PARTS["R201"].tolerance
    base = amplifier(100.0, 0.0) - amplifier(0.0, 0.0)
    worst = max(
        abs((amplifier(100.0, 0.0, legs=c[:2], arms=c[2:]) - amplifier(0.0, 0.0, legs=c[:2], arms=c[2:])) / base - 1)
        for c in corners(6, tolerance)
    ) + 25e-6 * 20
    b.row(
        "gap", "gap.scale_error", "scale error", "corners of the 0.1 % resistors, 25 ppm over 20 K; then the regulator",
        worst,
        f"{worst * 100:.2f} %; with a {given('regulator') * 100:.0f} % regulator "
        f"{(worst + given('regulator')) * 100:.1f} %, calibrated away",
    )
    ideal = amplifier(0.0, 0.0)
    zeros = [amplifier(0.0, 0.0, arms=c) - ideal for c in corners(4, tolerance)]
    amp = data("U201", "offset_v")
    divider = vz * (1 - vz / supply) * 2 * PARTS["R217"].tolerance
    error = max(map(abs, zeros)) + 2 * amp + divider + amp
    squares = 4 * (max(map(abs, zeros)) / 4) ** 2 + (2 * amp) ** 2 + 2 * (divider / 2) ** 2 + amp**2
    rms = math.sqrt(squares / 3)
    error_codes = error / supply * codes
    b.row(
        "gap", "gap.offset_error", "offset error", "corners of R211..R214, R217, R218; both halves of U201",
        error * ratio,
        f"+-{error_codes:.1f} codes = {error * ratio:.2f} V worst, {rms * ratio:.2f} V rms; calibrated away",
    )
    b.say("gap.zero_volts", error * ratio, f"-{error * ratio:.1f}..{error * ratio:.1f} V")
    b.say("gap.zero_codes", error_codes, f"{math.floor(zero - error_codes)}..{math.ceil(zero + error_codes)}")
    both = 1 / (1 / value("R212") + 1 / value("R214"))
    share = both / (both + row)
    node = (supply + vz) / 2 * (1 - share)
    up, down = (supply - node) / share, node / share
    rejection = max(
        abs((amplifier(100, 100, legs=c[:2], arms=c[2:]) - amplifier(0, 0, legs=c[:2], arms=c[2:])) * ratio) / 100
        for c in corners(6, tolerance)
    )
    b.row(
        "gap", "gap.common", "common mode",
        f"R211, R212 lift both inputs to {node:.1f} V: GAP+ may lie {down:.0f} V below to {up:.0f} V above control 0 V",
        rejection, f"{rejection * 100:.2f} % of it appears, worst case",
    )
    each = high / 5
    b.row(
        "gap", "gap.resistor_v", "resistor voltage", f"{high:.0f} V / 5; rating {data('R201', 'volts'):.0f} V, 1206",
        each, f"{each:.0f} V",
    )
    power = high * high / row / 5
    b.row(
        "gap", "gap.resistor_w", "resistor power",
        f"({high:.0f} V)^2 / {row / 1e3:.0f} k / 5; rating {data('R201', 'watts')} W", power, unit(power, "W", 2),
    )
    fault = high / row
    b.row(
        "gap", "gap.fault_a", "fault current", f"{high:.0f} V / {row / 1e3:.0f} k", fault,
        f"{unit(fault, 'A', 2)} (limit for protective impedance 2 mA DC, IEC 61140)",
    )
    b.say("gap.fault_ma", fault, unit(fault, "A", 2))
    bandwidth = 1 / (2 * math.pi * arm * value("C201"))
    b.row(
        "gap", "gap.bandwidth", "bandwidth of the amplifier", f"1 / (2 pi x {label('R213')} x {label('C201')}F)",
        bandwidth, f"{unit(bandwidth, 'Hz', 2)}, delay {unit(arm * value('C201'), 's', 2)}",
    )
    for volts in (30, 50, 100, 300):
        b.say(f"gap.codes_{volts}", volts / scale["f405"], f"{volts / scale['f405']:.0f}")
        b.say(f"gap.at_{volts}", zero + volts / scale["f405"], f"{zero + volts / scale['f405']:.0f}")
    stray = 0.2e-12 * row
    b.say("gap.stray", stray, unit(stray, "s", 1))
    b.must("voltage of a divider resistor", each, high=data("R201", "volts"), name="V")
    b.must("power of a divider resistor", power, high=data("R201", "watts"), name="W")
    b.must("current through the protective impedance", fault, high=2e-3, name="A")
    b.must("gap voltage at full scale", high, low=given("open_v") * 1.1, name="V")


def corner(r, c):
    return 1 / (2 * math.pi * r * c)


def filters(b):
    for table, key, pin, r, c in (
        ("filters", "fixed", "PC0", "R215", "C203"),
        ("filters", "gated", "PC1", "R216", "C204"),
        ("filters", "current", "PC2", "R230", "C208"),
        ("filters", "motor", "PC3", "R308", "C306"),
    ):
        f, tau = corner(value(r), value(c)), value(r) * value(c)
        b.row(
            table, f"{key}.corner", pin, f"{r} {label(r)}, {c} {label(c)}", f, f"{unit(f, 'Hz')}, {unit(tau, 's', 2)}",
        )
        b.say(f"{key}.hz", f, unit(f, "Hz"))
        b.say(f"{key}.tau", tau, unit(tau, "s", 2))
    source = 1 / (1 / value("R309") + 1 / value("R310"))
    f = corner(source, value("C307"))
    b.row(
        "filters", "bus.corner", "PA3", f"R309 // R310 = {unit(source, 'ohm', 2)}, C307 {label('C307')}", f,
        f"{unit(f, 'Hz', 2)}, {unit(source * value('C307'), 's', 2)}",
    )
    b.say("bus.hz", f, unit(f, "Hz", 2))
    both = b.numbers["gated.tau"] + value("R213") * value("C201")
    left = math.exp(-given("blanking_s") / both)
    b.say("gated.left", left, f"{left * 100:.1f} %")
    b.say("gated.both", both, unit(both, "s", 2))
    rate = given("gap_rate_hz")
    through = 1 / math.hypot(1, rate / b.numbers["fixed.hz"])
    b.say("fixed.alias", through, f"{through * 100:.0f} %")
    fifth = 2 * 100 / (5 * math.pi)
    b.say("fixed.fifth", fifth, f"{fifth:.1f} V")
    b.say("fixed.beat", fifth * through, f"{fifth * through:.1f} V")
    b.say("fixed.beat_slow", 2 * 100 / (100 * math.pi) * through, f"{2 * 100 / (100 * math.pi) * through:.1f} V")
    b.must("step left in a gated sample after blanking", left, high=0.01)


def threshold_top(pot, r219):
    """Gap voltage that RV201 reaches at its upper end, times the upper share, above the offset."""
    supply = SUPPLY_V["f405"]
    vz = supply * value("R218") / (value("R217") + value("R218"))
    load = value("R220") + value("R221")
    loaded = pot * load / (pot + load)
    return (supply - vz) * loaded / (r219 + loaded)


def comparators(b):
    supply, ratio, vz = SUPPLY_V["f405"], b.numbers["gap.ratio"], b.numbers["gap.vz"]
    high, u = given("high_share"), given("example_v")
    load = value("R220") + value("R221")
    share = value("R221") / load
    b.row(
        "comparators", "vth.share", "lower over upper threshold",
        f"{label('R221')} / ({label('R220')} + {label('R221')})", share,
        f"{share * 100:.1f} % of the distance from the offset; 2/7 = {200 / 7:.1f} % is exact",
    )
    v70 = vz + high * u / ratio
    v20 = vz + share * high * u / ratio
    b.row(
        "comparators", "vth.70", f"VTH70 for U = {u:.0f} V", f"{short(vz)} V + {high} x {u:.0f} V / {short(ratio, 4)}",
        v70, f"{v70:.3f} V",
    )
    b.row(
        "comparators", "vth.20", f"VTH20 for U = {u:.0f} V",
        f"{short(vz)} V + {share:.3f} x {high} x {u:.0f} V / {short(ratio, 4)}", v20, f"{v20:.3f} V",
    )
    tol_pot, tol = PARTS["RV201"].tolerance, PARTS["R219"].tolerance
    top = threshold_top(value("RV201"), value("R219")) * ratio / high
    least = threshold_top(value("RV201") * (1 - tol_pot), value("R219") * (1 + tol)) * ratio / high
    loaded = value("RV201") * load / (value("RV201") + load)
    b.row(
        "comparators", "vth.top", "largest U that RV201 reaches",
        f"{label('RV201')} // ({label('R220')} + {label('R221')}) = {unit(loaded, 'ohm')} above R219 {label('R219')}: "
        f"{short(supply - vz)} V x {short(loaded / 1e3)} / {short((loaded + value('R219')) / 1e3)} "
        f"x {short(ratio, 4)} / {high}",
        top, f"{top:.0f} V; {least:.0f} V with RV201 {tol_pot * 100:.0f} % low",
    )
    b.say("vth.top_v", top, f"{top:.0f} V")
    hysteresis = LOGIC_V * value("R222") / value("R223")
    b.row(
        "comparators", "vth.hysteresis", "hysteresis", f"{LOGIC_V} V x {label('R222')} / {label('R223')}", hysteresis,
        f"{unit(hysteresis, 'V', 2)} = {hysteresis * ratio:.1f} V of gap voltage",
    )
    b.say("vth.hysteresis_mv", hysteresis, unit(hysteresis, "V", 2))
    b.say("vth.hysteresis_v", hysteresis * ratio, f"{hysteresis * ratio:.1f} V")
    b.say("vth.charge", math.log(0.8 / 0.3), f"{math.log(0.8 / 0.3):.2f}")
    b.must("largest U of the comparators, RV201 low", least, low=given("open_v"), name="V")
    b.must("share of the lower threshold", share * high, low=given("low_share") * 0.98, high=given("low_share") * 1.02)


def gap_current(b):
    supply, codes = SUPPLY_V["f405"], given("codes")
    shunt, gain = value("RS201") / 2, value("R228") / value("R226")
    b.row("current", "current.shunt", "shunt", f"2 x {label('RS201')} in parallel", shunt, unit(shunt, "ohm", 1))
    per_amp = shunt * gain
    b.row(
        "current", "current.gain", "gain", f"{label('R228')} / {label('R226')}", per_amp,
        f"{gain:.0f}: {unit(per_amp, 'V', 2)}/A",
    )
    scale = {board: v / codes / per_amp for board, v in SUPPLY_V.items()}
    b.row(
        "current", "gap.amps_per_code", "scale", f"{supply} V / {codes} / {unit(per_amp, 'V', 2)}", scale["f405"],
        f"{unit(scale['f405'], 'A')} a code",
    )
    b.say("disc.gap.amps_per_code", scale["disc"], short(scale["disc"]))
    b.row(
        "current", "current.range", "range", f"{supply / 2} V / {unit(per_amp, 'V', 2)}", supply / 2 / per_amp,
        f"+-{supply / 2 / per_amp:.0f} A",
    )

    def out(e226, e227, e228, e229, vm):
        r226, r227, r228, r229 = (value(f"R{226 + i}") * (1 + e) for i, e in enumerate((e226, e227, e228, e229)))
        return vm * r227 / (r227 + r229) * (r226 + r228) / r226

    middle = supply / 2
    arms = max(abs(out(*c, middle) - middle) for c in corners(4, PARTS["R226"].tolerance))
    error = arms + middle * PARTS["R231"].tolerance + data("U203", "offset_v") * (1 + gain + 1)
    in_codes = error / supply * codes
    b.row(
        "current", "current.zero_error", "zero error",
        f"corners of R226..R229, R231, R232 ({PARTS['R231'].tolerance * 100:g} %), U203", in_codes,
        f"{in_codes:.0f} codes = {in_codes * scale['f405']:.2f} A, calibrated away",
    )
    b.say("current.zero_codes", in_codes, f"{in_codes:.0f}")
    b.say("current.codes_1a", 1 / scale["f405"], f"{1 / scale['f405']:.0f}")
    heat = given("pulse_a") ** 2 * shunt * given("pulse_share")
    b.row(
        "current", "current.heat", "dissipation",
        f"({given('pulse_a'):.0f} A)^2 x {unit(shunt, 'ohm', 1)} x {given('pulse_share') * 100:.0f} %; "
        f"rating 2 x {data('RS201', 'watts'):.0f} W",
        heat, unit(heat, "W", 2),
    )
    lag = data("RS201", "henry") / value("RS201")
    b.row(
        "current", "current.lag", "inductance of the shunt",
        f"{data('RS201', 'henry') * 1e9:.0f} nH each (assumed) / {label('RS201')}", lag,
        f"{unit(lag, 's', 2)}: edges overshoot, the value after blanking is right",
    )
    b.must("dissipation of the gap shunt", heat, high=2 * data("RS201", "watts") * 0.8, name="W")
    b.must("range of gap current", supply / 2 / per_amp, low=given("pulse_a") * 1.2, name="A")
