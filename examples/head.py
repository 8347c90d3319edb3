"""What the examples share: options, the bus, a head on it.

Every example takes the same options. Without any it talks to a virtual head that was started by `cargo sim serve`; an
adapter with slcan on a USB port is `--channel /dev/ttyACM0`, an interface of the Linux kernel `--interface socketcan
--channel can0`.
"""

import argparse
import pathlib
import time

import canopen
from canopen.profiles.p402 import BaseNode402

# States of 2000h:1.
DISABLED, FAULT = 0, 8
# Node-ID that this program's heartbeats carry, their period and the longest silence of either side, s.
HOST, BEAT, SILENCE = 127, 0.1, 1.0
EDS = pathlib.Path(__file__).parent.parent / "docs" / "edm-servo-head.eds"


def options(description):
    """The options that all examples have; add your own and parse."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--interface", default="slcan", help="python-can's name of the way onto the bus [%(default)s]")
    parser.add_argument("--channel", default="socket://127.0.0.1:3333", help="its channel [%(default)s]")
    parser.add_argument("--host", help="socketcand: host")
    parser.add_argument("--port", type=int, help="socketcand: port")
    parser.add_argument("--node", type=int, default=1, help="node-ID of the head [%(default)s]")
    return parser


def connect(args):
    """The network."""
    more = {"sleep_after_open": 0.1} if args.interface == "slcan" else {}
    if args.host:
        more |= {"host": args.host, "port": args.port}
    network = canopen.Network()
    network.connect(interface=args.interface, channel=args.channel, bitrate=1_000_000, **more)
    return network


class Head(BaseNode402):
    """A head that is operational, with its state machine in TPDO 1 and RPDO 1.

    In a `with` it is left switched off, however the block ends: at its end, by an error, by Ctrl-C. Head and program watch
    each other's heartbeats: when this program dies, or the cable is pulled, the head takes pulses off, goes back and holds.
    """

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        try:
            self.switch_off()
            # Whoever comes next has a watch of its own.
            self.sdo[0x1016][1].raw = 0
        finally:
            self.beat.stop()
            self.network.disconnect()

    def switch_off(self):
        """Pulses off, hold, open the loop; says whether it is so. A second Ctrl-C does not keep it from trying all of it."""
        failed = []

        def insist(what, action):
            for _ in range(3):
                try:
                    return action()
                except (Exception, KeyboardInterrupt) as error:
                    last = error
                    time.sleep(0.05)
            failed.append(f"{what}: {last!r}")

        def off():
            # Disable voltage: whatever the drive is doing, and without asking it.
            self.sdo[0x6040].raw = 0
            end = time.monotonic() + 2
            while self.sdo[0x2000][1].raw not in (DISABLED, FAULT):
                if time.monotonic() > end:
                    raise RuntimeError(f"the head is in state {self.sdo[0x2000][1].raw} (2000h:1)")
                time.sleep(0.01)

        def hold():
            self.sdo[0x2001][2].raw = 1

        insist("hold", hold)
        insist("disable", off)
        if failed:
            raise SystemExit("the head may still be on, stop it by hand: " + "; ".join(failed))
        if self.sdo[0x2000][1].raw == FAULT:
            print(f"the head is in fault {self.sdo[0x603F].raw:#06x}: pulses are off, its reaction holds it")
        else:
            print("the head is disabled, pulses are off")

    def __init__(self, network, node):
        super().__init__(node, str(EDS))
        network.add_node(self)
        # A busy computer may be late. That a head is gone shows in its heartbeat, not here.
        self.sdo.RESPONSE_TIMEOUT = 5.0
        self.nmt.state = "PRE-OPERATIONAL"
        self.tpdo.read()
        self.rpdo.read()
        for pdo, objects, timer in ((self.tpdo[1], (0x6041, 0x6061), 50), (self.rpdo[1], (0x6040, 0x6060), None)):
            pdo.clear()
            for index in objects:
                pdo.add_variable(index)
            pdo.trans_type = 255
            pdo.event_timer = timer
            pdo.enabled = True
            pdo.save()
        self.beat = network.send_periodic(0x700 + HOST, b"\x05", BEAT)
        self.sdo[0x1016][1].raw = HOST << 16 | round(1000 * SILENCE)
        # The head watches from the next one on: before it can be enabled.
        network.send_message(0x700 + HOST, b"\x05")
        self.nmt.add_heartbeat_callback(self.heard_of)
        self.heard = time.monotonic()
        self.sdo[0x1017].raw = round(1000 * BEAT)
        self.nmt.state = "OPERATIONAL"
        self.setup_402_state_machine(read_pdos=False)
        self.wait("a first status", lambda: self.statusword, 2)

    def heard_of(self, _):
        self.heard = time.monotonic()

    def check(self, doing):
        """Ends the program when the head is in a fault or has fallen silent; call it again and again while it works."""
        if self.is_faulted():
            raise SystemExit(f"fault {self.sdo[0x603F].raw:#06x} while {doing}")
        if time.monotonic() - self.heard > SILENCE:
            raise SystemExit(f"the head has been silent for {SILENCE:g} s while {doing}")

    def setting(self, key):
        """The object of a setting: `servo.velocity_hz` is "velocity_hz" in the record "servo"."""
        group, name = key.split(".", 1)
        return self.sdo[group][name]

    def counts_per_mm(self):
        """Encoder resolution."""
        return self.sdo[0x608F][1].raw / self.sdo[0x608F][2].raw

    def enable(self):
        """Closes the loop, after a fault as well if its cause has gone."""
        if self.is_faulted():
            self.reset_from_fault()
        try:
            self.state = "OPERATION ENABLED"
        except RuntimeError:
            refusal = self.sdo[0x2000][4].raw
            raise SystemExit(f"not enabled: refusal {refusal} of docs/objects.md (2000h:4)") from None

    def home_here(self):
        """Home is where the head rests: the upper stop."""
        self.sdo[0x6098].raw = 35
        if not self.homing(timeout=10):
            raise SystemExit("not homed")

    def start_move(self, counts):
        """Profile position: gives a new set point, and waits until it is taken."""
        if self.op_mode != "PROFILED POSITION":
            self.op_mode = "PROFILED POSITION"
        self.sdo[0x607A].raw = round(counts)
        self.controlword = 0x0F
        self.wait("the last set point to be over", lambda: not self.statusword & 1 << 12)
        self.controlword = 0x1F
        self.wait("the set point to be taken", lambda: self.statusword & 1 << 12)
        self.controlword = 0x0F

    def move(self, counts, seconds=60):
        """Profile position: goes there."""
        self.start_move(counts)
        self.wait("the target", lambda: self.statusword & 1 << 10, seconds)

    def wait(self, what, done, seconds=2):
        """Waits until something is so, or a fault comes."""
        end = time.monotonic() + seconds
        while not done():
            self.check(f"waiting for {what}")
            if time.monotonic() > end:
                raise SystemExit(f"waited {seconds} s for {what} in vain")
            time.sleep(0.005)
