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
    """A head that is operational, with its state machine in TPDO 1 and RPDO 1."""

    def __init__(self, network, node):
        super().__init__(node, str(EDS))
        network.add_node(self)
        self.sdo.RESPONSE_TIMEOUT = 1.0
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
        self.nmt.state = "OPERATIONAL"
        self.setup_402_state_machine(read_pdos=False)
        self.wait("a first status", lambda: self.statusword, 2)

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
            if self.is_faulted():
                raise SystemExit(f"fault {self.sdo[0x603F].raw:#06x} while waiting for {what}")
            if time.monotonic() > end:
                raise SystemExit(f"waited {seconds} s for {what} in vain")
            time.sleep(0.005)
