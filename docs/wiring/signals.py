"""Sheet 4: encoder, CAN, generator, safety contacts, emergency stop and the small inputs and outputs."""

import schemdraw.elements as elm

from sheet import POWER, Sheet


def encoder(s):
    """Three differential lines to three 3.3 V pins."""
    s.heading(0.6, 35.2, "Encoder: RS-422, 5 V")
    y = 24.6
    lines = [("A", 8.0, "PA0 encoder A", 401), ("B", 5.2, "PA1 encoder B", 402), ("I", 2.4, "PA2 index", 403)]
    left = [(o + d, f"{n}{sign}") for n, o, _, _ in lines for d, sign in ((0, "+"), (-1.6, "−"))]
    u1 = s.chip(6.8, y, 4.8, 9.4, "U401\nAM26C32", left=left, right=[(o - 0.8, f"{n}Y") for n, o, _, _ in lines])
    u2 = s.chip(
        13.8,
        y,
        3.6,
        9.4,
        "U402\n" "74LVC\n" "3G17",
        left=[(o - 0.8, f"{n}1") for n, o, _, _ in lines],
        right=[(o - 0.8, f"{n}2") for n, o, _, _ in lines],
    )
    for n, offset, pin, r in lines:
        for sign in ("+", "−"):
            x, yy = u1[n + sign]
            s.terminal(1.9, yy, n + sign)
            s.wire((2.1, yy), (x, yy))
            s.dot(4.2, yy)
        s.part(elm.Resistor, (4.2, y + offset), (4.2, y + offset - 1.6), f"R{r}", "120")
        s.wire(u1[n + "Y"], u2[n + "1"])
        s.flag(*u2[n + "2"], pin)
    s.note(
        0.8,
        24.3,
        "U401 on 5 V, G high; U402 Schmitt buffers on 3V3 with 5 V inputs. "
        "Cable screened, screen to earth at the board end;\n"
        "5 V and 0 V for the encoder in the same cable, fuse 0.5 A. "
        "A leads B by a quarter when moving toward the work.",
    )


def can(s):
    """Transceiver, choke, surge protection, split termination."""
    s.heading(26.6, 35.2, "CAN, up to 1 Mbit/s")
    u = s.chip(
        33.0,
        26.6,
        4.2,
        7.0,
        "U403\n" "SN65\n" "HVD230",
        left=[(5.6, "D"), (3.6, "R"), (1.6, "RS")],
        right=[(5.8, "CANH"), (1.2, "CANL")],
    )
    s.flag(*u["D"], "PB9 CAN TX", to="left")
    s.flag(*u["R"], "PB8 CAN RX", to="left")
    x, y = u["RS"]
    s.wire((x, y), (31.6, y), (31.6, y - 0.6))
    s.ground(31.6, y - 0.6)
    (_, yh), (_, yl) = u["CANH"], u["CANL"]
    middle = (yh + yl) / 2
    s.box(38.6, yl - 0.6, 1.4, yh - yl + 1.2)
    s.text(39.3, middle, "L401\n51 µ", "center", size=7.5)
    for yy, name in ((yh, "CANH"), (yl, "CANL")):
        s.wire((37.8, yy), (38.6, yy))
        s.wire((40.0, yy), (49.2, yy))
        s.terminal(49.4, yy, name, "right")
    s.part(elm.Zener, (41.2, middle), (41.2, yh), "½ D401")
    s.part(elm.Zener, (41.2, middle), (41.2, yl), "½ D401")
    s.wire((41.2, middle), (40.6, middle))
    s.ground(40.6, middle)
    s.part(elm.Resistor, (45.0, yh), (45.0, middle), "R404", "60.4")
    s.part(elm.Resistor, (45.0, middle), (45.0, yl), "R405", "60.4")
    s.part(elm.Capacitor, (45.0, middle), (47.6, middle), "", "")
    s.text(46.5, middle + 0.45, "C401 4.7 n", "left", "bottom", size=7.5)
    s.wire((47.6, middle), (47.6, middle - 0.3))
    s.ground(47.6, middle - 0.3)
    for xx, yy in ((41.2, yh), (41.2, yl), (41.2, middle), (45.0, yh), (45.0, yl), (45.0, middle)):
        s.dot(xx, yy)
    s.note(
        26.8,
        25.7,
        "U403 on 3V3, 100 nF. R404, R405, C401 only at the two ends of the bus: "
        "120 Ω between CANH and CANL at each, 60 Ω measured.\n"
        "D401 PESD1CAN or NUP2105L. Third core of the cable: 0 V.",
    )


def generator(s):
    """Gate and enable through a digital isolator whose generator side is fed through the emergency stop."""
    s.heading(0.6, 22.5, "Pulse generator, isolated")
    y = 13.8
    u = s.chip(
        8.0,
        y,
        5.0,
        7.8,
        "U404\nISO7721F",
        left=[(6.8, "VCC1"), (4.8, "INB"), (1.6, "OUTA")],
        right=[(6.8, "VCC2"), (4.8, "OUTB"), (1.6, "INA")],
    )
    s.barrier(10.5, 22.3, 10.5, y + 7.8, "insulation barrier", 10.8, 22.0)
    s.barrier(10.5, y, 10.5, 12.0, "creepage ≥ 8 mm", 10.8, 12.9)
    s.wire(u["VCC1"], (6.8, y + 6.8))
    s.rail(6.8, y + 6.8, "3V3")
    s.wire(u["INB"], (6.0, y + 4.8))
    s.dot(6.6, y + 4.8)
    s.part(elm.Resistor, (6.6, y + 4.8), (6.6, y + 2.6), "R406", "10 k", "left")
    s.ground(6.6, y + 2.6)
    s.flag(6.0, y + 4.8, "PC7 allow pulses", to="left")
    s.wire(u["OUTA"], (6.0, y + 1.6))
    s.flag(6.0, y + 1.6, "PC6, PB7 gate", to="left")
    s.wire(u["VCC2"], (14.6, y + 6.8))
    s.part(elm.Switch, (14.6, y + 6.8), (17.6, y + 6.8), "K0 13-14")
    s.wire((17.6, y + 6.8), (19.4, y + 6.8))
    s.terminal(19.6, y + 6.8, "generator +5 V", "right")
    s.wire(u["OUTB"], (19.4, y + 4.8))
    s.terminal(19.6, y + 4.8, "enable, high = pulses", "right")
    s.dot(15.0, y + 4.8)
    s.part(elm.Resistor, (15.0, y + 4.8), (15.0, y + 2.8), "R407", "4.7 k")
    s.floating(15.0, y + 2.8)
    s.wire(u["INA"], (16.0, y + 1.6))
    s.dot(15.0, y + 1.6)
    s.part(elm.Resistor, (15.0, y + 1.6), (15.0, y - 0.4), "R409", "10 k")
    s.floating(15.0, y - 0.4)
    s.part(elm.Resistor, (16.0, y + 1.6), (19.4, y + 1.6), "R408", "1.00 k")
    s.terminal(19.6, y + 1.6, "gate, high = on", "right")
    s.terminal(19.6, y - 1.2, "generator 0 V", "right")
    s.wire((19.4, y - 1.2), (18.6, y - 1.2))
    s.floating(18.6, y - 1.2)
    # Off-time request: analogue, slow.
    y = 7.6
    u = s.chip(8.0, y, 5.0, 4.2, "U405\nAMC1311B", left=[(2.1, "IN")], right=[(3.2, "OUT+"), (1.0, "OUT−")])
    v = s.chip(15.4, y, 4.0, 4.2, "U406\nTLV9002\n× 2.5", left=[(3.2, "+"), (1.0, "−")], right=[(2.1, "OUT")])
    s.barrier(10.5, y, 10.5, 6.9, "", 0, 0)
    s.wire(u["OUT+"], v["+"])
    s.wire(u["OUT−"], v["−"])
    s.wire(v["OUT"], (20.8, y + 2.1))
    s.terminal(21.0, y + 2.1, "off-time, 0..5 V", "right")
    s.flag(4.4, y + 2.1, "PA4 off-time", to="left")
    s.part(elm.Resistor, (4.4, y + 2.1), (6.8, y + 2.1), "R410", "6.49 k")
    s.wire((6.8, y + 2.1), u["IN"])
    s.dot(6.8, y + 2.1)
    s.part(elm.Resistor, (6.8, y + 2.1), (6.8, y - 0.1), "R411", "10.0 k", "left")
    s.ground(6.8, y - 0.1)


def contacts(s):
    """One safety input of four: current through a closed contact is the only safe reading."""
    s.heading(28.0, 23.6, "Safety contacts: one of four cells")
    y = 20.4
    s.rail(29.0, y, "+24 V", color=POWER)
    s.wire((29.0, y), (29.6, y), color=POWER)
    s.part(lambda: elm.Button(nc=True), (29.6, y), (32.6, y), "NC contact", "", "below")
    s.wire((32.6, y), (33.4, y))
    s.terminal(33.6, y)
    s.part(elm.Resistor, (33.8, y), (36.8, y), "R412", "2.2 k")
    s.dot(36.8, y)
    s.part(elm.Capacitor, (36.8, y), (36.8, y - 2.4), "C402", "4.7 n")
    s.ground(36.8, y - 2.4)
    s.part(elm.Resistor, (36.8, y), (39.8, y), "R413", "2.2 k")
    u = s.chip(42.0, y - 3.0, 4.2, 4.0, "U407\nH11L1", left=[(3.0, "A"), (1.0, "K")], right=[(2.0, "OUT")])
    s.wire((39.8, y), u["A"])
    s.wire(u["K"], (40.6, y - 2.0), (40.6, y - 2.6))
    s.ground(40.6, y - 2.6)
    s.part(elm.Diode, (40.6, y - 2.0), (40.6, y), "", "")
    s.text(40.1, y - 1.0, "D402", "right", size=7.5)
    s.dot(40.6, y)
    s.dot(40.6, y - 2.0)
    s.wire(u["OUT"], (47.4, y - 1.0))
    s.dot(46.8, y - 1.0)
    s.part(elm.Resistor, (46.8, y - 1.0), (46.8, y + 1.2), "R414", "4.7 k")
    s.rail(46.8, y + 1.2, "3V3")
    s.flag(47.4, y - 1.0, "PC11")
    rows = [
        "PC11  upper limit switch (away from the work)",
        "PC12  lower limit switch (toward the work)",
        "PC13  third contact of the emergency stop S1",
        "PB15  dielectric OK: level, flow and temperature contacts in series",
    ]
    for i, row in enumerate(rows):
        s.text(28.4, 16.6 - 0.7 * i, row)
    s.note(
        41.6,
        16.4,
        "Closed: pin low, safe. Open, broken wire, wire\n"
        "to earth or no 24 V: pin high, unsafe.\n"
        "5 mA through the contact. R412, R413 0.5 W;\n"
        "D402 1N4148; U407 on 3V3.",
    )


def emergency_stop(s):
    """Stop category 1: pulses off at once, drive power off after the lift."""
    s.heading(28.0, 12.6, "Emergency stop: works without the processor")
    y = 4.2
    u = s.chip(
        36.0,
        y,
        6.6,
        7.2,
        "K0\nsafety relay\noff-delay\n0.4 s",
        left=[(6.2, "channel 1"), (4.0, "channel 2"), (1.8, "reset")],
        right=[(6.2, "13-14"), (4.0, "23-24"), (1.8, "37-38")],
    )
    s.rail(30.0, y + 6.2, "+24 V", color=POWER)
    s.wire((30.0, y + 6.2), (30.0, y + 1.8), color=POWER)
    for offset, name, nc in ((6.2, "S1 contact 1", True), (4.0, "S1 contact 2", True), (1.8, "S2 reset", False)):
        s.wire((30.0, y + offset), (31.0, y + offset), color=POWER)
        s.part(lambda: elm.Button(nc=nc), (31.0, y + offset), (34.4, y + offset), name, "", "below")
        s.wire((34.4, y + offset), (35.4, y + offset))
    s.dot(30.0, y + 6.2, color=POWER)
    s.dot(30.0, y + 4.0, color=POWER)
    for offset, text in (
        (6.2, "U404: pulses off at once"),
        (4.0, "KM1: generator mains off"),
        (1.8, "K1: drive off after 0.4 s"),
    ):
        s.flag(43.2, y + offset, text)


def small(s):
    """Host pulses, spark frequency and the flush valve."""
    s.heading(0.6, 6.4, "Isolated input: one of three")
    u = s.chip(6.6, 1.3, 4.2, 3.8, "U408\n6N137", left=[(2.9, "A"), (0.9, "K")], right=[(1.9, "OUT")])
    s.terminal(1.5, 4.2, "+")
    s.part(elm.Resistor, (1.7, 4.2), (6.0, 4.2), "R415", "390 (5 V)", "split")
    s.terminal(1.5, 2.2, "−")
    s.wire((1.7, 2.2), u["K"])
    x, y = u["OUT"]
    s.wire((x, y), (12.6, y))
    s.dot(12.0, y)
    s.part(elm.Resistor, (12.0, y), (12.0, y + 2.0), "R416", "1.00 k")
    s.rail(12.0, y + 2.0, "3V3")
    s.flag(12.6, y, "PA15 step")
    s.note(
        11.3,
        2.6,
        "PB10 direction, PA6 spark frequency:\n"
        "the same. U408 on 5 V. Inverts: current\n"
        "through the LED reads low.",
    )
    s.heading(19.6, 6.4, "Flush valve")
    s.transistor(27.4, 3.7, "Q401")
    s.ground(27.4, 1.9)
    s.flag(23.0, 2.53, "PB14 flush", to="left")
    s.wire((23.0, 2.53), (23.6, 2.53))
    s.dot(23.6, 2.53)
    s.part(elm.Resistor, (23.6, 2.53), (23.6, 0.9), "R418", "10 k", "left")
    s.ground(23.6, 0.9)
    s.part(elm.Resistor, (23.6, 2.53), (26.57, 2.53), "R417", "100", "split")
    s.part(elm.Inductor2, (27.4, 3.7), (27.4, 5.5), "Y401", "24 V\n≤ 1 A", "left")
    s.rail(27.4, 5.5, "+24 V", color=POWER)
    s.wire((27.4, 3.7), (29.6, 3.7))
    s.part(elm.Diode, (29.6, 3.7), (29.6, 5.5), "D403", "1N4007")
    s.wire((29.6, 5.5), (27.4, 5.5), color=POWER)
    s.dot(27.4, 3.7)
    s.dot(27.4, 5.5, color=POWER)
    s.note(28.6, 2.9, "Q401 logic-level\nMOSFET, 60 V")


def sheet():
    s = Sheet(4, "Signals and safety")
    encoder(s)
    can(s)
    generator(s)
    contacts(s)
    emergency_stop(s)
    small(s)
    return s
