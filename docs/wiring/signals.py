"""Sheet 4: encoder, CAN, generator, safety contacts and the small inputs and outputs."""

import schemdraw.elements as elm
import schemdraw.logic as logic

from components import data, given, label
from sheet import POWER, Sheet


def encoder(s):
    """Three differential lines to three 3.3 V pins; one line tells that a pair is open or shorted."""
    s.heading(0.6, 35.2, "Encoder: RS-422")
    y = 24.8
    lines = [
        ("A", "A", 8.0, "PA0 encoder A", 401),
        ("B", "B", 4.9, "PA1 encoder B", 402),
        ("I", "Z", 1.8, "PA2 index", 403),
    ]
    u = s.chip(
        7.4,
        y,
        5.4,
        8.8,
        f"U401\n{label('U401')}",
        left=[(offset - d, pin + sign) for _, pin, offset, _, _ in lines for sign, d in (("+", 0), ("−", 1.2))],
        right=[(offset - d, pin + what) for _, pin, offset, _, _ in lines for what, d in (("O", 0), ("FAULT", 1.2))],
        top=[(1.5, "VCC"), (3.9, "VL")],
    )
    s.rail(*u["VCC"], "5 V")
    s.rail(*u["VL"], "3V3")
    bus = 18.0
    for n, pin, offset, net, r in lines:
        for sign in ("+", "−"):
            x, yy = u[pin + sign]
            s.terminal(1.9, yy, n + sign)
            s.wire((2.1, yy), (x, yy))
            s.dot(4.2, yy)
        s.fit(elm.Resistor, (4.2, y + offset), (4.2, y + offset - 1.2), f"R{r}")
        s.flag(*u[pin + "O"], net)
        x, yy = u[pin + "FAULT"]
        s.wire((x, yy), (bus, yy))
        s.dot(bus, yy)
    (_, top), (_, middle), (_, low) = u["AFAULT"], u["BFAULT"], u["ZFAULT"]
    s.wire((bus, low), (bus, top))
    s.fit(elm.Resistor, (bus, top), (bus, top + 2.0), "R423")
    s.rail(bus, top + 2.0, "3V3")
    s.wire((bus, middle), (18.8, middle))
    s.flag(18.8, middle, "PC4 encoder fault")
    s.note(
        0.8,
        24.1,
        "U401: 100 nF at VCC and VL, pad to 0 V, fourth receiver not used. Cable screened, screen to earth at the board end; 5 V and\n"
        "0 V for the encoder in the same cable, fuse 0.5 A. A leads B by a quarter when moving toward the work.",
    )
    s.note(
        18.8,
        27.2,
        "Fault outputs: open drain, low (assumed).\n"
        "Open, shorted or undriven pair: 0 V, PC4\n"
        "low. No bias resistors at the pairs: they\n"
        "could hide an open one.",
    )


def can(s):
    """Transceiver, choke, surge protection, split termination."""
    s.heading(26.6, 35.2, "CAN, up to 1 Mbit/s")
    u = s.chip(
        33.0,
        26.6,
        4.2,
        7.0,
        "U403\nSN65\nHVD230",
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
    s.text(39.3, middle, f"L401\n{label('L401')}", "center", size=7.5)
    for yy, name in ((yh, "CANH"), (yl, "CANL")):
        s.wire((37.8, yy), (38.6, yy))
        s.wire((40.0, yy), (49.2, yy))
        s.terminal(49.4, yy, name, "right")
    s.part(elm.Zener, (41.2, middle), (41.2, yh), "½ D401")
    s.part(elm.Zener, (41.2, middle), (41.2, yl), "½ D401")
    s.wire((41.2, middle), (40.6, middle))
    s.ground(40.6, middle)
    s.fit(elm.Resistor, (45.0, yh), (45.0, middle), "R404")
    s.fit(elm.Resistor, (45.0, middle), (45.0, yl), "R405")
    s.part(elm.Capacitor, (45.0, middle), (47.6, middle), "", "")
    s.text(46.5, middle + 0.45, f"C401 {label('C401')}", "left", "bottom", size=7.5)
    s.wire((47.6, middle), (47.6, middle - 0.3))
    s.ground(47.6, middle - 0.3)
    for xx, yy in ((41.2, yh), (41.2, yl), (41.2, middle), (45.0, yh), (45.0, yl), (45.0, middle)):
        s.dot(xx, yy)
    s.note(
        26.8,
        25.7,
        "U403 on 3V3, 100 nF. R404, R405, C401 only at the two ends of the bus: "
        "120 Ω between CANH and CANL at each, 60 Ω measured.\n"
        f"D401 {label('D401')} or NUP2105L. Third core of the cable: 0 V.",
    )


def generator(s):
    """Gate and enable through a digital isolator; relay contacts are in series with the enable."""
    s.heading(0.6, 22.5, "Pulse generator, isolated")
    y = 13.8
    u = s.chip(
        8.0,
        y,
        5.0,
        7.8,
        f"U404\n{label('U404')}",
        left=[(6.8, "VCC1"), (4.8, "INB"), (1.6, "OUTA")],
        right=[(6.8, "VCC2"), (4.8, "OUTB"), (1.6, "INA")],
    )
    s.barrier(10.5, 22.3, 10.5, y + 7.8, "insulation barrier", 10.8, 22.0)
    s.barrier(10.5, y, 10.5, 12.0, "creepage ≥ 8 mm", 10.8, 12.9)
    s.wire(u["VCC1"], (6.8, y + 6.8))
    s.rail(6.8, y + 6.8, "3V3")
    s.wire(u["INB"], (7.0, y + 4.8))
    s.dot(7.0, y + 4.8)
    s.fit(elm.Resistor, (7.0, y + 4.8), (7.0, y + 2.6), "R406", "left")
    s.ground(7.0, y + 2.6)
    s.fit(elm.Resistor, (3.6, y + 4.8), (6.2, y + 4.8), "R420")
    s.wire((6.2, y + 4.8), (7.0, y + 4.8))
    s.wire((7.0, y + 4.8), (7.0, y + 5.5))
    s.terminal(7.0, y + 5.6)
    s.text(6.7, y + 5.8, "TP1", "right", size=7.5)
    s.flag(3.6, y + 4.8, "PERMIT (5)", to="left")
    s.wire(u["OUTA"], (6.0, y + 1.6))
    s.flag(6.0, y + 1.6, "PC6, PB7 gate", to="left")
    s.wire(u["VCC2"], (21.4, y + 6.8))
    s.terminal(21.6, y + 6.8, "generator +5 V", "right")
    s.part(elm.Switch, (13.6, y + 4.8), (16.6, y + 4.8), "K0 13-14", "", "below")
    s.part(elm.Switch, (16.6, y + 4.8), (19.6, y + 4.8), "K2 13-14", "", "below")
    s.wire((19.6, y + 4.8), (21.4, y + 4.8))
    s.terminal(21.6, y + 4.8, "enable, high = pulses", "right")
    s.dot(20.2, y + 4.8)
    s.fit(elm.Resistor, (20.2, y + 4.8), (20.2, y + 2.8), "R407")
    s.floating(20.2, y + 2.8)
    s._add(logic.Buf().at((16.0, y + 1.6)).left())
    s.text(15.2, y + 2.4, "U409", "center", size=7.5)
    s.wire((14.2, y + 1.6), u["INA"])
    s.wire((16.0, y + 1.6), (17.4, y + 1.6))
    s.dot(16.8, y + 1.6)
    s.fit(elm.Resistor, (16.8, y + 1.6), (16.8, y - 0.4), "R409", "left")
    s.floating(16.8, y - 0.4)
    s.fit(elm.Resistor, (17.4, y + 1.6), (20.2, y + 1.6), "R408")
    s.wire((20.2, y + 1.6), (21.4, y + 1.6))
    s.terminal(21.6, y + 1.6, "gate, high = on", "right")
    s.terminal(21.6, y - 0.6, "generator 0 V", "right")
    s.wire((21.4, y - 0.6), (20.4, y - 0.6))
    s.floating(20.4, y - 0.6)
    s.note(
        28.2,
        12.6,
        "Enable: K0 and K2 (sheet 5) are behind U404. With either open R407 holds it low, whatever U404 does.\n"
        f"U409 {label('U409')} on generator +5 V, 100 nF: without supply it takes no current at its input, so that the\n"
        "gate line cannot feed VCC2. Contacts of K0, K2: gold-plated, for "
        f"{s.value('enable.amps')} at {given('generator_v'):.0f} V. The generator has a pull-down of its own.",
    )
    # Off-time request: analogue, slow.
    y = 7.6
    u = s.chip(8.0, y, 5.0, 4.2, f"U405\n{label('U405')}", left=[(2.1, "IN")], right=[(3.2, "OUT+"), (1.0, "OUT−")])
    v = s.chip(
        15.4,
        y,
        4.0,
        4.2,
        f"U406\n{label('U406')}\n× {data('U406', 'gain')}",
        left=[(3.2, "+"), (1.0, "−")],
        right=[(2.1, "OUT")],
    )
    s.barrier(10.5, y, 10.5, 6.9, "", 0, 0)
    s.wire(u["OUT+"], v["+"])
    s.wire(u["OUT−"], v["−"])
    s.wire(v["OUT"], (20.8, y + 2.1))
    s.terminal(21.0, y + 2.1, "off-time, 0..5 V", "right")
    s.flag(4.4, y + 2.1, "PA4 off-time", to="left")
    s.fit(elm.Resistor, (4.4, y + 2.1), (6.8, y + 2.1), "R410")
    s.wire((6.8, y + 2.1), u["IN"])
    s.dot(6.8, y + 2.1)
    s.fit(elm.Resistor, (6.8, y + 2.1), (6.8, y - 0.1), "R411", "left")
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
    s.fit(elm.Resistor, (33.8, y), (36.8, y), "R412")
    s.dot(36.8, y)
    s.fit(elm.Capacitor, (36.8, y), (36.8, y - 2.4), "C402")
    s.ground(36.8, y - 2.4)
    s.fit(elm.Resistor, (36.8, y), (39.8, y), "R413")
    u = s.chip(42.0, y - 3.0, 4.2, 4.0, f"U407\n{label('U407')}", left=[(3.0, "A"), (1.0, "K")], right=[(2.0, "OUT")])
    s.wire((39.8, y), u["A"])
    s.wire(u["K"], (40.6, y - 2.0), (40.6, y - 2.6))
    s.ground(40.6, y - 2.6)
    s.part(elm.Diode, (40.6, y - 2.0), (40.6, y), "", "")
    s.text(40.1, y - 1.0, "D402", "right", size=7.5)
    s.dot(40.6, y)
    s.dot(40.6, y - 2.0)
    s.wire(u["OUT"], (47.4, y - 1.0))
    s.dot(46.8, y - 1.0)
    s.fit(elm.Resistor, (46.8, y - 1.0), (46.8, y + 1.2), "R414")
    s.rail(46.8, y + 1.2, "3V3")
    s.flag(47.4, y - 1.0, "PC11")
    rows = [
        "PC11  upper limit switch (away from the work)",
        "PC12  lower limit switch (toward the work)",
        "PC13  third contact of the emergency stop S1",
        "PB15  dielectric and enclosure: tap of the interlock chain, sheet 5",
    ]
    for i, row in enumerate(rows):
        s.text(28.4, 16.6 - 0.7 * i, row)
    s.note(
        41.6,
        16.4,
        "Closed: pin low, safe. Open, broken wire, wire\n"
        "to earth or no 24 V: pin high, unsafe.\n"
        f"{s.value('contact.amps')} through the contact. R412, R413 {data('R412', 'watts')} W;\n"
        f"D402 {label('D402')}; U407 on 3V3.",
    )


def small(s):
    """Host pulses, spark frequency and the flush valve."""
    s.heading(0.6, 6.4, "Isolated input: one of three")
    u = s.chip(6.6, 1.3, 4.2, 3.8, f"U408\n{label('U408')}", left=[(2.9, "A"), (0.9, "K")], right=[(1.9, "OUT")])
    s.terminal(1.5, 4.2, "+")
    s.fit(elm.Resistor, (1.7, 4.2), (6.0, 4.2), "R415", "split", extra=" (5 V)")
    s.terminal(1.5, 2.2, "−")
    s.wire((1.7, 2.2), u["K"])
    x, y = u["OUT"]
    s.wire((x, y), (12.6, y))
    s.dot(12.0, y)
    s.fit(elm.Resistor, (12.0, y), (12.0, y + 2.0), "R416")
    s.rail(12.0, y + 2.0, "3V3")
    s.flag(12.6, y, "PA15 step")
    s.note(
        11.3,
        2.6,
        "PB10 direction, PA6 spark frequency:\nthe same. U408 on 5 V. Inverts: current\nthrough the LED reads low.",
    )
    s.heading(19.6, 6.4, "Flush valve")
    s.transistor(27.4, 3.7, "Q401")
    s.ground(27.4, 1.9)
    s.flag(23.0, 2.53, "PB14 flush", to="left")
    s.wire((23.0, 2.53), (23.6, 2.53))
    s.dot(23.6, 2.53)
    s.fit(elm.Resistor, (23.6, 2.53), (23.6, 0.9), "R418", "left")
    s.ground(23.6, 0.9)
    s.fit(elm.Resistor, (23.6, 2.53), (26.57, 2.53), "R417", "split")
    s.fit(elm.Inductor2, (27.4, 3.7), (27.4, 5.5), "Y401", "left", extra="\n≤ 1 A")
    s.rail(27.4, 5.5, "+24 V", color=POWER)
    s.wire((27.4, 3.7), (29.6, 3.7))
    s.fit(elm.Diode, (29.6, 3.7), (29.6, 5.5), "D403")
    s.wire((29.6, 5.5), (27.4, 5.5), color=POWER)
    s.dot(27.4, 3.7)
    s.dot(27.4, 5.5, color=POWER)
    s.note(28.6, 2.9, "Q401 logic-level\nMOSFET, 60 V")


def move_me(s):
    """The line that asks a machine for its coarse axis."""
    s.heading(33.0, 10.5, "Move me, ready: one of two")
    s.transistor(40.4, 7.9, "Q402")
    s.ground(40.4, 6.1)
    s.flag(36.0, 6.73, "PB2 move me", to="left")
    s.wire((36.0, 6.73), (36.6, 6.73))
    s.dot(36.6, 6.73)
    s.fit(elm.Resistor, (36.6, 6.73), (36.6, 5.1), "R422", "left")
    s.ground(36.6, 5.1)
    s.fit(elm.Resistor, (36.6, 6.73), (39.57, 6.73), "R421", "split")
    s.wire((40.4, 7.9), (40.4, 8.7), (43.4, 8.7))
    s.terminal(43.4, 8.7, "move me, low = asked", to="right")
    s.wire((42.4, 5.1), (43.4, 5.1))
    s.ground(42.4, 5.1)
    s.terminal(43.4, 5.1, "0 V", to="right")
    s.note(
        43.0,
        7.8,
        "To a 24 V input of the machine that has its\nload to +24 V, or to a relay with a diode.\nQ402 as Q401. PC10 ready for steps: the same.",
    )


def sheet(book):
    s = Sheet(4, "Signals", book)
    encoder(s)
    can(s)
    generator(s)
    contacts(s)
    small(s)
    move_me(s)
    return s
