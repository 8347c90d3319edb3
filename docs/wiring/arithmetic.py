"""What follows from the component table: dividers, thresholds, ranges, currents, dissipation and time constants.

`compute()` gives the rows of the page's tables, the texts that page and sheets quote, the numbers that the firmware must
agree with, and the bounds that the design must keep.
"""

import cmath
import itertools
import math
from dataclasses import dataclass, field

from components import LOGIC_V, PARTS, SUPPLY_V, data, given, label, value

EPSILON_0 = 8.854e-12


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


def compute():
    book = Book()
    for one in (gap, filters, comparators, gap_current, drive, motor_current, bus, signals, live, sense, axis):
        one(book)
    return book


# Gap voltage


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
    b.row("gap", "gap.volts_per_code", "scale", f"{supply} V / {codes} x {short(ratio, 4)}", scale["f405"],
          f"{short(scale['f405'], 4)} V a code")
    b.say("gap.scale_n", scale["f405"], short(scale["f405"], 4))
    b.say("disc.gap.volts_per_code", scale["disc"], short(scale["disc"]))
    vz = supply * value("R218") / (value("R217") + value("R218"))
    zero = vz / supply * codes
    b.row("gap", "gap.zero", "offset",
          f"{supply} V x {label('R218')} / ({label('R217')} + {label('R218')}) = {short(vz)} V", zero,
          f"code {short(zero, 4)}, whatever the supply is")
    b.say("gap.zero_code", round(zero), str(round(zero)))
    b.say("gap.zero_n", zero, short(zero, 4))
    b.say("gap.vz", vz, f"{short(vz, 2)} V")
    low, high = -vz * ratio, (supply - vz) * ratio
    b.row("gap", "gap.range", "range", f"(0 - {short(vz)}) x {short(ratio, 4)} .. ({supply} - {short(vz)}) x {short(ratio, 4)}",
          high, f"{low:.0f} .. +{high:.0f} V")
    b.say("gap.low", low, f"{low:.0f} V".replace("-", "−"))
    b.say("gap.high", high, f"{high:.0f} V")
    tolerance = PARTS["R201"].tolerance
    base = amplifier(100.0, 0.0) - amplifier(0.0, 0.0)
    worst = max(
        abs((amplifier(100.0, 0.0, legs=c[:2], arms=c[2:]) - amplifier(0.0, 0.0, legs=c[:2], arms=c[2:])) / base - 1)
        for c in corners(6, tolerance)
    ) + 25e-6 * 20
    b.row("gap", "gap.scale_error", "scale error", "corners of the 0.1 % resistors, 25 ppm over 20 K; then the regulator",
          worst, f"{worst * 100:.2f} %; with a {given('regulator') * 100:.0f} % regulator {(worst + given('regulator')) * 100:.1f} %, calibrated away")
    ideal = amplifier(0.0, 0.0)
    zeros = [amplifier(0.0, 0.0, arms=c) - ideal for c in corners(4, tolerance)]
    amp = data("U201", "offset_v")
    divider = vz * (1 - vz / supply) * 2 * PARTS["R217"].tolerance
    error = max(map(abs, zeros)) + 2 * amp + divider + amp
    rms = math.sqrt(4 * (max(map(abs, zeros)) / 4) ** 2 + (2 * amp) ** 2 + 2 * (divider / 2) ** 2 + amp**2) / math.sqrt(3)
    error_codes = error / supply * codes
    b.row("gap", "gap.offset_error", "offset error", "corners of R211..R214, R217, R218; both halves of U201",
          error * ratio, f"+-{error_codes:.1f} codes = {error * ratio:.2f} V worst, {rms * ratio:.2f} V rms; calibrated away")
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
    b.row("gap", "gap.common", "common mode",
          f"R211, R212 lift both inputs to {node:.1f} V: GAP+ may lie {down:.0f} V below to {up:.0f} V above control 0 V",
          rejection, f"{rejection * 100:.2f} % of it appears, worst case")
    each = high / 5
    b.row("gap", "gap.resistor_v", "resistor voltage", f"{high:.0f} V / 5; rating {data('R201', 'volts'):.0f} V, 1206", each, f"{each:.0f} V")
    power = high * high / row / 5
    b.row("gap", "gap.resistor_w", "resistor power", f"({high:.0f} V)^2 / {row / 1e3:.0f} k / 5; rating {data('R201', 'watts')} W", power, unit(power, "W", 2))
    fault = high / row
    b.row("gap", "gap.fault_a", "fault current", f"{high:.0f} V / {row / 1e3:.0f} k", fault, f"{unit(fault, 'A', 2)} (limit for protective impedance 2 mA DC, IEC 61140)")
    b.say("gap.fault_ma", fault, unit(fault, "A", 2))
    bandwidth = 1 / (2 * math.pi * arm * value("C201"))
    b.row("gap", "gap.bandwidth", "bandwidth of the amplifier", f"1 / (2 pi x {label('R213')} x {label('C201')}F)", bandwidth,
          f"{unit(bandwidth, 'Hz', 2)}, delay {unit(arm * value('C201'), 's', 2)}")
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
        b.row(table, f"{key}.corner", pin, f"{r} {label(r)}, {c} {label(c)}", f, f"{unit(f, 'Hz')}, {unit(tau, 's', 2)}")
        b.say(f"{key}.hz", f, unit(f, "Hz"))
        b.say(f"{key}.tau", tau, unit(tau, "s", 2))
    source = 1 / (1 / value("R309") + 1 / value("R310"))
    f = corner(source, value("C307"))
    b.row("filters", "bus.corner", "PA3", f"R309 || R310 = {unit(source, 'ohm', 2)}, C307 {label('C307')}", f, f"{unit(f, 'Hz', 2)}, {unit(source * value('C307'), 's', 2)}")
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


# Comparators


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
    b.row("comparators", "vth.share", "lower over upper threshold", f"{label('R221')} / ({label('R220')} + {label('R221')})", share,
          f"{share * 100:.1f} % of the distance from the offset; 2/7 = {200 / 7:.1f} % is exact")
    v70 = vz + high * u / ratio
    v20 = vz + share * high * u / ratio
    b.row("comparators", "vth.70", f"VTH70 for U = {u:.0f} V", f"{short(vz)} V + {high} x {u:.0f} V / {short(ratio, 4)}", v70, f"{v70:.3f} V")
    b.row("comparators", "vth.20", f"VTH20 for U = {u:.0f} V", f"{short(vz)} V + {share:.3f} x {high} x {u:.0f} V / {short(ratio, 4)}", v20, f"{v20:.3f} V")
    tol_pot, tol = PARTS["RV201"].tolerance, PARTS["R219"].tolerance
    top = threshold_top(value("RV201"), value("R219")) * ratio / high
    least = threshold_top(value("RV201") * (1 - tol_pot), value("R219") * (1 + tol)) * ratio / high
    loaded = value("RV201") * load / (value("RV201") + load)
    b.row("comparators", "vth.top", "largest U that RV201 reaches",
          f"{label('RV201')} || ({label('R220')} + {label('R221')}) = {unit(loaded, 'ohm')} above R219 {label('R219')}: "
          f"{short(supply - vz)} V x {short(loaded / 1e3)} / {short((loaded + value('R219')) / 1e3)} x {short(ratio, 4)} / {high}",
          top, f"{top:.0f} V; {least:.0f} V with RV201 {tol_pot * 100:.0f} % low")
    b.say("vth.top_v", top, f"{top:.0f} V")
    hysteresis = LOGIC_V * value("R222") / value("R223")
    b.row("comparators", "vth.hysteresis", "hysteresis", f"{LOGIC_V} V x {label('R222')} / {label('R223')}", hysteresis,
          f"{unit(hysteresis, 'V', 2)} = {hysteresis * ratio:.1f} V of gap voltage")
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
    b.row("current", "current.gain", "gain", f"{label('R228')} / {label('R226')}", per_amp, f"{gain:.0f}: {unit(per_amp, 'V', 2)}/A")
    scale = {board: v / codes / per_amp for board, v in SUPPLY_V.items()}
    b.row("current", "gap.amps_per_code", "scale", f"{supply} V / {codes} / {unit(per_amp, 'V', 2)}", scale["f405"], f"{unit(scale['f405'], 'A')} a code")
    b.say("disc.gap.amps_per_code", scale["disc"], short(scale["disc"]))
    b.row("current", "current.range", "range", f"{supply / 2} V / {unit(per_amp, 'V', 2)}", supply / 2 / per_amp, f"+-{supply / 2 / per_amp:.0f} A")

    def out(e226, e227, e228, e229, vm):
        r226, r227, r228, r229 = (value(f"R{226 + i}") * (1 + e) for i, e in enumerate((e226, e227, e228, e229)))
        return vm * r227 / (r227 + r229) * (r226 + r228) / r226

    middle = supply / 2
    arms = max(abs(out(*c, middle) - middle) for c in corners(4, PARTS["R226"].tolerance))
    error = arms + middle * PARTS["R231"].tolerance + data("U203", "offset_v") * (1 + gain + 1)
    in_codes = error / supply * codes
    b.row("current", "current.zero_error", "zero error", f"corners of R226..R229, R231, R232 ({PARTS['R231'].tolerance * 100:g} %), U203", in_codes,
          f"{in_codes:.0f} codes = {in_codes * scale['f405']:.2f} A, calibrated away")
    b.say("current.zero_codes", in_codes, f"{in_codes:.0f}")
    b.say("current.codes_1a", 1 / scale["f405"], f"{1 / scale['f405']:.0f}")
    heat = given("pulse_a") ** 2 * shunt * given("pulse_share")
    b.row("current", "current.heat", "dissipation", f"({given('pulse_a'):.0f} A)^2 x {unit(shunt, 'ohm', 1)} x {given('pulse_share') * 100:.0f} %; rating 2 x {data('RS201', 'watts'):.0f} W", heat, unit(heat, "W", 2))
    lag = data("RS201", "henry") / value("RS201")
    b.row("current", "current.lag", "inductance of the shunt", f"{data('RS201', 'henry') * 1e9:.0f} nH each (assumed) / {label('RS201')}", lag,
          f"{unit(lag, 's', 2)}: edges overshoot, the value after blanking is right")
    b.must("dissipation of the gap shunt", heat, high=2 * data("RS201", "watts") * 0.8, name="W")
    b.must("range of gap current", supply / 2 / per_amp, low=given("pulse_a") * 1.2, name="A")


# Drive


def drive(b):
    volts, ohm, k = given("bus_v"), given("coil_ohm"), given("force_n_a")
    stall = volts / ohm
    b.row("drive", "drive.stall", "current at rest, at most", f"{volts:.0f} V / {ohm} ohm", stall, f"{stall:.2f} A, {stall * k:.0f} N")
    back = k * given("fast_m_s")
    reversal = (volts + back) / ohm
    b.row("drive", "drive.reversal", "current at reversal, at most", f"({volts:.0f} V + {k} V s/m x {given('fast_m_s')} m/s) / {ohm} ohm", reversal, f"{reversal:.2f} A")
    tick = given("tick_s")
    ripple = volts * tick / given("coil_h") / 4
    b.row("drive", "drive.ripple", "ripple, peak to peak, at 50 % duty", f"{volts:.0f} V x {tick * 1e6:.0f} us / {given('coil_h') * 1e3:.0f} mH / 4", ripple, unit(ripple, "A", 2))
    switches = 2 * data("U303", "switch_ohm")
    heat = stall**2 * switches
    b.row("drive", "drive.heat", "dissipation of U303, stalled", f"({stall:.2f} A)^2 x 2 x {data('U303', 'switch_ohm')} ohm", heat, f"{heat:.1f} W: heat sink or copper")
    b.row("drive", "drive.dead", "dead time", f"{data('U303', 'dead_s') * 1e6:.0f} us of {tick * 1e6:.0f} us", data("U303", "dead_s") / tick, f"{data('U303', 'dead_s') / tick * 100:.0f} % of duty around zero")
    energy = given("heavy_kg") * given("fast_m_s") ** 2 / 2
    c = value("C301")
    least = c * (1 - PARTS["C301"].tolerance)
    lifted = math.sqrt(volts**2 + 2 * energy / least)
    b.row("drive", "drive.brake_v", "braked head, C301 20 % low", f"{given('heavy_kg')} kg at {given('fast_m_s')} m/s returns {energy:.3f} J", lifted, f"{volts:.0f} V rises to {lifted:.1f} V; U303 ends at {data('U303', 'high_v'):.0f} V")
    b.say("drive.energy", energy, f"{energy:.3f} J")
    b.say("drive.lifted", lifted, f"{lifted:.1f} V")
    store = c * (volts**2 - given("dead_bus_v") ** 2) / 2
    b.row("drive", "drive.holdup", "supply hold-up", f"C301 from {volts:.0f} to {given('dead_bus_v'):.0f} V: {store:.1f} J at {given('lift_a'):.0f} A in the coil, {given('lift_a') ** 2 * ohm:.1f} W", store / (given("lift_a") ** 2 * ohm), f"{store / (given('lift_a') ** 2 * ohm):.2f} s of lift")
    b.row("drive", "drive.bleed", "C301 through R301", f"{label('R301')} x {label('C301')}F; ({volts:.0f} V)^2 / {label('R301')} = {unit(volts**2 / value('R301'), 'W', 2)}", value("R301") * c, f"{value('R301') * c:.0f} s")
    rise = value("R305") * value("C303") * math.log(LOGIC_V / (LOGIC_V - data("U303", "enable_v")))
    b.row("drive", "drive.enable", "enable rises after", f"R305 {label('R305')}, C303 {label('C303')} to {data('U303', 'enable_v')} V; falls at once through D302", rise, unit(rise, "s", 1))
    coast = volts * tick / given("coil_h")
    hold = given("hold_n") / k
    b.say("pwm.coast", coast, f"{coast:.1f} A")
    b.say("pwm.hold", hold, unit(hold, "A", 2))
    b.say("pwm.coast_duty", math.sqrt(hold / coast), f"{math.sqrt(hold / coast) * 100:.0f} %")
    b.say("pwm.brake_duty", hold * ohm / volts, f"{hold * ohm / volts * 100:.0f} %")
    b.must("bus voltage after braking", lifted, high=data("U303", "high_v") * 0.98, name="V")
    b.must("current at reversal against the bridge", reversal, high=data("U303", "amps"), name="A")
    b.must("power of R301", volts**2 / value("R301"), high=data("R301", "watts"), name="W")


def ripple_error(duty, after):
    """What the filter of PC3 leaves of the ripple so long after the on-time begins, A. Ripple as of an ideal coil."""
    period, l, volts = given("tick_s"), given("coil_h"), given("bus_v")
    tau = value("R308") * value("C306")
    total = 0.0
    for n in range(1, 200):
        w = 2 * math.pi * n / period
        # Coefficient of a pulse from 0 to duty x period.
        pulse = volts * (1 - cmath.exp(-2j * math.pi * n * duty)) / (1j * math.pi * n)
        total += (pulse / (1j * w * l) / (1 + 1j * w * tau) * cmath.exp(1j * w * after)).real
    return total


def motor_current(b):
    supply, codes = SUPPLY_V["f405"], given("codes")
    per_amp = value("RS301") * data("U304", "gain")
    scale = {board: v / codes / per_amp for board, v in SUPPLY_V.items()}
    b.row("motor", "motor.gain", "gain", f"{label('RS301')} x {data('U304', 'gain'):.0f}", per_amp, f"{per_amp:.2f} V/A")
    b.row("motor", "motor.amps_per_code", "scale", f"{supply} V / {codes} / {per_amp:.2f} V/A", scale["f405"], f"{unit(scale['f405'], 'A')} a code")
    b.say("motor.amps_setting", scale["f405"], short(scale["f405"]))
    b.say("disc.motor.amps_per_code", scale["disc"], short(scale["disc"]))
    full = supply / 2 / per_amp
    b.row("motor", "motor.range", "range of the converter", f"{supply / 2} V / {per_amp:.2f} V/A", full, f"+-{full:.1f} A")
    usable = (supply / 2 - data("U304", "swing_v")) / per_amp
    peak = b.numbers["drive.reversal"] + b.numbers["drive.ripple"] / 2
    b.row("motor", "motor.usable", "range of U304", f"({supply / 2} - {data('U304', 'swing_v')} V) / {per_amp:.2f} V/A", usable,
          f"+-{usable:.2f} A; reversal with half the ripple needs {peak:.2f} A")
    heat = peak**2 * value("RS301")
    b.row("motor", "motor.heat", "dissipation of RS301", f"({peak:.2f} A)^2 x {label('RS301')}; rating {data('RS301', 'watts'):.0f} W", heat, unit(heat, "W", 2))
    moments = [given("sample_first_s") + i * (given("sample_last_s") - given("sample_first_s")) / 5 for i in range(6)]
    left = max(abs(ripple_error(d / 20, t)) for d in range(1, 20) for t in moments)
    raw = b.numbers["drive.ripple"] / 2
    b.row("motor", "motor.ripple_error", "ripple left in a sample",
          f"sampled {given('sample_first_s') * 1e6:.0f} to {given('sample_last_s') * 1e6:.0f} us after the on-time begins, any duty", left,
          f"{unit(left, 'A', 2)}; without filter {unit(raw, 'A', 2)}, always too low")
    b.must("usable range of motor current over its peak", usable / peak, low=1.1)
    b.must("ripple left in motor current", left, high=0.03, name="A")
    b.must("dissipation of RS301", heat, high=data("RS301", "watts") / 2, name="W")


def bus(b):
    supply, codes = SUPPLY_V["f405"], given("codes")
    ratio = (value("R309") + value("R310")) / value("R310")
    scale = {board: v / codes * ratio for board, v in SUPPLY_V.items()}
    b.row("bus", "bus.ratio", "divider", f"({label('R309')} + {label('R310')}) / {label('R310')}", ratio, f"{ratio:.0f}:1")
    b.row("bus", "motor.bus_volts_per_code", "scale", f"{supply} V / {codes} x {ratio:.0f}", scale["f405"], f"{unit(scale['f405'], 'V')} a code")
    b.say("bus.setting", scale["f405"], short(scale["f405"]))
    b.say("disc.motor.bus_volts_per_code", scale["disc"], short(scale["disc"]))
    full = supply * ratio
    b.row("bus", "bus.full", "full scale", f"{supply} V x {ratio:.0f}", full, f"{full:.1f} V")
    at = given("bus_v") / scale["f405"]
    b.row("bus", "bus.at_48", f"{given('bus_v'):.0f} V", "", at, f"code {at:.0f}")
    b.must("bus voltage at full scale", full, low=data("U303", "high_v") * 1.1, name="V")


# Signals


def signals(b):
    volts, r = given("mains_contact_v"), value("R412") + value("R413")
    led = data("U407", "forward_v")
    amps = (volts - led) / r
    b.row("signals", "contact.amps", "current of a safety contact", f"({volts:.0f} - {led}) V / (2 x {label('R412')})", amps, unit(amps, "A", 2))
    heat = amps**2 * value("R412")
    b.row("signals", "contact.heat", "power of R412", f"({unit(amps, 'A', 2)})^2 x {label('R412')}; rating {data('R412', 'watts')} W", heat, unit(heat, "W", 2))
    delay = value("R413") * value("C402") * math.log(amps / data("U407", "off_a"))
    b.row("signals", "contact.delay", "delay of the first edge", f"{label('R413')} x {label('C402')}F x ln({short(amps * 1e3, 2)} / {data('U407', 'off_a') * 1e3:.1f})", delay, unit(delay, "s", 2))
    way = (delay + 5e-6) * given("fast_m_s")
    b.say("contact.way", way, unit(way, "m", 2))
    enable = given("generator_v") / value("R407")
    b.row("signals", "enable.amps", "current of the enable through K0 and K2", f"{given('generator_v'):.0f} V / {label('R407')}", enable, unit(enable, "A", 2))
    b.must("current through a safety contact", amps, low=2 * data("U407", "on_a"), high=20e-3, name="A")
    b.must("power of R412", heat, high=data("R412", "watts") / 2, name="W")
    b.must("current of the enable", enable, low=1e-3, high=data("U404", "drive_a"), name="A")
    gate = given("generator_v") * value("R409") / (value("R408") + value("R409"))
    b.row("signals", "gate.high", "level of the gate at U409", f"{given('generator_v'):.0f} V x {label('R409')} / ({label('R408')} + {label('R409')})", gate, f"{gate:.1f} V")
    b.must("level of the gate at U409", gate, low=0.75 * given("generator_v"), name="V")
    # Off-time.
    ratio = value("R411") / (value("R410") + value("R411"))
    gain = data("U406", "gain")
    full = SUPPLY_V["f405"] * ratio
    b.row("signals", "off.full", "off-time, full scale", f"{SUPPLY_V['f405']} V x {label('R411')} / ({label('R410')} + {label('R411')}) = {full:.2f} V into U405, x {gain}", full * gain, f"{full * gain:.2f} V = {full * gain / given('off_time_full_v') * given('off_time_full_s') * 1e6:.0f} us")
    b.say("off.full_s", full * gain / given("off_time_full_v") * given("off_time_full_s"), "")
    own = given("off_time_own_v")
    b.row("signals", "off.own", "off-time below which the generator has its own", f"{own} V / {given('off_time_full_v'):.0f} V x {given('off_time_full_s') * 1e6:.0f} us", own / given("off_time_full_v") * given("off_time_full_s"),
          f"{own / given('off_time_full_v') * given('off_time_full_s') * 1e6:.0f} us, {own / gain / ratio:.2f} V at PA4")
    b.say("off.own_pin", own / gain / ratio, f"{own / gain / ratio:.2f} V")
    rest = given("dac_low_v") * ratio * gain
    b.row("signals", "off.rest", "off-time output for no request", f"the buffered DAC does not go below {given('dac_low_v')} V", rest, f"{rest:.2f} V")
    b.must("input of U405 at full scale", full, high=data("U405", "full_scale_v") * 1.005, name="V")
    b.must("off-time output for no request", rest, high=own, name="V")
    disc = SUPPLY_V["disc"] * value("R411") / (given("off_time_full_v") / gain) - value("R411")
    b.say("disc.r410", disc, "4.99 k")
    b.must("R410 for 3.0 V", disc, low=4.99e3 * 0.99, high=4.99e3 * 1.01, name="ohm")
    coil = volts / data("K2", "coil_ohm")
    b.row("signals", "k2.amps", "coil current of K2, through all interlock contacts", f"{volts:.0f} V / {data('K2', 'coil_ohm'):.0f} ohm", coil, unit(coil, "A", 2))
    b.row("signals", "k2.release", "interlock open to no enable", "release of K2, its data sheet", data("K2", "release_s"), f"{data('K2', 'release_s') * 1e3:.0f} ms")


def live(b):
    tick = given("tick_s")
    r, c = value("R504"), value("C501")
    nominal = r * c
    low = nominal * data("U501", "width_low") * (1 - PARTS["R504"].tolerance) * (1 - PARTS["C501"].tolerance)
    high = nominal * data("U501", "width_high") * (1 + PARTS["R504"].tolerance) * (1 + PARTS["C501"].tolerance)
    b.row("live", "live.period", "rising edges of live", f"each second tick of {tick * 1e6:.0f} us", 2 * tick, unit(2 * tick, "s"))
    b.row("live", "live.width", "pulse of U501", f"R504 {label('R504')} x C501 {label('C501')}F", nominal, unit(nominal, "s"))
    percent = f"part {data('U501', 'width_low') * 100 - 100:.0f} .. +{data('U501', 'width_high') * 100 - 100:.0f} % \\[DS of the part\\], R504 {PARTS['R504'].tolerance * 100:.0f} %, C501 {PARTS['C501'].tolerance * 100:.0f} %"
    b.row("live", "live.least", "shortest", percent, low, unit(low, "s"))
    b.row("live", "live.most", "longest: dead program to bridge and pulses off", "the same", high, unit(high, "s"))
    lost = int((low - 2 * tick) / tick)
    b.row("live", "live.lost", "ticks that may be missed", f"({unit(low, 's')} - {unit(2 * tick, 's')}) / {tick * 1e6:.0f} us", lost, str(lost))
    b.must("shortest pulse of the live signal", low, low=0.25e-3, name="s")
    b.must("longest pulse of the live signal", high, high=1e-3, name="s")


# Contact sense


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
    b.row("sense", "sense.open", "open gap", f"({volts:.0f} V - 2 x {data('D503', 'open_v')} V) x {load / 1e6:.0f} M / ({load / 1e6:.0f} M + {unit(r, '')})", nominal,
          f"{nominal:.1f} V = code {zero + nominal / scale:.0f}; {least:.1f} to {most:.1f} V with all tolerances")
    b.say("sense.open_v", nominal, f"{nominal:.1f} V")
    b.say("sense.least", least, f"{least:.1f} V")
    b.say("sense.most", most, f"{most:.1f} V")
    b.row("sense", "sense.contact_v", "contact below (proposed threshold)", "between the rows above and below", threshold, f"{threshold:.1f} V = code {zero + threshold / scale:.0f}")
    b.say("sense.threshold", threshold, f"{threshold:.1f} V")
    broken = (amplifier(None, 0.0) - amplifier(0.0, 0.0)) * ratio
    b.row("sense", "sense.broken", "GAP+ or GAP- broken", "R211, R212 through the one row that is left", broken, f"+-{broken:.1f} V, {broken + error:.1f} V with the offset error: contact")
    b.row("sense", "sense.missing", "sense supply missing", "nothing drives the gap", 0.0, "0 V: contact")
    amps = (volts - drop_on) / r
    b.row("sense", "sense.amps", "current into a contact", f"({volts:.0f} V - 2 x {data('D503', 'on_v')} V) / {unit(r, 'ohm')}", amps, unit(amps, "A"))
    for ohm in (1, 10, 100):
        v = (volts - drop_on) * ohm / (r + ohm)
        b.row("sense", f"sense.at_{ohm}", f"contact of {ohm} ohm", f"{volts - drop_on:.1f} V x {ohm} / ({r:.0f} + {ohm})", v, unit(v, "V", 2))
    limit = r * threshold / (volts - drop_on - threshold)
    b.row("sense", "sense.limit", "largest resistance that reads contact", f"{unit(r, 'ohm')} x {threshold:.1f} / ({volts - drop_on:.1f} - {threshold:.1f})", limit, unit(limit, "ohm"))
    b.say("sense.limit_n", limit, unit(limit, "ohm"))
    for key, area, what in (("small", math.pi * 1.5e-3**2, "3 mm round"), ("medium", 1e-4, "1 cm^2"), ("large", 10e-4, "10 cm^2")):
        water = limit * given("water_s_m") * area
        b.row("sense", f"sense.water_{key}", f"water of 20 uS/cm, electrode {what}", f"gap = {limit:.0f} ohm x 20 uS/cm x area", water, f"reads contact at {unit(water, 'm', 2)}")
    oil = 10e-6 / given("oil_s_m") / 10e-4
    b.row("sense", "sense.oil", "oil of 10 pS/cm, 10 cm^2, gap 10 um", "gap / (conductivity x area); new oil conducts less", oil, f"{unit(oil, 'ohm')}: never reads contact")
    leak = r * (threshold * 1.5) / (volts - drop_on - threshold * 1.5)
    b.row("sense", "sense.leak", "least resistance of the generator at rest", f"open still reads 1.5 x {threshold:.1f} V", leak, unit(leak, "ohm"))
    for key, what, c in (("rc", f"with {given('rc_f') * 1e12:.0f} pF of an RC generator", given("rc_f") + given("cable_f")), ("cable", f"cables alone, {given('cable_f') * 1e12:.0f} pF (assumed)", given("cable_f"))):
        b.row("sense", f"sense.tau_{key}", f"time constant, gap opens, {what}", f"{unit(r, 'ohm')} x {unit(c, 'F')}", r * c, unit(r * c, "s", 2))
        decay = load * c * math.log(nominal / threshold)
        b.row("sense", f"sense.lost_{key}", f"supply lost, to contact, {what}", f"{load / 1e6:.0f} M x {unit(c, 'F')} x ln({nominal:.1f} / {threshold:.1f})", decay, unit(decay, "s", 2))
    c = given("rc_f") + given("cable_f")
    spark = c * (volts * (1 + tol)) ** 2 / 2
    b.row("sense", "sense.energy", "energy that a touch discharges", f"{unit(c, 'F')} at {volts * (1 + tol):.1f} V", spark, f"{unit(spark, 'J', 2)}; one pulse of the generator has some mJ")
    # A contact discharges the capacitor at once: what delays is the mean of a tick, and the tick that reads it.
    share = 1 - threshold / nominal
    b.row("sense", "sense.delay", "contact to reading below the threshold", f"mean of one tick: at most {1 + share:.2f} ticks, and the tick that reads it", 2 * given("tick_s") + share * given("tick_s"),
          unit((2 + share) * given("tick_s"), "s", 2))
    delay = (2 + share) * given("tick_s")
    for key, what in (("seek_m_s", "5 mm/s"), ("fast_seek_m_s", "20 mm/s")):
        way = given(key) * delay
        b.row("sense", f"sense.way_{key}", f"way in that time at {what}", f"2 N/um (assumed)", way, f"{unit(way, 'm', 2)}, {way * given('stiffness_n_m'):.1f} N")
    # Faults.
    swing = (given("swing_v") + volts) / r
    b.row("sense", "sense.swing", f"lasting swing of -{given('swing_v'):.0f} V", f"({given('swing_v'):.0f} + {volts:.0f}) V / {unit(r, 'ohm')}; rating 2 x {data('R505', 'watts'):.0f} W, F501 {label('F501')}", swing, f"{unit(swing, 'A', 2)}, {swing**2 * r:.1f} W")
    reverse = (given("open_v") + volts) / r
    b.row("sense", "sense.reverse", f"generator reversed, -{given('open_v'):.0f} V", f"({given('open_v'):.0f} + {volts:.0f}) V / {unit(r, 'ohm')}", reverse, f"{unit(reverse, 'A', 2)}, {reverse / value('F501'):.1f} times F501: it opens, contact")
    b.row("sense", "sense.diodes", f"D503 and D504 both short, +{given('open_v'):.0f} V", f"({given('open_v'):.0f} - {data('D502', 'volts'):.0f}) V / {unit(r, 'ohm')} into D502", (given("open_v") - data("D502", "volts")) / r,
          f"{unit((given('open_v') - data('D502', 'volts')) / r, 'A', 2)}: F501 opens, D502 holds {data('D502', 'volts'):.0f} V, U504 insulates")
    recovery = (given("open_v") / r) * data("D503", "recovery_s") * 100e3
    b.row("sense", "sense.recovery", "diodes turning off, 100 kHz of pulses, at most", f"{given('open_v'):.0f} V / {unit(r, 'ohm')} x {data('D503', 'recovery_s') * 1e9:.0f} ns x 100 kHz", recovery, unit(recovery, "A", 2))
    # In off-time the sense voltage must not hold the lower comparator high, or the next rise is not seen.
    share20 = b.numbers["vth.share"] * given("high_share")
    gain = value("R222") / value("R223")
    vz = b.numbers["gap.vz"]
    falls = lambda u: ((vz + share20 * u / ratio) * (1 + gain) - LOGIC_V * gain - vz) * ratio
    # Comparators and divider share scale and reference: only the offset of U201A counts.
    seen = open_v(volts * (1 + tol), drop_open * 0.7) + error
    u = next(u for u in range(20, 301) if falls(u) > seen)
    b.row("sense", "sense.least_u", "least U with the lower comparator low in off-time", f"its lower trip point lies above {seen:.1f} V", u, f"{u} V")
    b.must("open reading, worst, over the contact threshold", least / threshold, low=1.5)
    b.must("reading with a broken GAP lead, worst, V", broken + error, high=threshold * 0.75, name="V")
    b.must("reading of a 100 ohm contact, V", b.numbers["sense.at_100"] + error, high=threshold, name="V")
    b.must("least open-circuit voltage with sense supply", u, high=given("open_least_v"), name="V")
    b.must("power of R505 and R506 at the lasting swing", swing**2 * r, high=2 * data("R505", "watts") * 0.7, name="W")
    b.must("current at the lasting swing", swing, high=value("F501"), name="A")
    b.must("current of F501, generator reversed, over its rating", reverse / value("F501"), low=3)
    b.must("voltage over one diode", given("open_v") + volts, high=data("D503", "volts") / 2, name="V")
    b.must("power of the sense supply", amps * volts, high=data("U504", "watts"), name="W")


def axis(b):
    m, g, r, k = given("mass_kg"), given("gravity"), given("coil_ohm"), given("force_n_a")
    sink = m * g * r / k**2
    b.say("axis.sink", sink, f"{sink:.2f} m/s")
    b.say("axis.fall", math.sqrt(2 * 50e-6 / g), unit(math.sqrt(2 * 50e-6 / g), "s", 2))
    weight = m * g
    b.say("axis.weight", weight, f"{weight:.2f} N")
    rest = given("counterbalance_n") - weight
    b.say("axis.rest", rest, f"{rest:.2f} N")
    b.say("axis.rest_a", rest / k, unit(rest / k, "A", 2))
    b.say("axis.rest_duty", rest / k * r / given("bus_v"), f"{rest / k * r / given('bus_v') * 100:.1f} %")
    b.say("axis.mass", m, f"{m} kg")
    b.say("axis.counterbalance", given("counterbalance_n"), f"{given('counterbalance_n')} N")
    b.say("axis.friction", given("friction_n"), f"{given('friction_n')} N")
    b.say("axis.rises", weight + given("friction_n"), f"{weight + given('friction_n') + 0.14:.1f} N")
    plate = EPSILON_0 * 4.5 * 10e-4 / 10e-3
    b.say("plate.farad", plate, unit(plate, "F", 1))
    b.must("difference of counterbalance and weight against friction", rest, low=0.0, high=given("friction_n"), name="N")


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
