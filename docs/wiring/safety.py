"""Sheet 5: live signal and its latch, interlocks and emergency stop, sense supply."""

import schemdraw.elements as elm
import schemdraw.logic as logic

from components import PARTS, data, given, label
from sheet import LIVE, POWER, Sheet


def live(s):
    """Monostable, latch and the gate of the pulse permission."""
    v = s.value
    s.heading(0.6, 35.2, "Live signal: pulses and bridge only while the program runs")
    top = 32.2
    mono = s.chip(
        9.4, 26.2, 5.2, 6.4, f"U501\n{label('U501')}",
        left=[(5.2, "B"), (4.2, "A, low"), (1.2, "CLR, low")],
        right=[(5.2, "Q")],
        top=[(0.8, "Cext"), (3.8, "Rext/Cext")],
    )  # fmt: skip
    latch = s.chip(
        18.4, 24.8, 5.4, 7.8, f"U502\n{label('U502')}",
        left=[(6.6, "D"), (4.4, "CLK"), (2.2, "CLR, low")],
        right=[(6.6, "Q")],
        bottom=[(2.7, "PRE, low")],
    )  # fmt: skip
    cx, cy = mono["Cext"]
    rx, ry = mono["Rext/Cext"]
    s.fit(elm.Capacitor, (cx, cy), (rx, ry), "C501")
    s.wire((rx, ry), (13.8, ry))
    s.dot(rx, ry)
    s.fit(elm.Resistor, (13.8, ry), (16.4, ry), "R504")
    s.wire((16.4, ry), (17.0, ry))
    s.rail(17.0, ry, "3V3")
    # R507 lets a test hold B against the processor.
    by = mono["B"][1]
    s.flag(3.6, by, "PB5 live", to="left")
    s.fit(elm.Resistor, (3.6, by), (6.6, by), "R507")
    s.wire((6.6, by), mono["B"])
    s.flag(3.6, 23.4, "PD2 arm", to="left")
    for x, y, ref in ((6.6, by, "R501"), (4.6, 23.4, "R502")):
        s.dot(x, y)
        s.fit(elm.Resistor, (x, y), (x, y - 2.2), ref, "left")
        s.ground(x, y - 2.2)
    s.wire((7.6, by), (7.6, by + 0.7))
    s.dot(7.6, by)
    s.terminal(7.6, by + 0.8)
    s.text(7.3, by + 1.2, "TP2", "right", size=7.5)
    ax, ay = mono["A, low"]
    s.wire((ax, ay), (8.0, ay), (8.0, ay - 0.6))
    s.ground(8.0, ay - 0.6)
    nx, ny = mono["CLR, low"]
    s.flag(8.2, ny, "NRST", to="left")
    s.wire((8.2, ny), (nx, ny))
    # The monostable is data and clear of the latch: without it there is nothing to clock in.
    qx, qy = mono["Q"]
    dx, dy = latch["D"]
    s.wire((qx, qy), (15.6, qy), (15.6, dy), (dx, dy))
    lx, ly = latch["CLR, low"]
    s.wire((15.6, dy), (15.6, ly), (lx, ly))
    s.dot(15.6, dy)
    kx, ky = latch["CLK"]
    s.wire((3.6, 23.4), (16.8, 23.4), (16.8, ky), (kx, ky))
    px, py = latch["PRE, low"]
    s.wire((px, py), (px, 23.6), (19.4, 23.6))
    s.rail(19.4, 23.6, "3V3")
    ox, oy = latch["Q"]
    s.wire((ox, oy), (29.0, oy))
    s.flag(29.0, oy, "PB4 armed")
    for x in (24.8, 25.8, 28.0):
        s.dot(x, oy)
    s.fit(elm.Resistor, (28.0, oy), (28.0, oy - 2.2), "R503")
    s.ground(28.0, oy - 2.2)
    s.wire((24.8, oy), (24.8, top + 1.4), (29.0, top + 1.4))
    s.flag(29.0, top + 1.4, "ARMED, sheet 3")
    gate = s._add(logic.And().at((27.0, 27.0)).anchor("in1").right()).absanchors
    s.text(27.9, 26.0, "U503", "center", size=7.5)
    s.wire((25.8, oy), (25.8, gate["in1"][1]), gate["in1"])
    iy = gate["in2"][1]
    s.wire((27.0, iy), (25.8, iy), (25.8, 24.4), (28.4, 24.4))
    s.dot(27.2, 24.4)
    s.flag(28.4, 24.4, "PC7 allow pulses")
    s.fit(elm.Resistor, (27.2, 24.4), (27.2, 22.4), "R419")
    s.ground(27.2, 22.4)
    out = gate["out"]
    s.wire(out, (29.4, out[1]))
    s.flag(29.4, out[1], "PERMIT, sheet 4")
    s.note(
        0.8,
        20.6,
        f"PB5 changes once a servo tick: U501 is retriggered every {v('live.period')}; its pulse is {v('live.width')}, "
        f"{v('live.least')} to {v('live.most')} with all tolerances.\n"
        f"PB5 stuck high or low: the pulse ends, U502 is cleared, pulses and bridge are off within {v('live.most')}, "
        "and stay off until PD2 rises while U501 runs.\n"
        "Any reset of the chip pulls NRST low and ends the pulse at once. At power-up nothing starts U501: off.\n"
        f"U503 {label('U503')}; U501 to U503 on 3V3, 100 nF each. R502, R503 at the processor, R501 at U501, R419 at U503.",
    )


def contact(s, x, y, name, normally_closed=False):
    """A contact of two units in a rung, its name below it."""
    s.part(lambda: elm.Button(nc=True) if normally_closed else elm.Switch(), (x, y), (x + 2.8, y), name, "", "below")


def coil(s, x, y, name, diode):
    """Coil of a relay between the point and control 0 V, with its diode."""
    s.wire((x, y), (x + 1.2, y))
    s.dot(x + 0.6, y)
    s.box(x + 1.2, y - 0.55, 1.8, 1.1)
    s.text(x + 2.1, y, name, "center")
    s.wire((x + 3.0, y), (x + 4.2, y), (x + 4.2, y - 0.6))
    s.dot(x + 3.6, y)
    s.ground(x + 4.2, y - 0.6)
    s.wire((x + 0.6, y), (x + 0.6, y - 1.4), (x + 0.9, y - 1.4))
    s.wire((x + 3.6, y), (x + 3.6, y - 1.4), (x + 3.3, y - 1.4))
    s.part(elm.Diode, (x + 3.3, y - 1.4), (x + 0.9, y - 1.4), diode, "", "below")


def interlocks(s):
    """Emergency stop and the three rungs that it, dielectric and enclosure open: contacts and relays only."""
    s.heading(0.6, 17.6, "Emergency stop and interlocks: work without the processor")
    y = 5.6
    s.chip(
        9.8, y, 5.0, 10.0, f"K0\n{label('K0')}\noff-delay\n{data('K0', 'off_delay_s')} s",
        left=[(8.8, "channel 1"), (6.0, "channel 2"), (1.6, "reset")],
    )  # fmt: skip
    s.rail(1.6, y + 8.8, "+24 V", color=POWER)
    s.wire((1.6, y + 8.8), (1.6, y + 1.6), color=POWER)
    for offset, name in ((8.8, "S1 contact 1"), (6.0, "S1 contact 2")):
        s.dot(1.6, y + offset, color=POWER)
        s.wire((1.6, y + offset), (3.8, y + offset), color=POWER)
        contact(s, 3.8, y + offset, name, True)
        s.wire((6.6, y + offset), (9.2, y + offset))
    # Reset only while every relay has dropped: mirror contacts.
    s.part(elm.Button, (1.6, y + 1.6), (3.8, y + 1.6), "S2\nreset", "", "below")
    for i, name in enumerate(("KM1", "K1", "K2")):
        x = 3.8 + 1.8 * i
        s.part(lambda: elm.Button(nc=True), (x, y + 1.6), (x + 1.8, y + 1.6), f"{name}\n21-22", "", "below")
    s.text(2.0, y + 3.3, "feedback: a welded KM1, K1\nor K2 blocks the reset", size=7.5)
    # Three rungs.
    rail = 17.0
    rungs = {"KM1": y + 8.8, "K2": y + 4.9, "K1": y + 0.6}
    s.rail(rail, y + 8.8, "+24 V", color=POWER)
    s.wire((rail, y + 8.8), (rail, y + 0.6), color=POWER)
    for yy in rungs.values():
        s.dot(rail, yy, color=POWER)
    yy = rungs["KM1"]
    contact(s, 17.4, yy, "K0 23-24")
    contact(s, 20.2, yy, "K3 23-24")
    s.wire((rail, yy), (17.4, yy))
    s.wire((23.0, yy), (28.6, yy))
    coil(s, 28.6, yy, "KM1", "")
    s.text(33.4, yy + 0.5, "mains of the\ngenerator", size=7.5)
    yy = rungs["K2"]
    s.wire((rail, yy), (17.4, yy))
    contact(s, 17.4, yy, "dielectric", True)
    contact(s, 20.2, yy, "K3 13-14")
    s.wire((23.0, yy), (25.4, yy))
    s.dot(24.2, yy)
    s.wire((24.2, yy), (24.2, yy + 1.6), (24.8, yy + 1.6))
    s.flag(24.8, yy + 1.6, "cell of PB15")
    contact(s, 25.4, yy, "K0 33-34")
    s.wire((28.2, yy), (28.6, yy))
    coil(s, 28.6, yy, "K2", "D501")
    s.text(33.4, yy + 0.5, "enable of the\npulses, sheet 4", size=7.5)
    yy = rungs["K1"]
    s.wire((rail, yy), (17.4, yy))
    contact(s, 17.4, yy, "K0 47-48")
    s.wire((20.2, yy), (28.6, yy))
    s.text(20.6, yy + 0.4, f"opens {data('K0', 'off_delay_s')} s late", size=7.5)
    coil(s, 28.6, yy, "K1", "")
    s.text(33.4, yy + 0.5, "drive,\nsheet 3", size=7.5)
    s.note(
        0.8,
        3.2,
        "K0 13-14 and K2 13-14 are in series in the enable (sheet 4). Dielectric: level, flow and temperature contacts in series. "
        "S3: door switch, two positively opened contacts.\n"
        f"K1, K2, KM1: force-guided or mirror contacts. K2: {label('K2')}, {data('K2', 'coil_ohm'):.0f} Ω, gold contacts for "
        f"{s.value('enable.amps')} at {given('generator_v'):.0f} V; releases in {s.value('k2.release')}. "
        f"D501 {label('D501')}, likewise at K1 and KM1.\n"
        "Opening the door switches off K2 and the mains of the generator. Closing it switches neither on again: press S4 where you see that "
        "nobody is inside.",
    )


def enclosure(s):
    """The door of the enclosure, with a manual reset."""
    s.heading(35.6, 17.0, "Enclosure: manual reset")
    y = 9.4
    s.chip(
        44.6, y, 6.4, 6.6, f"K3\n{label('K3')}",
        left=[(5.6, "channel 1"), (3.6, "channel 2"), (1.2, "reset")],
    )  # fmt: skip
    s.rail(36.4, y + 5.6, "+24 V", color=POWER)
    s.wire((36.4, y + 5.6), (36.4, y + 1.2), color=POWER)
    for offset, name in ((5.6, "S3 enclosure 1"), (3.6, "S3 enclosure 2")):
        s.dot(36.4, y + offset, color=POWER)
        s.wire((36.4, y + offset), (38.4, y + offset), color=POWER)
        contact(s, 38.4, y + offset, name, True)
        s.wire((41.2, y + offset), (44.0, y + offset))
    s.part(elm.Button, (36.4, y + 1.2), (38.6, y + 1.2), "S4\nreset", "", "below")
    for i, name in enumerate(("KM1", "K2")):
        x = 38.6 + 1.8 * i
        s.part(lambda: elm.Button(nc=True), (x, y + 1.2), (x + 1.8, y + 1.2), f"{name}\n21-22", "", "below")
    s.wire((42.2, y + 1.2), (44.0, y + 1.2))


def sense(s):
    """Low voltage across the gap, so that a contact is seen with pulses off."""
    v = s.value
    s.heading(35.6, 35.2, "Sense supply: contact with pulses off")
    u = s.chip(
        38.2, 28.4, 4.6, 5.0, f"U504\n{label('U504').replace(' 24', chr(10) + '24')}",
        left=[(4.0, "+"), (1.0, "−")], right=[(4.0, "+"), (1.0, "−")],
    )  # fmt: skip
    s.barrier(40.5, 34.3, 40.5, 33.4, "insulation barrier", 40.8, 34.2)
    s.barrier(40.5, 28.4, 40.5, 27.4, "creepage ≥ 8 mm", 36.9, 28.0)
    x, y = u["+"][0], 32.4
    s.wire((36.6, y), (37.6, y), color=POWER)
    s.rail(36.6, y, "+24 V", color=POWER)
    s.wire((37.6, 29.4), (36.6, 29.4), (36.6, 29.0))
    s.ground(36.6, 29.0)
    low = 29.4
    s.wire((43.4, y), (48.0, y), color=LIVE)
    s.wire((43.4, low), (46.8, low), color=LIVE)
    s.fit(elm.Capacitor, (44.2, y), (44.2, low), "C502", "right", color=LIVE)
    s.part(elm.Zener, (46.8, low), (46.8, y), "D502", "", color=LIVE)
    for x in (44.2, 46.8):
        s.dot(x, y, color=LIVE)
    s.dot(44.2, low, color=LIVE)
    s.fit(elm.Fuse, (48.0, y), (50.6, y), "F501", color=LIVE)
    s.wire((50.6, y), (51.0, y), (51.0, 26.4), (36.8, 26.4), (36.8, 24.4), (37.2, 24.4), color=LIVE)
    s.part(elm.Diode, (37.2, 24.4), (39.8, 24.4), "D503", "", color=LIVE)
    s.part(elm.Diode, (39.8, 24.4), (42.4, 24.4), "D504", "", color=LIVE)
    s.fit(elm.Resistor, (42.4, 24.4), (45.4, 24.4), "R505", "split", color=LIVE)
    s.fit(elm.Resistor, (45.4, 24.4), (48.4, 24.4), "R506", "split", color=LIVE)
    s.wire((48.4, 24.4), (49.2, 24.4), color=LIVE)
    s.terminal(49.4, 24.4, "SENSE+", "right", color=LIVE)
    s.dot(43.8, low, color=LIVE)
    s.wire((43.8, low), (43.8, 27.0), (36.0, 27.0), (36.0, 22.2), (49.2, 22.2), color=LIVE)
    s.terminal(49.4, 22.2, "SENSE−", "right", color=LIVE)
    s.note(
        35.8,
        21.0,
        "SENSE+ by its own lead to the holder, SENSE− to the workpiece, not to\n"
        "GAP+ and GAP−: any lead of the electrode that breaks reads as contact.\n"
        f"Open gap {v('sense.open_v')}, contact below {v('sense.threshold')}; no supply: 0 V, contact.\n"
        f"Contact current {v('sense.amps')}. Always on. Electrode negative: swap SENSE+ and −.\n"
        f"U504 {PARTS['U504'].tolerance * 100:.0f} %, {data('U504', 'watts'):.0f} W, reinforced insulation for 300 V. D502 {label('D502')}. C502 50 V.\n"
        f"D503, D504 {label('D503')}. F501 quick, 500 V DC. R505, R506 wire-wound,\n"
        f"fusible, {data('R505', 'watts'):.0f} W each.",
    )


def sheet(book):
    s = Sheet(5, "Live signal, interlocks, sense supply", book)
    live(s)
    interlocks(s)
    enclosure(s)
    sense(s)
    s.legend(39.0, 7.9)
    return s
