"""Sheet 3: power of the drive, H-bridge, motor current and bus voltage."""

import schemdraw.elements as elm
import schemdraw.logic as logic

from components import data, given, label
from sheet import POWER, Sheet


def supply(s):
    """48 V, its store and the contact that the emergency stop opens."""
    s.heading(0.6, 35.2, "48 V supply of the drive")
    y = 32.4
    s.terminal(2.2, y, "+48 V", color=POWER)
    s.fit(elm.Fuse, (2.4, y), (5.4, y), "F301", color=POWER, extra=" slow")
    s.wire((5.4, y), (13.6, y), color=POWER)
    s.fit(elm.Capacitor, (7.2, y), (7.2, y - 2.8), "C301", color=POWER, extra="\n63 V")
    s.ground(7.2, y - 2.8)
    s.fit(elm.Resistor, (10.6, y), (10.6, y - 2.8), "R301", color=POWER, extra="\n1 W")
    s.ground(10.6, y - 2.8)
    s.part(elm.Switch, (13.6, y), (17.2, y), "K1 13-14", "", "below", color=POWER)
    s.wire((13.6, y), (13.6, y + 1.6), (14.0, y + 1.6), color=POWER)
    s.part(elm.Schottky, (17.0, y + 1.6), (14.0, y + 1.6), f"D301 {label('D301')}", "", color=POWER)
    s.wire((17.0, y + 1.6), (17.2, y + 1.6), (17.2, y), color=POWER)
    for x in (7.2, 10.6, 13.6, 17.2, 19.4, 22.6):
        s.dot(x, y, color=POWER)
    s.wire((17.2, y), (30.0, y), color=POWER)
    s.fit(elm.Capacitor, (19.4, y), (19.4, y - 2.8), "C302", color=POWER, extra=" 100 V\nceramic")
    s.ground(19.4, y - 2.8)
    s.wire((22.6, y), (22.6, y + 0.8), (23.2, y + 0.8), color=POWER)
    s.flag(23.2, y + 0.8, "VDRV", color=POWER)
    s.terminal(2.2, y - 2.0, "0 V")
    s.wire((2.4, y - 2.0), (4.0, y - 2.0), (4.0, y - 2.8))
    s.ground(4.0, y - 2.8)
    s.note(
        0.8,
        28.2,
        f"K1: {label('K1')}, opened {data('K0', 'off_delay_s')} s after the emergency stop (sheet 5).\n"
        "D301 takes the energy of a braked head back to C301 when K1 is open.\n"
        f"C301: {given('heavy_kg')} kg at {given('fast_m_s')} m/s returns {s.value('drive.energy')}: {given('bus_v'):.0f} V rises to "
        f"{s.value('drive.lifted')}; U303 ends at {data('U303', 'high_v'):.0f} V.",
    )


def logic_inputs(s):
    """PWM and two directions to two half-bridge inputs and one enable."""
    s.heading(0.6, 24.6, "PWM, direction and enable: off without a processor")
    y_pwm, y_fwd, y_rev = 22.2, 19.2, 14.4
    for y, name, r in ((y_pwm, "PA8 PWM", 302), (y_fwd, "PB13 forward", 303), (y_rev, "PB0 reverse", 304)):
        s.flag(5.2, y, name, to="left")
        s.wire((5.2, y), (6.6, y))
        s.dot(6.6, y)
        s.fit(elm.Resistor, (6.6, y), (6.6, y - 2.2), f"R{r}", "left")
        s.ground(6.6, y - 2.2)
    # Two AND gates share the PWM; the OR gate enables, and the latch of the live signal has to agree.
    g1 = s._add(logic.And().at((14.0, 21.0)).anchor("in1").right()).absanchors
    g2 = s._add(logic.And().at((14.0, 17.4)).anchor("in1").right()).absanchors
    g3 = s._add(logic.Or().at((13.4, 13.6)).anchor("in1").right()).absanchors
    s.text(14.9, 21.9, "U301A", "center", size=7.5)
    s.text(14.9, 18.3, "U301B", "center", size=7.5)
    s.text(14.3, 14.5, "U302A", "center", size=7.5)
    s.wire((6.6, y_pwm), (11.0, y_pwm), (11.0, g1["in1"][1]), g1["in1"])
    s.wire((11.0, g1["in1"][1]), (11.0, g2["in1"][1]), g2["in1"])
    s.dot(11.0, g1["in1"][1])
    s.wire((6.6, y_fwd), (9.6, y_fwd), (9.6, g1["in2"][1]), g1["in2"])
    s.wire((9.6, y_fwd), (9.6, g3["in1"][1]), g3["in1"])
    s.dot(9.6, y_fwd)
    s.wire((6.6, y_rev), (12.4, y_rev), (12.4, g2["in2"][1]), g2["in2"])
    s.wire((12.4, y_rev), (12.4, g3["in2"][1]), g3["in2"])
    s.dot(12.4, y_rev)
    out = g3["out"]
    g4 = s._add(logic.And().at((out[0] + 0.2, out[1])).anchor("in1").right()).absanchors
    s.text(g4["in1"][0] + 0.9, out[1] + 0.65, "U301C", "center", size=7.5)
    s.wire(out, g4["in1"])
    x, y = g4["in2"]
    s.wire((x, y), (x, 11.4), (13.6, 11.4))
    s.flag(13.6, 11.4, "ARMED, sheet 5", to="left")
    return g1["out"], g2["out"], g4["out"]


def bridge(s, outs):
    """L6206 with both bridges in parallel, fault to the timer's break input."""
    in1, in2, enable = (tuple(p) for p in outs)
    x, y, w, h = 25.4, 9.4, 7.2, 15.0
    pins = s.chip(
        x,
        y,
        w,
        h,
        f"U303\n{label('U303')}\nboth bridges\nin parallel",
        left=[(12.6, "IN1 A+B"), (9.8, "IN2 A+B"), (6.2, "EN A+B"), (3.6, "OCD A+B"), (1.2, "PROGCL A+B")],
        right=[(11.4, "OUT1 A+B"), (4.6, "OUT2 A+B")],
        top=[(1.4, "VS A+B"), (4.2, "VBOOT"), (6.2, "VCP")],
        bottom=[(2.0, "SENSE A+B"), (5.4, "GND")],
    )
    for out, pin in ((in1, "IN1 A+B"), (in2, "IN2 A+B")):
        px, py = pins[pin]
        s.wire(out, (19.0, out[1]), (19.0, py), (px, py))
    # Enable: slow on through R305, fast off through D302 from the gate or from the fault output.
    ex, ey = pins["EN A+B"]
    s.wire(enable, (18.0, enable[1]), (18.0, ey), (18.2, ey))
    s.fit(elm.Resistor, (18.2, ey), (20.8, ey), "R305", "split")
    s.wire((20.8, ey), (ex, ey))
    s.dot(18.0, enable[1])
    s.wire((18.0, enable[1]), (18.2, enable[1]))
    s.part(elm.Schottky, (20.8, enable[1]), (18.2, enable[1]), "½ D302", "", "below")
    s.wire((20.8, enable[1]), (21.2, enable[1]), (21.2, ey))
    s.dot(21.2, ey)
    s.fit(elm.Capacitor, (22.4, ey), (22.4, ey + 1.9), "C303")
    s.dot(22.4, ey)
    s.wire((22.4, ey + 1.9), (21.6, ey + 1.9))
    s.ground(21.6, ey + 1.9)
    ox, oy = pins["OCD A+B"]
    s.part(elm.Schottky, (24.0, ey), (24.0, oy), "", "")
    s.text(23.6, (ey + oy) / 2 - 0.1, "½ D302", "right")
    s.dot(24.0, ey)
    s.wire((ox, oy), (22.4, oy), (22.4, 8.6), (21.2, 8.6))
    s.dot(24.0, oy)
    s.dot(22.4, 10.4)
    s.fit(elm.Resistor, (22.4, 10.4), (19.4, 10.4), "R306", "split")
    s.wire((19.4, 10.4), (19.0, 10.4))
    s.rail(19.0, 10.4, "3V3")
    s._add(logic.Buf().at((21.2, 8.6)).left())
    s.text(20.2, 7.9, "U302B", "center", size=7.5)
    s.wire((19.4, 8.6), (17.0, 8.6))
    s.dot(17.8, 8.6)
    s.fit(elm.Resistor, (17.8, 8.6), (17.8, 6.8), "R311")
    s.ground(17.8, 6.8)
    s.flag(17.0, 8.6, "PB12 bridge fault, low", to="left")
    px, py = pins["PROGCL A+B"]
    s.wire((px, py), (px, 8.2))
    s.ground(px, 8.2)
    for pin in ("SENSE A+B", "GND"):
        bx, by = pins[pin]
        s.wire((bx, by), (bx, 8.2))
        s.ground(bx, 8.2)
    # Charge pump as in the data sheet.
    vx, vy = pins["VS A+B"]
    s.wire((vx, vy), (vx, 32.4), color=POWER)
    bx, by = pins["VBOOT"]
    cx, cy = pins["VCP"]
    s.part(elm.Capacitor, (vx, 26.6), (bx, 26.6), "", "")
    s.text((vx + bx) / 2, 26.1, f"C304 {label('C304')}", "center", "top", size=7.5)
    s.dot(vx, 26.6, color=POWER)
    s.wire((bx, by), (bx, 30.4))
    s.dot(bx, 26.6)
    s.fit(elm.Resistor, (cx, cy), (cx, cy + 2.2), "R307")
    s.fit(elm.Capacitor, (cx, cy + 2.2), (cx, 29.2), "C305")
    s.wire((cx, 29.2), (cx, 30.4))
    s.part(elm.Diode, (cx, 30.4), (bx, 30.4), "", "")
    s.text((cx + bx) / 2, 30.0, "D303", "center", "top")
    s.wire((cx, 30.4), (34.2, 30.4), (34.2, 32.4))
    s.dot(cx, 30.4)
    s.part(elm.Diode, (vx, 32.4), (34.2, 32.4), "D304")
    s.dot(vx, 32.4, color=POWER)
    return pins["OUT1 A+B"], pins["OUT2 A+B"]


def motor(s, outs):
    """Coil, with its current measured in one lead, in either direction."""
    (x1, y1), (x2, y2) = outs
    s.wire((x1, y1), (34.6, y1), color=POWER)
    s.fit(elm.Resistor, (34.6, y1), (38.4, y1), "RS301", color=POWER, extra=" 1 % 1 W")
    s.wire((38.4, y1), (45.8, y1), color=POWER)
    s.terminal(46.0, y1, "COIL+", "right", color=POWER)
    s.wire((x2, y2), (45.8, y2), color=POWER)
    s.terminal(46.0, y2, "COIL−", "right", color=POWER)
    s.part(
        elm.Inductor2,
        (46.0, y1 - 0.2),
        (46.0, y2 + 0.2),
        "moving coil",
        f"R {given('coil_ohm')} Ω\nL {given('coil_h') * 1e3:.0f} mH (assumed)\nK {given('force_n_a')} N/A",
        color=POWER,
    )
    s.note(
        35.4,
        y1 + 2.6,
        "COIL+ positive: force toward the work (down).\nTwisted pair, screened; screen to earth at the board end.",
    )
    pins = s.chip(
        37.0,
        6.8,
        4.6,
        4.4,
        f"U304\n{label('U304')}\ngain {data('U304', 'gain'):.0f}",
        left=[(3.3, "IN+"), (1.1, "IN−")],
        right=[(2.2, "OUT")],
    )
    s.wire((34.6, y1), (34.6, pins["IN+"][1]), pins["IN+"], color=POWER)
    s.dot(34.6, y1, color=POWER)
    s.wire((38.4, y1), (38.4, 16.0), (35.6, 16.0), (35.6, pins["IN−"][1]), pins["IN−"], color=POWER)
    s.dot(38.4, y1, color=POWER)
    ox, oy = pins["OUT"]
    s.fit(elm.Resistor, (ox, oy), (ox + 2.6, oy), "R308", "split")
    s.wire((ox + 2.6, oy), (ox + 4.4, oy))
    s.dot(ox + 3.4, oy)
    s.fit(elm.Capacitor, (ox + 3.4, oy), (ox + 3.4, oy - 2.2), "C306")
    s.ground(ox + 3.4, oy - 2.2)
    s.flag(ox + 4.4, oy, "PC3 motor I")
    s.note(
        36.4,
        6.3,
        "U304 on 3V3A, REF1 to 3V3A, REF2 to 0 V, 100 nF.\n"
        f"0 A = code 2048, {s.value('motor.amps_per_code')}, {s.value('motor.range')}; filter {s.value('motor.hz')}",
    )


def bus_voltage(s):
    """Divider of the bridge's own supply, so that an open K1 is detected."""
    s.heading(37.0, 33.8, "Bus voltage")
    s.flag(39.0, 32.4, "VDRV", to="left", color=POWER)
    s.wire((39.0, 32.4), (40.4, 32.4), color=POWER)
    s.fit(elm.Resistor, (40.4, 32.4), (40.4, 29.8), "R309", "left", extra=" 1 %")
    s.fit(elm.Resistor, (40.4, 29.8), (40.4, 27.2), "R310", "left", extra=" 1 %")
    s.ground(40.4, 27.2)
    s.dot(40.4, 29.8)
    s.wire((40.4, 29.8), (44.0, 29.8))
    s.fit(elm.Capacitor, (42.4, 29.8), (42.4, 27.2), "C307")
    s.dot(42.4, 29.8)
    s.ground(42.4, 27.2)
    s.flag(44.0, 29.8, "PA3 bus voltage")
    s.note(
        45.2,
        28.9,
        f"{s.value('motor.bus_volts_per_code')}\n48 V = {s.value('bus.at_48')}\n{s.value('bus.full')} = 4095\nfilter {s.value('bus.hz')}",
    )


def meaning(s):
    """What the inputs do, and why the enable is not the PWM."""
    s.heading(0.6, 7.0, "What the three outputs of the processor do")
    rows = [
        ("forward", "reverse", "bridge"),
        ("1", "0", "drives toward the work for the PWM's share, brakes for the rest: mean voltage = duty × VDRV"),
        ("0", "1", "drives away from the work likewise"),
        ("1", "1", "brakes whatever the PWM is: both ends of the coil follow it"),
        (
            "0",
            "0",
            "coasts: U302A disables the bridge; so do reset, no processor (R302..R304) and a stopped program (ARMED low)",
        ),
    ]
    for i, (fwd, rev, what) in enumerate(rows):
        y = 6.1 - 0.72 * i
        s.text(2.0, y, fwd, "center", size=7.5)
        s.text(4.6, y, rev, "center", size=7.5)
        s.text(6.2, y, what, size=7.5)
    s.wire((0.8, 5.75), (32.5, 5.75))
    s.note(
        0.8,
        2.7,
        f"U301 {label('U301')}, U302 {label('U302')} on 3V3, U302B as a buffer; R311 at the processor: unplugged reads as fault. "
        f"D302 {label('D302')}: EN falls at once, rises after {s.value('drive.enable')} (R305 C303).\n"
        f"A fault of U303 ({data('U303', 'trip_a')} A a bridge, or too hot) pulls OCD low: bridge off by D302, PWM off by TIM1 BKIN.\n"
        f"Charge pump D303, D304 {label('D303')}, C304, C305, R307: as in the data sheet of the L6206.",
    )


def sheet(book):
    s = Sheet(3, "Drive", book)
    supply(s)
    outs = logic_inputs(s)
    motor(s, bridge(s, outs))
    bus_voltage(s)
    meaning(s)
    return s
