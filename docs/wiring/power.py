"""Arithmetic of sheets 1 and 3: drive, motor current, bus voltage, counterbalance."""

import cmath
import math

from book import short, unit
from components import LOGIC_V, PARTS, SUPPLY_V, data, given, label, value


def drive(b):
    volts, ohm, k = given("bus_v"), given("coil_ohm"), given("force_n_a")
    stall = volts / ohm
    b.row(
        "drive", "drive.stall", "current at rest, at most", f"{volts:.0f} V / {ohm} ohm", stall,
        f"{stall:.2f} A, {stall * k:.0f} N",
    )
    back = k * given("fast_m_s")
    reversal = (volts + back) / ohm
    b.row(
        "drive", "drive.reversal", "current at reversal, at most",
        f"({volts:.0f} V + {k} V s/m x {given('fast_m_s')} m/s) / {ohm} ohm", reversal, f"{reversal:.2f} A",
    )
    tick = given("tick_s")
    ripple = volts * tick / given("coil_h") / 4
    b.row(
        "drive", "drive.ripple", "ripple, peak to peak, at 50 % duty",
        f"{volts:.0f} V x {tick * 1e6:.0f} us / {given('coil_h') * 1e3:.0f} mH / 4", ripple, unit(ripple, "A", 2),
    )
    switches = 2 * data("U303", "switch_ohm")
    heat = stall**2 * switches
    b.row(
        "drive", "drive.heat", "dissipation of U303, stalled",
        f"({stall:.2f} A)^2 x 2 x {data('U303', 'switch_ohm')} ohm", heat, f"{heat:.1f} W: heat sink or copper",
    )
    b.row(
        "drive", "drive.dead", "dead time", f"{data('U303', 'dead_s') * 1e6:.0f} us of {tick * 1e6:.0f} us",
        data("U303", "dead_s") / tick, f"{data('U303', 'dead_s') / tick * 100:.0f} % of duty around zero",
    )
    energy = given("heavy_kg") * given("fast_m_s") ** 2 / 2
    c = value("C301")
    least = c * (1 - PARTS["C301"].tolerance)
    lifted = math.sqrt(volts**2 + 2 * energy / least)
    b.row(
        "drive", "drive.brake_v", "braked head, C301 20 % low",
        f"{given('heavy_kg')} kg at {given('fast_m_s')} m/s returns {energy:.3f} J", lifted,
        f"{volts:.0f} V rises to {lifted:.1f} V; U303 ends at {data('U303', 'high_v'):.0f} V",
    )
    b.say("drive.energy", energy, f"{energy:.3f} J")
    b.say("drive.lifted", lifted, f"{lifted:.1f} V")
    store = c * (volts**2 - given("dead_bus_v") ** 2) / 2
    b.row(
        "drive", "drive.holdup", "supply hold-up",
        f"C301 from {volts:.0f} to {given('dead_bus_v'):.0f} V: {store:.1f} J "
        f"at {given('lift_a'):.0f} A in the coil, {given('lift_a') ** 2 * ohm:.1f} W",
        store / (given("lift_a") ** 2 * ohm), f"{store / (given('lift_a') ** 2 * ohm):.2f} s of lift",
    )
    b.row(
        "drive", "drive.bleed", "C301 through R301",
        f"{label('R301')} x {label('C301')}F; "
        f"({volts:.0f} V)^2 / {label('R301')} = {unit(volts**2 / value('R301'), 'W', 2)}",
        value("R301") * c, f"{value('R301') * c:.0f} s",
    )
    rise = value("R305") * value("C303") * math.log(LOGIC_V / (LOGIC_V - data("U303", "enable_v")))
    b.row(
        "drive", "drive.enable", "enable rises after",
        f"R305 {label('R305')}, C303 {label('C303')} to {data('U303', 'enable_v')} V; falls at once through D302", rise,
        unit(rise, "s", 1),
    )
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
    b.row(
        "motor", "motor.gain", "gain", f"{label('RS301')} x {data('U304', 'gain'):.0f}", per_amp, f"{per_amp:.2f} V/A",
    )
    b.row(
        "motor", "motor.amps_per_code", "scale", f"{supply} V / {codes} / {per_amp:.2f} V/A", scale["f405"],
        f"{unit(scale['f405'], 'A')} a code",
    )
    b.say("motor.amps_setting", scale["f405"], short(scale["f405"]))
    b.say("disc.motor.amps_per_code", scale["disc"], short(scale["disc"]))
    full = supply / 2 / per_amp
    b.row(
        "motor", "motor.range", "range of the converter", f"{supply / 2} V / {per_amp:.2f} V/A", full,
        f"+-{full:.1f} A",
    )
    usable = (supply / 2 - data("U304", "swing_v")) / per_amp
    peak = b.numbers["drive.reversal"] + b.numbers["drive.ripple"] / 2
    b.row(
        "motor", "motor.usable", "range of U304", f"({supply / 2} - {data('U304', 'swing_v')} V) / {per_amp:.2f} V/A",
        usable, f"+-{usable:.2f} A; reversal with half the ripple needs {peak:.2f} A",
    )
    heat = peak**2 * value("RS301")
    b.row(
        "motor", "motor.heat", "dissipation of RS301",
        f"({peak:.2f} A)^2 x {label('RS301')}; rating {data('RS301', 'watts'):.0f} W", heat, unit(heat, "W", 2),
    )
    moments = [given("sample_first_s") + i * (given("sample_last_s") - given("sample_first_s")) / 5 for i in range(6)]
    left = max(abs(ripple_error(d / 20, t)) for d in range(1, 20) for t in moments)
    raw = b.numbers["drive.ripple"] / 2
    b.row(
        "motor", "motor.ripple_error", "ripple left in a sample",
        f"sampled {given('sample_first_s') * 1e6:.0f} to {given('sample_last_s') * 1e6:.0f} us "
        "after the on-time begins, any duty",
        left, f"{unit(left, 'A', 2)}; without filter {unit(raw, 'A', 2)}, always too low",
    )
    b.must("usable range of motor current over its peak", usable / peak, low=1.1)
    b.must("ripple left in motor current", left, high=0.03, name="A")
    b.must("dissipation of RS301", heat, high=data("RS301", "watts") / 2, name="W")


def bus(b):
    supply, codes = SUPPLY_V["f405"], given("codes")
    ratio = (value("R309") + value("R310")) / value("R310")
    scale = {board: v / codes * ratio for board, v in SUPPLY_V.items()}
    b.row(
        "bus", "bus.ratio", "divider", f"({label('R309')} + {label('R310')}) / {label('R310')}", ratio,
        f"{ratio:.0f}:1",
    )
    b.row(
        "bus", "motor.bus_volts_per_code", "scale", f"{supply} V / {codes} x {ratio:.0f}", scale["f405"],
        f"{unit(scale['f405'], 'V')} a code",
    )
    b.say("bus.setting", scale["f405"], short(scale["f405"]))
    b.say("disc.motor.bus_volts_per_code", scale["disc"], short(scale["disc"]))
    full = supply * ratio
    b.row("bus", "bus.full", "full scale", f"{supply} V x {ratio:.0f}", full, f"{full:.1f} V")
    at = given("bus_v") / scale["f405"]
    b.row("bus", "bus.at_48", f"{given('bus_v'):.0f} V", "", at, f"code {at:.0f}")
    b.must("bus voltage at full scale", full, low=data("U303", "high_v") * 1.1, name="V")


EPSILON_0 = 8.854e-12


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
    b.must(
        "difference of counterbalance and weight against friction", rest, low=0.0, high=given("friction_n"), name="N",
    )
