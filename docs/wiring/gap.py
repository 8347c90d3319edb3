"""Sheet 2: gap voltage, comparators and gap current."""

import schemdraw.elements as elm

from components import data, label
from sheet import LIVE, Sheet


def divider(s):
    """Differential divider: five resistors a leg, clamp, bias, amplifier; one filter for each converter."""
    s.heading(0.6, 35.2, f"Gap voltage: differential divider {s.value('gap.ratio_n')}:1, clamp, offset, filters")
    v = s.value
    minus, plus = 30.0, 25.0
    for y, name, first in ((minus, "GAP−", 206), (plus, "GAP+", 201)):
        s.terminal(2.4, y, name, color=LIVE)
        s.wire((2.6, y), (5.4, y), color=LIVE)
        for i in range(5):
            x = 5.4 + 2.3 * i
            s.fit(elm.Resistor, (x, y), (x + 2.3, y), f"R{first + i}", "split", color=LIVE)
    s.box(3.4, plus - 0.9, 1.2, minus - plus + 1.8)
    s.text(4.0, 27.5, "FB1", "center")
    s.note(2.9, 23.6, f"FB1: both leads {label('FB1')}\nthrough one ferrite core,\nat the terminals")
    s.note(
        7.4,
        28.3,
        f"R201..R210: {label('R201')} 0.1 % 25 ppm 1206, {data('R201', 'volts'):.0f} V each.\n"
        "Others here 0.1 %. Keep 5 mm around this row.",
    )
    s.barrier(
        17.2,
        32.2,
        17.2,
        22.6,
        f"protective impedance, {s.value('gap.leg')}\na lead: {s.value('gap.fault_ma')} at {s.value('gap.high')}",
        11.0,
        32.2,
    )
    s.wire((16.9, minus), (28.0, minus), (28.0, 28.125), (28.4, 28.125))
    s.wire((16.9, plus), (28.0, plus), (28.0, 26.875), (28.4, 26.875))
    # Clamps: one low-leakage pair on each node.
    s.part(elm.Diode, (18.6, minus), (18.6, minus + 2.2), "½ D201")
    s.rail(18.6, minus + 2.2, "3V3A")
    s.part(elm.Diode, (18.6, minus - 2.2), (18.6, minus), "½ D201")
    s.ground(18.6, minus - 2.2)
    s.part(elm.Diode, (20.2, plus), (20.2, plus + 2.2), "½ D202")
    s.rail(20.2, plus + 2.2, "3V3A")
    s.part(elm.Diode, (20.2, plus - 2.2), (20.2, plus), "½ D202")
    s.ground(20.2, plus - 2.2)
    for x, y in ((18.6, minus), (22.6, minus), (20.2, plus), (24.6, plus)):
        s.dot(x, y)
    s.fit(elm.Resistor, (22.6, minus), (22.6, minus + 2.2), "R211")
    s.rail(22.6, minus + 2.2, "3V3A")
    s.fit(elm.Resistor, (24.6, plus), (24.6, plus + 2.2), "R212")
    s.rail(24.6, plus + 2.2, "3V3A")
    s.fit(elm.Resistor, (24.6, plus), (24.6, plus - 2.4), "R214", "left")
    s.fit(elm.Capacitor, (26.6, plus), (26.6, plus - 2.4), "C202")
    s.dot(26.6, plus)
    s.wire((24.6, plus - 2.4), (26.6, plus - 2.4))
    s.dot(25.6, plus - 2.4)
    s.wire((25.6, plus - 2.4), (25.6, plus - 3.0), (26.4, plus - 3.0))
    s.flag(26.4, plus - 3.0, f"VZ {s.value('gap.vz')}")
    _, _, out = s.amplifier(28.4, 28.125, "U201A")
    # Feedback sets the gain, and its capacitor the bandwidth.
    s.dot(26.4, minus)
    s.wire((26.4, minus), (26.4, 33.4), (28.0, 33.4))
    s.wire((26.4, 31.6), (28.0, 31.6))
    s.dot(26.4, 31.6)
    s.fit(elm.Resistor, (28.0, 31.6), (31.0, 31.6), "R213", "split")
    s.fit(elm.Capacitor, (28.0, 33.4), (31.0, 33.4), "C201", "split")
    s.wire((31.0, 33.4), (32.6, 33.4), (32.6, out[1]))
    s.wire((31.0, 31.6), (32.6, 31.6))
    s.dot(32.6, 31.6)
    s.wire(out, (34.4, out[1]))
    s.dot(32.6, out[1])
    s.dot(34.4, out[1])
    y = out[1]
    s.fit(elm.Resistor, (34.4, y), (38.0, y), "R215", "split")
    s.wire((38.0, y), (40.6, y))
    s.fit(elm.Capacitor, (39.0, y), (39.0, y - 2), "C203")
    s.ground(39.0, y - 2)
    s.dot(39.0, y)
    s.flag(40.6, y, "PC0 gap V, fixed rate")
    s.wire((34.4, y), (34.4, y - 4.2))
    s.fit(elm.Resistor, (34.4, y - 4.2), (38.0, y - 4.2), "R216", "split")
    s.dot(34.4, y - 4.2)
    s.wire((38.0, y - 4.2), (40.6, y - 4.2))
    s.fit(elm.Capacitor, (39.0, y - 4.2), (39.0, y - 6.2), "C204")
    s.ground(39.0, y - 6.2)
    s.dot(39.0, y - 4.2)
    s.flag(40.6, y - 4.2, "PC1 gap V, gate-synchronous")
    s.wire((34.4, y - 4.2), (34.4, 19.7), (35.2, 19.7))
    s.flag(35.2, 19.7, "VGAP to comparators")
    s.note(
        34.4,
        34.9,
        f"code = {v('gap.zero_n')} + (GAP+ − GAP−) / {v('gap.scale_n')} V    (3V3A = 3.30 V)\n"
        f"{v('gap.low')} = code 0,  0 V = {v('gap.zero_code')},  100 V = {v('gap.at_100')},  300 V = {v('gap.at_300')},  "
        f"{v('gap.high')} = 4095\n"
        f"corner at PC0 {v('fixed.hz')} ({v('fixed.tau')}), at PC1 {v('gated.hz')} ({v('gated.tau')})\n"
        f"U201 {label('U201')} on 3V3A, 100 nF at its supply; D201, D202 {label('D201')}",
    )


def offset(s):
    """Zero of the gap voltage, a tenth of the supply, so that the code of 0 V does not depend on the supply."""
    s.heading(0.6, 20.0, "Offset VZ")
    s.rail(3.0, 18.4, "3V3A")
    s.fit(elm.Resistor, (3.0, 18.4), (3.0, 16.0), "R217")
    s.fit(elm.Resistor, (3.0, 16.0), (3.0, 13.6), "R218")
    s.ground(3.0, 13.6)
    s.wire((3.0, 16.0), (8.8, 16.0))
    s.dot(3.0, 16.0)
    s.fit(elm.Capacitor, (6.0, 16.0), (6.0, 13.6), "C205")
    s.dot(6.0, 16.0)
    s.ground(6.0, 13.6)
    _, low, out = s.amplifier(8.8, 16.0, "U201B", plus="above")
    s.wire(low, (8.4, low[1]), (8.4, 13.4), (12.6, 13.4), (12.6, out[1]))
    s.wire(out, (13.2, out[1]))
    s.dot(12.6, out[1])
    s.flag(13.2, out[1], f"VZ {s.value('gap.vz')}")


def comparators(s):
    """Two thresholds; the lower follows the upper at 2/7 of its distance from the offset."""
    v = s.value
    s.heading(18.6, 20.0, "Gap comparators, 70 % and 20 % of open circuit")
    s.rail(20.4, 17.6, "3V3A")
    s.fit(elm.Resistor, (20.4, 17.6), (20.4, 15.4), "R219", "left")
    s._add(elm.Potentiometer().at((20.4, 15.4)).to((20.4, 12.8)))
    s.text(19.9, 14.1, f"RV201\n{label('RV201')}\n10 turns", "right")
    s.wire((20.4, 12.8), (20.4, 11.6))
    s.flag(20.4, 11.6, "VZ", to="left")
    s.wire((21.25, 14.1), (25.4, 14.1))
    s.text(21.6, 14.5, "VTH70", size=7.5)
    s.fit(elm.Capacitor, (23.4, 14.1), (23.4, 16.3), "C206")
    s.wire((23.4, 16.3), (22.4, 16.3))
    s.ground(22.4, 16.3)
    s.dot(23.4, 14.1)
    s.dot(25.4, 14.1)
    s.fit(elm.Resistor, (25.4, 14.1), (25.4, 11.7), "R220")
    s.fit(elm.Resistor, (25.4, 11.7), (25.4, 9.3), "R221")
    s.flag(25.4, 9.3, "VZ", to="left")
    s.dot(25.4, 11.7)
    s.wire((25.4, 11.7), (23.4, 11.7))
    s.fit(elm.Capacitor, (23.4, 11.7), (23.4, 9.5), "C207", "left")
    s.ground(23.4, 9.5)
    for y, ref, name, pin, r in (
        (15.6, 14.1, "U202A", "PC8 above 70 %", 222),
        (10.6, 11.7, "U202B", "PC9 above 20 %", 224),
    ):
        s.flag(30.6, y, "VGAP", to="left")
        s.fit(elm.Resistor, (30.6, y), (33.4, y), f"R{r}", "split")
        s.wire((33.4, y), (34.6, y))
        s.dot(34.0, y)
        _, low, out = s.amplifier(34.6, y, name, plus="above")
        s.wire((34.0, y), (34.0, y + 1.9), (34.8, y + 1.9))
        s.fit(elm.Resistor, (34.8, y + 1.9), (38.2, y + 1.9), f"R{r + 1}", "above")
        s.wire((38.2, y + 1.9), (38.8, y + 1.9), (38.8, out[1]))
        s.wire(out, (40.0, out[1]))
        s.dot(38.8, out[1])
        s.flag(40.0, out[1], pin)
        if ref == 14.1:
            s.wire((25.4, ref), (33.2, ref), (33.2, low[1]), low)
        else:
            s.wire((25.4, ref), (28.2, ref), (28.2, low[1]), low)
    s.note(
        28.4,
        8.6,
        f"VTH70 = {v('gap.vz')} + 0.7 × U / {v('gap.ratio_n')}; for U = 100 V set RV201 to {v('vth.70')} at VTH70; "
        f"VTH20 is then {v('vth.20')}. RV201 reaches U = {v('vth.top_v')}.\n"
        f"U202 {label('U202')} on 3V3A, 100 nF at its supply; hysteresis {v('vth.hysteresis_mv')} = "
        f"{v('vth.hysteresis_v')} of gap voltage; delay about {data('U202', 'delay_s') * 1e9:.0f} ns.",
    )


def current(s):
    """Shunt in the lead of the workpiece; its workpiece end is the star point."""
    v = s.value
    s.heading(0.6, 12.0, f"Gap current: shunt {v('current.shunt')} in the workpiece lead")
    s.terminal(2.4, 9.6, "GEN W", color=LIVE)
    s.wire((2.6, 9.6), (3.4, 9.6), color=LIVE, lw=2)
    s.part(
        elm.Resistor,
        (3.4, 9.6),
        (3.4, 5.2),
        "RS201 ∥ RS202",
        f"2 × {label('RS201')} 1 % {data('RS201', 'watts'):.0f} W",
        color=LIVE,
    )
    s.wire((2.6, 5.2), (3.4, 5.2), color=LIVE, lw=2)
    s.terminal(2.4, 5.2, "WORK", color=LIVE)
    s.dot(3.4, 5.2)
    s.wire((2.4, 4.4), (4.4, 4.4))
    s.wire((3.4, 5.2), (3.4, 4.4))
    s.dot(3.4, 4.4)
    s.wire((2.4, 4.4), (2.4, 4.0))
    s.wire((4.4, 4.4), (4.4, 4.0))
    s.earth(2.4, 4.0)
    s.ground(4.4, 4.0)
    s.text(5.4, 3.9, "star: workpiece, protective earth\nand control 0 V meet only here", size=7.5)
    top, low_y = 8.9, 5.9
    s.wire((3.4, top), (9.6, top))
    s.dot(3.4, top)
    s.dot(3.4, low_y)
    s.wire((3.4, low_y), (9.6, low_y))
    s.fit(elm.Resistor, (9.6, top), (12.4, top), "R226", "split")
    s.fit(elm.Resistor, (9.6, low_y), (12.4, low_y), "R227", "split")
    s.wire((12.4, top), (14.8, top), (14.8, 8.025), (15.2, 8.025))
    s.wire((12.4, low_y), (14.8, low_y), (14.8, 6.775), (15.2, 6.775))
    _, _, out = s.amplifier(15.2, 8.025, "U203A")
    s.dot(13.6, top)
    s.wire((13.6, top), (13.6, 10.4), (14.4, 10.4))
    s.fit(elm.Resistor, (14.4, 10.4), (17.8, 10.4), "R228", "split")
    s.wire((17.8, 10.4), (19.2, 10.4), (19.2, out[1]))
    s.dot(19.2, out[1])
    s.dot(13.2, low_y)
    s.fit(elm.Resistor, (13.2, low_y), (13.2, 3.5), "R229")
    s.flag(13.2, 3.5, "VM 1.65 V")
    s.wire(out, (19.6, out[1]))
    s.fit(elm.Resistor, (19.6, out[1]), (22.4, out[1]), "R230", "split")
    s.wire((22.4, out[1]), (24.2, out[1]))
    s.fit(elm.Capacitor, (23.2, out[1]), (23.2, out[1] - 2.2), "C208")
    s.dot(23.2, out[1])
    s.ground(23.2, out[1] - 2.2)
    s.flag(24.2, out[1], "PC2 gap I")
    s.note(
        0.6,
        2.4,
        f"0 A = code 2048; {v('gap.amps_per_code')}; {v('current.range')}. GEN W: the generator lead that goes to the work. "
        "Positive: current from electrode to workpiece. Electrode negative: swap R226 and R227 at the shunt.\n"
        f"U203 {label('U203')} on 3V3A; U203B buffers VM from R231 {label('R231')} / R232 {label('R232')} with C209 {label('C209')}. R226..R229 0.1 %;\n"
        f"R226 and R227 take four-wire taps on the shunt; D203, D204 {label('D203')} clamp both inputs as above.",
    )


def sheet(book):
    s = Sheet(2, "Gap voltage and current", book)
    divider(s)
    offset(s)
    comparators(s)
    current(s)
    s.legend(39.2, 7.4)
    return s
