"""The one table of the wiring: every part with its value and rating, and what the arithmetic takes from elsewhere.

Sheets take their labels from here, the arithmetic its numbers. A value is written as in a catalogue ("4.02 k", "680 p")
and read as a number of ohm, farad, henry, volt or ampere. Part names are examples; the ratings count.
"""

import re
from dataclasses import dataclass, field

PREFIX = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6}


def number(text):
    """`"4.02 k"` -> 4020.0"""
    match = re.fullmatch(r"([\d.]+) ?([pnµmkM]?)(?:[ΩFHVA])?", text)
    if not match:
        raise ValueError(f"no value: {text!r}")
    return float(match[1]) * PREFIX[match[2]]


@dataclass(frozen=True)
class Part:
    """A part: what is printed beside it, its number, tolerance (a share), rating, and figures of its data sheet."""

    label: str
    tolerance: float = 0.0
    rating: str = ""
    data: dict = field(default_factory=dict)

    @property
    def value(self):
        return number(self.label)


def part(label, percent=0.0, rating="", **data):
    return Part(label, percent / 100, rating, data)


def expanded(table):
    """`"R201..R205"` is five alike."""
    parts = {}
    for refs, what in table.items():
        first, _, last = refs.partition("..")
        letters, low = re.fullmatch(r"([A-Z]+)(\d+)", first).groups()
        high = int(last[len(letters) :]) if last else int(low)
        for n in range(int(low), high + 1):
            name = f"{letters}{n}"
            if name in parts:
                raise ValueError(f"{name} is twice in the table")
            parts[name] = what
    return parts


PARTS = expanded(
    {
        # Sheet 1: supply of the backup SRAM.
        "BT101": part("3 V", rating="CR2032"),
        "D101": part("BAT54", rating="Schottky"),
        "C101": part("100 n", 10),
        # Sheet 2: gap voltage.
        "FB1": part("5 turns", rating="both leads through one ferrite core"),
        "R201..R210": part("100 k", 0.1, "25 ppm, 1206", volts=200.0, watts=0.25),
        "R211..R214": part("4.02 k", 0.1, "25 ppm"),
        "C201..C202": part("10 p", 5, "C0G"),
        "D201..D202": part("BAV199", rating="nanoamperes of leakage"),
        "U201": part("OPA2365", offset_v=0.2e-3),
        "R215..R216": part("1.00 k", 1),
        "C203": part("680 p", 5, "C0G"),
        "C204": part("330 p", 5, "C0G"),
        "R217": part("27.0 k", 0.1),
        "R218": part("3.00 k", 0.1),
        "C205": part("100 n", 10),
        # Comparators.
        "R219": part("2.87 k", 1),
        "RV201": part("10 k", 10, "10 turns"),
        "R220": part("10.0 k", 1),
        "R221": part("4.02 k", 1),
        "C206..C207": part("10 n", 10),
        "R222": part("1.00 k", 1),
        "R223": part("330 k", 1),
        "R224": part("1.00 k", 1),
        "R225": part("330 k", 1),
        "U202": part("TLV3202", delay_s=40e-9),
        # Gap current.
        "RS201..RS202": part("10 mΩ", 1, "4 terminals", watts=3.0, henry=5e-9),
        "R226..R227": part("1.00 k", 0.1),
        "R228..R229": part("10.0 k", 0.1),
        "R230": part("1.00 k", 1),
        "C208": part("330 p", 5, "C0G"),
        "R231..R232": part("10.0 k", 1),
        "C209": part("100 n", 10),
        "D203..D204": part("BAV199"),
        "U203": part("OPA2365", offset_v=0.2e-3),
        # Sheet 3: drive.
        "F301": part("5 A", rating="slow"),
        "C301": part("2200 µ", 20, "63 V"),
        "R301": part("10 k", 5, "1 W", watts=1.0),
        "K1": part("DC contact ≥ 60 V 6 A", rating="force-guided, IEC 61810-3"),
        "D301": part("SB5100", rating="100 V 5 A"),
        "C302": part("10 µ", 20, "100 V ceramic"),
        "R302..R304": part("10 k", 5),
        "U301": part("74LVC08"),
        "U302": part("74LVC32"),
        "R305": part("10 k", 5),
        "R306": part("10 k", 5),
        "R311": part("10 k", 5),
        "C303": part("1 n", 10),
        "D302": part("BAT54A"),
        "U303": part(
            "L6206",
            rating="both bridges in parallel",
            high_v=52.0,
            amps=5.6,
            switch_ohm=0.15,
            trip_a=5.6,
            dead_s=1e-6,
            enable_v=1.8,
        ),
        "R307": part("100", 5),
        "C304": part("220 n", 10),
        "C305": part("10 n", 10),
        "D303..D304": part("1N4148"),
        "RS301": part("15 mΩ", 1, "4 terminals", watts=1.0),
        "U304": part("INA240A1", gain=20.0, swing_v=0.2),
        "R308": part("1.00 k", 1),
        "C306": part("47 n", 10),
        "R309": part("180 k", 1),
        "R310": part("10.0 k", 1),
        "C307": part("10 n", 10),
        # Sheet 4: signals.
        "R401..R403": part("120", 1),
        "U401": part("MAX14891E", rating="four RS-422 receivers, each with a fault output"),
        "R423": part("4.7 k", 5),
        "R404..R405": part("60.4", 1),
        "C401": part("4.7 n", 10),
        "L401": part("51 µ"),
        "D401": part("PESD1CAN", rating="or NUP2105L"),
        "U403": part("SN65HVD230"),
        "U404": part("ISO7721F", drive_a=4e-3),
        "R406": part("10 k", 5),
        "R407": part("1.50 k", 1),
        "R408": part("1.00 k", 5),
        "R409": part("10 k", 5),
        "R419": part("10 k", 5),
        "R420": part("1.00 k", 5),
        "U409": part("74LVC1G17", rating="takes no current without supply (Ioff)"),
        "R410": part("6.49 k", 1),
        "R411": part("10.0 k", 1),
        "U405": part("AMC1311B", full_scale_v=2.0),
        "U406": part("TLV9002", gain=2.5),
        "R412..R413": part("2.2 k", 1, "0.5 W", watts=0.5),
        "C402": part("4.7 n", 10),
        "D402": part("1N4148"),
        "U407": part("H11L1", forward_v=1.2, on_a=1.6e-3, off_a=1.0e-3),
        "R414": part("4.7 k", 5),
        "R415": part("390", 5, "for 5 V"),
        "R416": part("1.00 k", 5),
        "U408": part("6N137"),
        "R417": part("100", 5),
        "R418": part("10 k", 5),
        "Q401": part("60 V MOSFET", rating="logic level"),
        "D403": part("1N4007"),
        "Y401": part("24 V", rating="≤ 1 A"),
        "R421": part("100", 5),
        "R422": part("10 k", 5),
        "Q402": part("60 V MOSFET", rating="logic level"),
        # Sheet 5: live signal.
        "R501..R503": part("10 k", 5),
        "R504": part("40.2 k", 1),
        "C501": part("10 n", 5, "C0G"),
        "U501": part("74LVC1G123", width_low=0.9, width_high=1.1),
        "U502": part("74LVC1G74"),
        "U503": part("74LVC1G08"),
        # Sheet 5: interlocks.
        "K0": part("safety relay", rating="2 channels, off-delay", off_delay_s=0.4, release_s=30e-3),
        "K3": part("safety relay", rating="2 channels, monitored reset by its falling edge", release_s=20e-3),
        "K2": part("24 V relay", rating="force-guided, gold contacts for 5 V 1 mA", coil_ohm=700.0, release_s=20e-3),
        "KM1": part("contactor", rating="mains of the generator, mirror contact IEC 60947-4-1"),
        "D501": part("1N4007"),
        # Sheet 5: sense supply.
        "U504": part("DC/DC 24 V to 12 V", 5, "1 W, reinforced insulation for 300 V", volts=12.0, watts=1.0),
        "D502": part("SMBJ15A", rating="15 V, 600 W", volts=15.0),
        "C502": part("1 µ", 20, "50 V"),
        "D503..D504": part("UF4007", rating="1000 V, 75 ns", volts=1000.0, open_v=0.45, on_v=0.7, recovery_s=75e-9),
        "F501": part("63 mA", rating="quick, 500 V DC"),
        "R507": part("1.00 k", 5),
        "R505..R506": part("560", 5, "3 W wire-wound, fusible", watts=3.0),
    }
)


@dataclass(frozen=True)
class Given:
    """A number that is no part: `source` says where it is from."""

    value: float
    source: str


# The 64-pin head; a second column is STM32F407G-DISC1.
SUPPLY_V = {"f405": 3.3, "disc": 3.0}
LOGIC_V = 3.3

GIVEN = {
    "codes": Given(4096, "12 bits"),
    "tick_s": Given(50e-6, "TICK_HZ of the firmware"),
    "gap_rate_hz": Given(500e3, "ADC_HZ of the firmware"),
    "blanking_s": Given(2e-6, "docs/architecture.md"),
    # The converter of motor current is started by the servo tick, which begins with the PWM's on-time.
    "sample_first_s": Given(1e-6, "assumed: servo task to its converter"),
    "sample_last_s": Given(6e-6, "the same, and the spread of the tick's begin, docs/performance.md"),
    "regulator": Given(0.01, "3.3 V regulator, 1 %"),
    "mains_contact_v": Given(24.0, "supply of contacts"),
    "generator_v": Given(5.0, "logic supply of the generator"),
    "off_time_full_s": Given(200e-6, "assumed"),
    "off_time_full_v": Given(5.0, "assumed"),
    "off_time_own_v": Given(0.4, "assumed: below it the generator's own setting"),
    "dac_low_v": Given(0.2, "lowest voltage of the buffered DAC, [DS]"),
    # Generator.
    "open_v": Given(300.0, "largest open-circuit voltage"),
    "open_least_v": Given(70.0, "gap.open_min_v"),
    "example_v": Given(100.0, "[R] section 4.4"),
    "high_share": Given(0.7, "[X]"),
    "low_share": Given(0.2, "[X]"),
    "pulse_a": Given(25.0, "largest pulse current, assumed"),
    "pulse_share": Given(0.8, "on-time share"),
    "rc_f": Given(4700e-12, "capacitor of an RC generator"),
    "cable_f": Given(470e-12, "assumed: cables and gap without an RC generator"),
    "swing_v": Given(50.0, "assumed: lasting negative swing of the generator"),
    # Axis.
    "coil_ohm": Given(12.4, "[R] section 7.2"),
    "coil_h": Given(3e-3, "assumed"),
    "force_n_a": Given(7.5, "[R] section 7.2"),
    "bus_v": Given(48.0, "[R]"),
    "mass_kg": Given(0.2, "[R] section 6.1"),
    "heavy_kg": Given(0.4, "with a heavy electrode"),
    "fast_m_s": Given(0.6, "fastest motion"),
    "counterbalance_n": Given(2.2, "assumed"),
    "friction_n": Given(0.3, "assumed"),
    "stiffness_n_m": Given(2e6, "assumed: 2 N/um"),
    "hold_n": Given(0.3, "force of the PWM example"),
    "dead_bus_v": Given(24.0, "lowest bus voltage that lifts"),
    "lift_a": Given(1.0, "coil current of a lift"),
    "gravity": Given(9.81, "m/s^2"),
    # Sense supply.
    "contact_v": Given(4.0, "chosen below: between a broken lead and the lowest open reading"),
    "water_s_m": Given(20e-4, "deionised water, 20 uS/cm"),
    "oil_s_m": Given(1e-9, "assumed: used EDM oil, 10 pS/cm"),
    "seek_m_s": Given(5e-3, "motion with pulses off through space not cleared before"),
    "fast_seek_m_s": Given(20e-3, "motion with pulses off through cleared space"),
}


def label(ref):
    """What stands beside the part on its sheet."""
    return PARTS[ref].label


def value(ref):
    return PARTS[ref].value


def data(ref, key):
    return PARTS[ref].data[key]


def given(key):
    return GIVEN[key].value
