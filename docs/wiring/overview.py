"""Sheet 1: the machine, its earth and insulation, and the pins of the microcontroller."""

import schemdraw.elements as elm

from components import label
from pins import PINS
from sheet import LIVE, POWER, Sheet

OUTPUTS = (
    "pwm",
    "forward",
    "reverse",
    "allow_pulses",
    "live",
    "arm",
    "off_time",
    "flush_valve",
    "carry",
    "step_ready",
    "led",
    "can_rx",
    "can_tx",
)


def head(s):
    """Section through the head: what moves, what is live, what is earthed."""
    s.heading(0.6, 35.2, "The head: insulation, counterbalance, earth")
    s.box(8.6, 22.6, 11.0, 11.4)
    s.text(8.8, 33.6, "housing, earthed", size=7.5)
    s.box(10.4, 28.2, 1.6, 3.4, fill="#dddddd")
    s.box(16.2, 28.2, 1.6, 3.4, fill="#dddddd")
    s.text(11.2, 29.9, "N\nS", "center", size=7.5)
    s.text(17.0, 29.9, "N\nS", "center", size=7.5)
    s.box(12.4, 28.6, 3.4, 2.4, color=POWER)
    s.text(14.1, 29.8, "coil", "center", color=POWER)
    s.spring(14.1, 31.0, 34.0)
    s.text(14.9, 32.7, "counterbalance", size=7.5)
    s.box(13.5, 20.6, 1.2, 8.0, fill="#eeeeee")
    s.box(15.2, 24.6, 2.8, 2.0)
    s.text(16.6, 25.6, "encoder", "center", size=7.5)
    s.box(9.4, 26.4, 2.4, 1.2)
    s.text(10.6, 27.0, "upper", "center", size=7.5)
    s.box(9.4, 23.4, 2.4, 1.2)
    s.text(10.6, 24.0, "lower", "center", size=7.5)
    s.wire((11.8, 25.5), (13.5, 25.5))
    s.text(10.6, 25.5, "limits", "center", size=7.5)
    # Insulating plate between everything that moves and the electrode.
    s.box(11.6, 19.4, 5.0, 1.2, color=LIVE, fill="#ffe9b0")
    s.text(14.1, 20.0, "insulating plate", "center", size=7.5)
    s.barrier(6.4, 20.0, 11.4, 20.0, "", 0, 0)
    s.barrier(16.8, 20.0, 21.8, 20.0, "", 0, 0)
    s.box(12.4, 17.8, 3.4, 1.6, color=LIVE, fill="#fff4f4")
    s.text(14.1, 18.6, "holder", "center", size=7.5, color=LIVE)
    s.box(13.2, 12.8, 1.8, 5.0, color=LIVE, fill="#fff4f4")
    s.text(14.1, 15.4, "elec-\ntrode", "center", size=7.5, color=LIVE)
    s.box(10.4, 10.2, 7.4, 2.2, fill="#eeeeee")
    s.text(14.1, 11.2, "workpiece", "center", size=7.5)
    s.box(8.0, 9.0, 12.2, 1.2, fill="#dddddd")
    s.text(14.1, 9.6, "table, earthed", "center", size=7.5)
    s.wire((8.6, 10.2), (8.6, 16.4))
    s.wire((19.6, 10.2), (19.6, 16.4))
    s.wire((8.6, 14.6), (13.2, 14.6), style=":")
    s.wire((15.0, 14.6), (19.6, 14.6), style=":")
    s.text(17.4, 15.0, "dielectric", "center", "bottom", size=7.5)
    s.arrow(21.4, 30.6, 21.4, 25.6)
    s.text(21.8, 28.1, "x, s, duty +:\ntoward the work")
    s.text(15.4, 12.6, "gap", size=7.5)
    s.note(
        0.8,
        33.2,
        "De-energised the head must\nrise or stay. Counterbalance\n1.1 to 1.3 × the moving weight\n"
        f"(scenario: {s.value('axis.counterbalance')} for {s.value('axis.weight')}).\nBraking the coil does not hold:\n"
        f"{s.value('axis.mass')} sinks at {s.value('axis.sink')} and\ncloses 50 µm in {s.value('axis.fall')}.",
    )
    s.note(
        0.8,
        24.0,
        "Insulating plate, cables and fluid\nfittings: creepage 10 mm or more,\nclearance 5 mm, 1500 V DC 1 s,\n"
        "≥ 1 MΩ at 500 V DC wet.\nScrews in insulating bushes.\nEarth strap on the housing.",
    )


def power_loop(s):
    """Discharge current: generator, electrode, gap, workpiece, shunt, generator; and nothing else."""
    s.box(0.8, 3.6, 6.2, 5.6, fill="#fbfbf4")
    s.text(3.9, 7.6, "Pulse generator", "center")
    s.text(3.9, 6.2, "output isolated\nfrom the mains", "center", size=7.5)
    s.text(1.0, 4.1, "logic: sheet 4", size=7.5)
    s.wire((7.0, 8.4), (7.6, 8.4), (7.6, 18.6), (12.4, 18.6), color=LIVE, lw=2)
    s.text(6.9, 8.5, "E", "right", size=7.5, color=LIVE)
    s.wire((7.0, 4.4), (9.4, 4.4), color=LIVE, lw=2)
    s.text(6.9, 4.8, "W", "right", size=7.5, color=LIVE)
    s.part(
        elm.Resistor,
        (9.4, 4.4),
        (12.6, 4.4),
        "RS201, RS202",
        f"{s.value('current.shunt')} (sheet 2)",
        "below",
        color=LIVE,
    )
    s.wire((12.6, 4.4), (14.1, 4.4), (14.1, 9.0), color=LIVE, lw=2)
    s.dot(14.1, 4.4)
    s.wire((14.1, 4.4), (14.1, 3.0))
    s.earth(14.1, 3.0)
    s.text(14.8, 2.9, "star: table, earth, control 0 V", size=7.5)
    s.wire((15.0, 16.8), (22.4, 16.8), color=LIVE)
    s.flag(22.4, 16.8, "GAP+", color=LIVE)
    s.wire((17.8, 11.7), (22.4, 11.7), color=LIVE)
    s.flag(22.4, 11.7, "GAP−", color=LIVE)
    s.note(20.8, 14.9, f"twisted pair, own terminals\nat holder and workpiece,\n{label('FB1')} through FB1")
    # Own leads: a broken one of GAP+ or GAP- must not leave the sense voltage on the divider.
    s.wire((15.8, 18.0), (22.4, 18.0), color=LIVE)
    s.flag(22.4, 18.0, "SENSE+ (5)", color=LIVE)
    s.wire((17.8, 10.7), (22.4, 10.7), color=LIVE)
    s.flag(22.4, 10.7, "SENSE− (5)", color=LIVE)
    s.note(
        16.4,
        8.7,
        "E and W: as short, as close together as possible.\n"
        "Electrode negative: swap the generator's output at its terminals,\n"
        "GAP+ with GAP−, SENSE+ with SENSE−, and the taps of the shunt.\n"
        "The work stays earthed.",
    )


def supplies(s):
    """Rails of the board."""
    s.heading(23.4, 6.6, "Rails")
    rows = [
        ("48 V", "drive, 5 A, SELV (sheet 3)", POWER),
        ("24 V", "contacts, relays, valve, sense supply, 2 A, SELV", POWER),
        ("5 V", "from 24 V; encoder, U401, U408", "black"),
        ("3V3", "from 5 V, 300 mA", "black"),
        ("3V3A", "3V3 by 600 Ω ferrite, 10 µ: VDDA, U20x, U304", "black"),
        ("VBAT", f"BT101 {label('BT101')} CR2032 by D101 {label('D101')}, C101 {label('C101')}", "black"),
    ]
    for i, (name, what, color) in enumerate(rows):
        s.text(23.6, 5.6 - 0.85 * i, name, color=color)
        s.text(25.8, 5.6 - 0.85 * i, what, size=7.5)


def processor(s):
    """Every pin that is used, with its number in the 64-pin package and the sheet it goes to."""
    s.heading(36.6, 35.2, "STM32F405RG, LQFP64")
    named = [(f"{p.number}  {p.pin}", p.short + (f" ({p.sheet})" if p.sheet > 1 else ""), p.signal) for p in PINS]
    left = [(pin, net) for pin, net, signal in named if signal not in OUTPUTS] + [("24  PC4", "encoder fault (4)")]
    right = [(pin, net) for pin, net, signal in named if signal in OUTPUTS] + [
        ("46  PA13", "SWDIO"),
        ("49  PA14", "SWCLK"),
        ("7  NRST", "100 n to 0 V, probe (5)"),
        ("60  BOOT0", "10 k to 0 V"),
        ("5  PH0", "8 MHz crystal"),
        ("6  PH1", "8 MHz crystal"),
        ("31, 47  VCAP", "2.2 µ each"),
        ("19,32,48,64 VDD", "3V3, 100 n each"),
        ("1  VBAT", "BT101 by D101, C101"),
        ("13  VDDA", "3V3A"),
        ("12,18,63 VSS", "0 V"),
    ]
    x, y, w, h = 36.4, 11.6, 8.0, 22.6
    pitch = 1.0
    u = s.chip(
        x,
        y,
        w,
        h,
        "U1",
        left=[(h - 0.9 - pitch * i, pin) for i, (pin, _) in enumerate(left)],
        right=[(h - 0.9 - pitch * i, pin) for i, (pin, _) in enumerate(right)],
    )
    for pin, net in left:
        s.flag(*u[pin], net, to="left")
    for pin, net in right:
        s.flag(*u[pin], net)


def sheet(book):
    s = Sheet(1, "Overview", book)
    head(s)
    power_loop(s)
    supplies(s)
    processor(s)
    s.legend(39.0, 9.4)
    return s
