#!/usr/bin/env python3
"""Component of LinuxCNC: an EDM servo head on CAN as an axis that follows, and the feed that its gap allows.

Each period it sends the position that LinuxCNC commands (CiA 402, cyclic synchronous position) and a SYNC, and passes on what
the head answers: position, adaptive feed, gap voltage, state, counters. With pulses on the head is guided (2001h:1 = 2).
`touch` looks for the surface of the work. With `--coarse-node` another drive, axis W, carries the head: when the stroke of the head ends, the component holds the
program and moves W and Z against each other by external offsets (inch-worm). docs/hosts.md says how to start it.
"""

import argparse
import os
import signal
import struct
import sys
import time

import can
import hal

# Node-ID that this program's heartbeats carry, their period and the longest silence of either side, s.
HOST, BEAT, SILENCE = 127, 0.1, 1.0
# States of 2000h:1.
RETREATING, GUIDING = 5, 11
# Outcomes of a search for the surface, 2011h:3.
RUNS, FOUND = 1, 2
# Bits of the statusword: reached, follows the set points (modes 8 and 9).
REACHED, FOLLOWS = 1 << 10, 1 << 12
# Objects of the PDOs: index, sub-index, bits. The first two of each are sent with every SYNC, the others with every 20th.
RECEIVED = [(0x6040, 0, 16), (0x607A, 0, 32)]
SENT = [
    [(0x6041, 0, 16), (0x6064, 0, 32), (0x2004, 8, 16)],
    [(0x2000, 1, 8), (0x2000, 2, 8), (0x2000, 8, 8), (0x6061, 0, 8), (0x2005, 1, 16)],
    [(0x2006, 1, 32), (0x2006, 2, 32)],
    [(0x2006, 6, 32), (0x2006, 3, 32)],
]
FORMATS = ["<Hih", "<BBBbh", "<II", "<II"]
# mm per count of an external offset, what counts as arrived, and as close enough to follow, mm.
OFFSET_MM, ARRIVED_MM, NEAR_MM = 1e-4, 0.0015, 0.05


class Trouble(Exception):
    """What the drive refuses, or does not do: the joint of LinuxCNC gets an amplifier fault."""


class Ended(BaseException):
    """LinuxCNC ends the component; no error of the bus."""


class Drive:
    """A node: what it has sent last, and what it is to receive with the next SYNC."""

    def __init__(self, name, node):
        self.name, self.node = name, node
        self.word, self.target = 0, 0
        self.status, self.position, self.share = 0, 0, 0
        self.state, self.fault, self.guidance, self.mode, self.volts = 0, 0, 0, 0, 0
        self.shorts, self.long, self.late, self.eroding_ms = 0, 0, 0, 0
        self.counts_per_mm = 1000.0
        self.heard = None
        self.answer = None

    def take(self, frame):
        """A frame of this node."""
        ident, data = frame.arbitration_id - self.node, bytes(frame.data)
        if ident == 0x580:
            self.answer = data
            return
        if ident not in (0x180, 0x280, 0x380, 0x480):
            return
        values = struct.unpack(FORMATS[(ident - 0x180) >> 8], data)
        if ident == 0x180:
            self.status, self.position, self.share = values
            self.heard = time.monotonic()
        elif ident == 0x280:
            self.state, self.fault, self.guidance, self.mode, self.volts = values
        elif ident == 0x380:
            self.shorts, self.long = values
        else:
            self.late, self.eroding_ms = values

    def mm(self):
        """Where it is, mm, up is positive."""
        return -self.position / self.counts_per_mm

    def go(self, mm):
        """Where it is to be."""
        self.target = round(-mm * self.counts_per_mm)


class Link:
    """The bus, the drives on it and the period."""

    def __init__(self, bus, drives, period_ms, speed):
        self.bus, self.drives, self.period_ms, self.period = bus, drives, period_ms, period_ms / 1000 / speed
        self.patience = 1 / speed
        self.due = self.beaten = time.monotonic()
        self.synchronous = False
        # What is done in every period: before the set points are sent, and after an answer has come.
        self.before = self.after = lambda: None

    def send(self, ident, data=b""):
        self.bus.send(can.Message(arbitration_id=ident, data=data, is_extended_id=False))

    def cycle(self):
        """To the end of the period: takes what comes; then set points, SYNC, heartbeat."""
        while (left := self.due - time.monotonic()) > 0:
            if frame := self.bus.recv(left):
                for drive in self.drives:
                    if frame.arbitration_id & 0x7F == drive.node:
                        drive.take(frame)
                        self.after()
        now = time.monotonic()
        # What could not be sent in time is not sent later in a heap.
        self.due = max(self.due + self.period, now - self.period)
        self.before()
        if self.synchronous:
            for drive in self.drives:
                self.send(0x200 + drive.node, struct.pack("<Hi", drive.word, drive.target))
            self.send(0x80)
        if now - self.beaten >= BEAT:
            self.beaten = now
            self.send(0x700 + HOST, b"\x05")

    def wait(self, what, done, seconds=3.0):
        """Periods until something is so."""
        end = time.monotonic() + seconds * self.patience
        while not done():
            self.cycle()
            if time.monotonic() > end:
                raise Trouble(f"waited {seconds:g} s for {what} in vain")

    def _request(self, drive, index, sub, data):
        drive.answer = None
        self.send(0x600 + drive.node, data)
        self.wait(f"an answer of {drive.name}", lambda: drive.answer)
        if drive.answer[0] == 0x80:
            (code,) = struct.unpack("<I", drive.answer[4:])
            raise Trouble(f"{drive.name} refuses {index:04X}h:{sub} with {code:08X}h")
        return drive.answer[4:]

    def write(self, drive, index, sub, bits, value):
        """Writes an object by SDO."""
        head = struct.pack("<BHB", 0x23 | (4 - bits // 8) << 2, index, sub)
        self._request(drive, index, sub, head + (value & 0xFFFFFFFF).to_bytes(4, "little"))

    def read(self, drive, index, sub):
        """Reads an unsigned object by SDO."""
        return int.from_bytes(self._request(drive, index, sub, struct.pack("<BHBxxxx", 0x40, index, sub)), "little")

    def map(self, drive, communication, cob, kind, objects):
        """Maps a PDO; 1600h and 1A00h are 200h behind 1400h and 1800h."""
        self.write(drive, communication, 1, 32, cob | 1 << 31)
        self.write(drive, communication + 0x200, 0, 8, 0)
        if objects:
            self.write(drive, communication, 2, 8, kind)
            for number, (index, sub, bits) in enumerate(objects, 1):
                self.write(drive, communication + 0x200, number, 32, index << 16 | sub << 8 | bits)
            self.write(drive, communication + 0x200, 0, 8, len(objects))
            self.write(drive, communication, 1, 32, cob)

    def set_up(self, drive):
        """PDOs, period and heartbeats; then operational."""
        self.send(0, bytes([128, drive.node]))
        for number in range(4):
            self.map(drive, 0x1400 + number, 0x200 + (number << 8) + drive.node, 1, [] if number else RECEIVED)
            self.map(drive, 0x1800 + number, 0x180 + (number << 8) + drive.node, 20 if number > 1 else 1, SENT[number])
        self.write(drive, 0x60C2, 1, 8, self.period_ms)
        self.write(drive, 0x1016, 1, 32, HOST << 16 | round(1000 * SILENCE))
        # The drive watches from the next one on: before it can be enabled.
        self.send(0x700 + HOST, b"\x05")
        drive.counts_per_mm = self.read(drive, 0x608F, 1) / self.read(drive, 0x608F, 2)
        self.send(0, bytes([1, drive.node]))

    def enable(self, drive):
        """Closes the loop, and homes a drive that is not: home is where it rests."""
        self.wait(f"{drive.name}", lambda: drive.heard)
        if drive.status & 0x4F == 0x08:
            drive.word = 0x80
        self.wait("the end of the fault", lambda: drive.status & 0x4F != 0x08)
        for word, state in ((0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)):
            drive.word = word
            try:
                self.wait(f"controlword {word:02X}h of {drive.name}", lambda state=state: drive.status & 0x6F == state)
            except Trouble as trouble:
                raise Trouble(f"{trouble}; 2000h:4 = {self.read(drive, 0x2000, 4)}, as docs/objects.md numbers it") from None
        if not self.read(drive, 0x2000, 5):
            self.write(drive, 0x6098, 0, 8, 35)
            self.write(drive, 0x6060, 0, 8, 6)
            drive.word = 0x1F
            self.wait(f"the home of {drive.name}", lambda: drive.status & 0x3400 == 0x1400, 10)
            drive.word = 0x0F
        self.wait("the position at the home", lambda: not drive.status & 0x2000)
        for _ in range(3):
            self.cycle()
        drive.target = drive.position
        self.write(drive, 0x6060, 0, 8, 8)
        self.wait("mode 8", lambda: drive.mode == 8)

    def disable(self, drive):
        drive.word = 0
        try:
            self.wait(f"{drive.name} to be off", lambda: drive.status & 0x6F != 0x27)
        except Trouble as trouble:
            print(f"edm-head: {trouble}", flush=True)


class Machine:
    """The axes of LinuxCNC that this component drives."""

    def __init__(self, args, pins):
        self.args, self.pins = args, pins
        more = {"sleep_after_open": 0.1} if args.interface == "slcan" else {}
        bus = can.Bus(interface=args.interface, channel=args.channel, bitrate=1_000_000, **more)
        self.head = Drive("the head", args.node)
        self.coarse = Drive("the coarse axis", args.coarse_node) if args.coarse_node else None
        self.link = Link(bus, [self.head] + ([self.coarse] if self.coarse else []), args.period_ms, args.speed)
        self.link.before, self.link.after = self.command, self.publish
        # Apart, the head moves by itself with pulses off.
        self.following = self.guided = self.apart = False
        self.feed = 0.0
        # Of the external offsets, mm.
        self.carried = 0.0

    def command(self):
        """Set points of the next period, from LinuxCNC."""
        if self.following:
            self.head.go(self.pins["z-cmd"])
            if self.coarse:
                self.coarse.go(self.pins["w-cmd"])

    def publish(self):
        """What the head has sent, for LinuxCNC."""
        pins, head = self.pins, self.head
        leads = self.guided and not head.status & FOLLOWS
        pins["retreating"] = leads
        # While the head leads, in a retreat from a short or a touch and on the way back, its distance is no following error.
        error = head.mm() - pins["z-cmd"]
        pins["z-fb"] = pins["z-cmd"] if leads or self.apart else head.mm()
        pins["z-error"] = error if self.following or self.apart else 0.0
        if leads:
            pins["retreat-most"] = max(pins["retreat-most"], error)
        pins["adaptive-feed"] = max(-1.0, min(1.0, head.share / 1000)) if self.guided else 1.0
        pins["gap-feed"] = head.share / 1000 * self.feed if self.guided else 0.0
        pins["gap-voltage"] = head.volts / 100
        pins["state"] = head.state
        pins["shorts"], pins["long-retreats"], pins["late"] = head.shorts, head.long, head.late
        pins["eroding-s"] = head.eroding_ms / 1000
        # The coarse axis carries the head: both together are the place of the electrode.
        pins["place"] = head.mm() + (self.coarse.mm() if self.coarse else 0.0)
        if self.guided:
            pins["deepest"] = min(pins["deepest"], pins["place"])
        pins["erodes"] = self.guided and not leads
        pins["fault-number"] = head.fault
        if self.coarse:
            pins["w-fb"] = self.coarse.mm()
            pins["w-fault"] = pins["fault"]

    def check(self):
        """Raises when a drive has a fault, or is silent."""
        for drive in self.link.drives:
            if drive.status & 0x4F in (0x08, 0x0F):
                raise Trouble(f"{drive.name} has fault {drive.fault}, as docs/objects.md numbers it (2000h:2)")
            if time.monotonic() - drive.heard > SILENCE * self.link.patience:
                raise Trouble(f"{drive.name} has been silent for {SILENCE:g} s")
        if self.guided and self.head.state not in (GUIDING, RETREATING):
            raise Trouble(f"the head is guided no more: state {self.head.state} (2000h:1)")

    def pulses(self, on):
        """Guided with pulses, or without."""
        if not on:
            # Out of a retreat it comes back without pulses.
            self.apart, self.guided = not self.head.status & FOLLOWS, False
        self.link.write(self.head, 0x2001, 1, 8, 2 if on else 0)
        self.link.wait("the head to be guided", lambda: (self.head.state in (GUIDING, RETREATING)) == on)
        if self.apart:
            self.link.wait("the way back", lambda: abs(self.head.mm() - self.pins["z-cmd"]) <= NEAR_MM, 30)
        self.apart, self.guided = False, on

    def touch(self):
        """The head looks for the work below it by itself, pulses off, and comes back to where LinuxCNC has it."""
        head, link, pins = self.head, self.link, self.pins
        self.apart, self.following = True, False
        link.write(head, 0x6060, 0, 8, 1)
        link.wait("mode 1", lambda: head.mode == 1)
        link.write(head, 0x2011, 1, 8, 1)
        outcome = RUNS
        while outcome == RUNS:
            self.check()
            outcome = link.read(head, 0x2011, 3)
        if outcome != FOUND:
            raise Trouble(f"no surface: {outcome}, as docs/objects.md numbers it (2011h:3)")
        counts = link.read(head, 0x2001, 6)
        counts -= (counts & 1 << 31) << 1
        pins["surface"] = -counts / head.counts_per_mm + (self.coarse.mm() if self.coarse else 0.0)
        head.go(pins["z-cmd"])
        link.cycle()
        head.word = 0x1F
        link.wait("the set point to be taken", lambda: head.status & 1 << 12)
        head.word = 0x0F
        link.wait("the way back", lambda: head.status & REACHED and abs(head.mm() - pins["z-cmd"]) <= ARRIVED_MM, 30)
        link.write(head, 0x6060, 0, 8, 8)
        link.wait("mode 8", lambda: head.mode == 8)
        self.apart, self.following = False, True
        print(f"edm-head: the surface is at {pins['surface']:.4f} mm", flush=True)

    def follow_feed(self):
        """What 1000 of 2004h:8 stand for is F of the program."""
        feed = self.pins["feed"] * 1000
        if feed > 0 and feed != self.feed:
            self.feed = feed
            self.link.write(self.head, 0x2001, 8, 32, round(feed))

    def offset(self, axis, mm):
        """Moves an external offset, and waits until the axis has gone there."""
        pins, drive = self.pins, self.coarse if axis == "w" else self.head
        goal = pins[f"{axis}-cmd"] + mm
        pins[f"{axis}-offset"] += round(mm / OFFSET_MM)
        at_it = lambda: abs(pins[f"{axis}-cmd"] - goal) < 1e-5 and abs(drive.mm() - goal) <= ARRIVED_MM
        self.link.wait(f"the external offset of {axis.upper()}", at_it, 30)
        self.check()

    def carry(self, mm):
        """The coarse axis goes by so much, and the head against it: the electrode stays where it is."""
        pins, resume = self.pins, self.guided
        # LinuxCNC comes to rest.
        since, last = time.monotonic(), None
        while time.monotonic() - since < 0.1:
            if last != pins["z-cmd"]:
                since, last = time.monotonic(), pins["z-cmd"]
            self.link.cycle()
            self.check()
        if resume:
            # The head may lead just now.
            self.link.wait("the head to return", lambda: self.head.status & FOLLOWS, 30)
            self.pulses(False)
        if mm < 0:
            self.offset("z", self.args.clearance_mm - mm)
            self.offset("w", mm)
            self.offset("z", -self.args.clearance_mm)
        else:
            self.offset("w", mm)
            self.offset("z", -mm)
        self.carried += mm
        pins["moves"] += 1
        print(f"edm-head: coarse axis by {mm:+.3f} mm, it is at {self.coarse.mm():.4f}, the head at {self.head.mm():.4f}", flush=True)
        if resume:
            self.pulses(True)

    def inch(self):
        """Moves the coarse axis when the stroke of the head ends."""
        z, step, reserve = self.pins["z-cmd"], self.args.step_mm, self.args.reserve_mm
        if z < reserve - self.args.stroke_mm:
            way = -step
        elif z > -reserve and self.carried < -OFFSET_MM:
            way = min(step, -self.carried)
        else:
            return
        self.pins["inhibit"] = True
        self.carry(way)

    def close(self):
        """Closes the loops; the head holds where it is."""
        for drive in self.link.drives:
            self.link.enable(drive)
        if self.coarse:
            self.link.write(self.head, 0x607D, 2, 32, round(self.args.stroke_mm * self.head.counts_per_mm))
        self.publish()
        self.pins["holds"] = True
        self.link.cycle()
        self.pins["fault"] = False

    def follow(self):
        """As long as LinuxCNC has the machine on."""
        pins = self.pins
        # What LinuxCNC has forgotten with the machine off.
        pins["z-offset"] = pins["w-offset"] = 0
        self.carried, self.feed = 0.0, 0.0
        for axis, drive in (("z", self.head), ("w", self.coarse)):
            if drive and abs(pins[f"{axis}-cmd"] - drive.mm()) > NEAR_MM:
                raise Trouble(f"LinuxCNC has {axis.upper()} at {pins[f'{axis}-cmd']:.3f} mm, it is at {drive.mm():.3f}")
        self.following = True
        while pins["enable"] and pins["close"]:
            self.link.cycle()
            self.check()
            if pins["pulses"] != self.guided:
                pins["inhibit"] = True
                if pins["pulses"]:
                    if self.coarse and abs(pins["w-cmd"] - self.carried) > ARRIVED_MM:
                        raise Trouble(f"W is at {pins['w-cmd']:.3f} mm: it has to be at its home before pulses are switched on")
                    pins["deepest"] = 0.0
                self.pulses(bool(pins["pulses"]))
            if self.guided:
                self.follow_feed()
            if pins["touch"] and not pins["touched"]:
                if self.guided:
                    raise Trouble("a touch needs pulses off (M5)")
                pins["inhibit"] = True
                self.touch()
            pins["touched"] = pins["touch"]
            if self.coarse:
                self.inch()
            pins["inhibit"], pins["pulses-on"] = False, self.guided
        if self.guided:
            self.pulses(False)

    def run(self):
        """Until LinuxCNC ends it."""
        pins = self.pins
        for drive in self.link.drives:
            self.link.set_up(drive)
        self.link.synchronous = True
        pins["fault"] = pins["inhibit"] = True
        pins["retreat-most"], pins["moves"], broken = 0.0, 0, False
        self.link.wait("the drives", lambda: all(drive.heard for drive in self.link.drives))
        pins.ready()
        try:
            while True:
                self.link.cycle()
                if not pins["close"]:
                    broken = False
                    if pins["holds"]:
                        self.off()
                    continue
                try:
                    if not broken and not pins["holds"]:
                        self.close()
                    if not broken:
                        self.check()
                    if not broken and pins["enable"]:
                        self.follow()
                        self.following = self.guided = False
                        pins["inhibit"] = True
                except Trouble as trouble:
                    print(f"edm-head: {trouble}", flush=True)
                    broken = True
                    self.off()
        except Ended:
            pass
        finally:
            self.off()
            for drive in self.link.drives:
                # Whoever comes next has a watch of its own.
                self.link.write(drive, 0x1016, 1, 32, 0)
            self.link.bus.shutdown()

    def off(self):
        """The loops are open, pulses are off, the program is held."""
        self.following = self.guided = self.apart = False
        self.pins["fault"] = self.pins["inhibit"] = True
        self.pins["holds"] = self.pins["pulses-on"] = False
        for drive in self.link.drives:
            self.link.disable(drive)


def end(*_):
    # Once: what switches off is not to be interrupted.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise Ended


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--interface", default="slcan", help="python-can's name of the way onto the bus [%(default)s]")
    parser.add_argument("--channel", default="socket://127.0.0.1:3333", help="its channel [%(default)s]")
    parser.add_argument("--node", type=int, default=1, help="node-ID of the head [%(default)s]")
    parser.add_argument("--period-ms", type=int, default=5, help="of set points [%(default)s]")
    parser.add_argument("--speed", type=float, default=1.0, help="of a virtual head's time, where a PC is too slow for 1 [%(default)s]")
    parser.add_argument("--coarse-node", type=int, help="node-ID of the axis that carries the head")
    parser.add_argument("--stroke-mm", type=float, default=10.0, help="of the head, below its home [%(default)s]")
    parser.add_argument("--step-mm", type=float, default=8.0, help="that the coarse axis moves at a time [%(default)s]")
    parser.add_argument("--reserve-mm", type=float, default=0.05, help="before the ends of the stroke [%(default)s]")
    parser.add_argument("--clearance-mm", type=float, default=0.1, help="above the bottom, while the coarse axis moves [%(default)s]")
    args = parser.parse_args()
    # LinuxCNC keeps to itself what its programs print.
    if log := os.environ.get("EDM_LOG"):
        sys.stdout = sys.stderr = open(log, "a", buffering=1)
    pins = hal.component("edm-head")
    given = [("z-cmd", hal.HAL_FLOAT), ("close", hal.HAL_BIT), ("enable", hal.HAL_BIT), ("pulses", hal.HAL_BIT), ("touch", hal.HAL_BIT), ("feed", hal.HAL_FLOAT)]
    told = [(name, hal.HAL_FLOAT) for name in ("z-fb", "z-error", "retreat-most", "adaptive-feed", "gap-feed", "gap-voltage", "place", "deepest", "surface", "eroding-s")]
    told += [(name, hal.HAL_BIT) for name in ("fault", "inhibit", "pulses-on", "retreating", "holds", "erodes", "touched")]
    told += [(name, hal.HAL_U32) for name in ("state", "fault-number", "shorts", "long-retreats", "late", "moves")]
    told += [("z-offset", hal.HAL_S32), ("w-offset", hal.HAL_S32)]
    if args.coarse_node:
        given.append(("w-cmd", hal.HAL_FLOAT))
        told += [("w-fb", hal.HAL_FLOAT), ("w-fault", hal.HAL_BIT)]
    for name, kind in given:
        pins.newpin(name, kind, hal.HAL_IN)
    for name, kind in told:
        pins.newpin(name, kind, hal.HAL_OUT)
    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    try:
        Machine(args, pins).run()
    except (Trouble, can.CanError, OSError) as error:
        raise SystemExit(f"edm-head: {error}") from None


if __name__ == "__main__":
    main()
