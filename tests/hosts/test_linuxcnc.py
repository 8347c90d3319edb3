"""The component of the LinuxCNC machine, on a virtual head, with a stand-in for LinuxCNC: .ci/release runs it under LinuxCNC."""

import argparse
import pathlib
import sys
import threading
import types

import can

from heads import HANGS, Server, eventually

FOLDER = pathlib.Path(__file__).parents[2] / "examples" / "linuxcnc"
# The module of HAL comes with LinuxCNC; the component's classes need nothing of it but pins by name.
sys.modules.setdefault("hal", types.ModuleType("hal"))
sys.path.append(str(FOLDER))
import edm_head  # noqa: E402


class Pins(dict):
    """Pins of HAL: what nobody has set is 0."""

    def __init__(self):
        super().__init__()
        self.is_ready = False

    def __missing__(self, name):
        return 0

    def ready(self):
        self.is_ready = True


class Cnc:
    """LinuxCNC as far as the component sees it: the joints Z and W, external offsets, the feed."""

    # Velocity of moves and offsets, mm/s; F, mm/s.
    RAPID, FEED = 2.0, 0.05

    def __init__(self, server, **options):
        self.pins = Pins()
        args = {"interface": "slcan", "channel": server.tcp, "node": 1, "period_ms": 5, "speed": 1.0, "coarse_node": None}
        args |= {"stroke_mm": 10.0, "step_mm": 8.0, "reserve_mm": 0.05, "clearance_mm": 0.1} | options
        self.machine = edm_head.Machine(argparse.Namespace(**args), self.pins)
        # Where the program is and is to go, mm; whether the gap decides.
        self.z = self.target = 0.0
        self.adaptive = False
        self.offsets = {"z": 0.0, "w": 0.0}
        # Farthest from the commanded position: what the head told, and the feedback.
        self.error = self.deviation = 0.0
        send = self.machine.link.before
        self.machine.link.before = lambda: (self.move(), send())
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.ends = False

    def run(self):
        try:
            self.machine.run()
        except can.CanError:
            pass

    def move(self):
        """A period of the motion of LinuxCNC."""
        pins, period = self.pins, self.machine.link.period
        if self.ends:
            self.ends = False
            raise edm_head.Ended
        for axis in self.offsets:
            goal = pins[f"{axis}-offset"] * edm_head.OFFSET_MM
            by = goal - self.offsets[axis]
            self.offsets[axis] += max(-self.RAPID * period, min(self.RAPID * period, by))
        if not pins["inhibit"] and pins["enable"]:
            step = period * (self.FEED * pins["adaptive-feed"] if self.adaptive else self.RAPID)
            way = self.target - self.z
            self.z += max(-abs(way), min(abs(way), step)) * (1 if way > 0 else -1)
        if pins["enable"]:
            pins["z-cmd"], pins["w-cmd"] = self.z + self.offsets["z"], self.offsets["w"]
            self.error = max(self.error, abs(pins["z-error"]))
            self.deviation = max(self.deviation, abs(pins["z-fb"] - pins["z-cmd"]))
        else:
            self.z = self.target = pins["z-fb"]

    def __enter__(self):
        self.pins["feed"] = self.FEED
        self.thread.start()
        eventually("the component is ready", lambda: self.pins.is_ready)
        self.pins["close"] = True
        eventually("the loop is closed", lambda: not self.pins["fault"])
        self.pins["enable"] = True
        eventually("it follows", lambda: not self.pins["inhibit"])
        return self

    def __exit__(self, *_):
        self.ends = True
        self.thread.join(HANGS)
        assert not self.thread.is_alive()

    def go(self, z):
        """G0, or G1 by the gap."""
        self.target = z
        eventually(f"Z {z}", lambda: self.z == z or self.pins["fault"])
        assert not self.pins["fault"]

    def switch(self, pulses):
        """M3 or M5."""
        self.pins["pulses"] = pulses
        eventually("pulses", lambda: bool(self.pins["pulses-on"]) == pulses)


def test_it_bores_by_the_feed_of_the_gap_and_a_retreat_is_no_following_error(tmp_path):
    server = Server(tmp_path, "--set", "model.removal_um3_uj=2")
    with Cnc(server) as cnc:
        cnc.go(-1.96)
        eventually("it has come", lambda: abs(cnc.pins["z-fb"] + 1.96) < 0.002)
        cnc.switch(True)
        cnc.adaptive, cnc.deviation = True, 0.0
        server.tell("gap.short=true")
        eventually("it retreats", lambda: cnc.pins["retreating"])
        eventually("it is far away", lambda: cnc.pins["retreat-most"] > 0.2)
        server.tell("gap.short=false")
        eventually("it is back", lambda: not cnc.pins["retreating"])
        assert cnc.error > 0.2 and cnc.deviation < 0.05, (cnc.error, cnc.deviation)
        eventually("it is counted", lambda: cnc.pins["long-retreats"] == 1)
        cnc.go(-2.02)
        eventually("it is deep", lambda: abs(cnc.pins["deepest"] + 2.02) <= 0.002)
        # M5 in the middle of another retreat: it comes back without pulses.
        cnc.deviation = 0.0
        server.tell("gap.short=true")
        eventually("it retreats", lambda: cnc.pins["retreating"] and cnc.pins["z-error"] > 0.1)
        server.tell("gap.short=false")
        cnc.switch(False)
        assert cnc.pins["adaptive-feed"] == 1.0 and cnc.deviation <= edm_head.NEAR_MM
        cnc.adaptive = False
        cnc.go(-1.5)
    server.stop()


def test_a_touch_tells_the_surface_and_comes_back(tmp_path):
    server = Server(tmp_path)
    with Cnc(server) as cnc:
        cnc.go(-1.5)
        eventually("it has come", lambda: abs(cnc.pins["z-fb"] + 1.5) < 0.003)
        cnc.deviation = 0.0
        cnc.pins["touch"] = True
        eventually("it has touched", lambda: cnc.pins["touched"])
        cnc.pins["touch"] = False
        assert abs(cnc.pins["surface"] + 2) < 0.01
        eventually("it is back", lambda: abs(cnc.pins["z-fb"] + 1.5) < 0.003)
        assert cnc.error > 0.2 and cnc.deviation < 0.02, (cnc.error, cnc.deviation)
    server.stop()


def test_a_fault_of_the_head_is_one_of_its_amplifier_and_ends_with_the_cause(tmp_path):
    server = Server(tmp_path)
    with Cnc(server) as cnc:
        server.tell("bridge.fault=true")
        eventually("an amplifier fault", lambda: cnc.pins["fault"])
        cnc.pins["enable"] = cnc.pins["close"] = False
        server.tell("bridge.fault=false")
        eventually("it has been off", lambda: not cnc.pins["holds"])
        eventually("the reaction has ended", lambda: cnc.machine.head.status & 0x4F == 0x08)
        cnc.pins["close"] = True
        eventually("the loop is closed anew", lambda: not cnc.pins["fault"])
    server.stop()


def test_a_coarse_axis_carries_the_head_down_and_up_again(tmp_path):
    fast = ("workpiece.surface_mm=0.45", "model.removal_um3_uj=5", "model.flush_kpa=100")
    server = Server(tmp_path, "--coarse-axis", *(word for one in fast for word in ("--set", one)))
    with Cnc(server, coarse_node=2, stroke_mm=0.6, step_mm=0.3) as cnc:
        cnc.go(-0.4)
        cnc.switch(True)
        cnc.adaptive = True
        cnc.go(-0.65)
        cnc.switch(False)
        cnc.adaptive = False
        # At the end of the head's stroke once; its place and that of the coarse axis are the electrode's.
        assert cnc.pins["moves"] == 1 and abs(cnc.pins["w-fb"] + 0.3) <= 0.002
        assert abs(cnc.pins["deepest"] + 0.65) <= 0.003 and cnc.pins["z-fb"] > -0.6
        cnc.go(-0.1)
        eventually("the coarse axis is at its home", lambda: abs(cnc.pins["w-fb"]) <= 0.002)
        assert cnc.pins["moves"] == 2
    server.stop()
