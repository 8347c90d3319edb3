"""A head as python canopen sees it: the network, the drive, what both tests and examples do with them."""

import subprocess

import canopen
from canopen.profiles.p402 import BaseNode402

from heads import HANGS, PROGRAMS, eventually

# Simulated time from a heartbeat to the next, ms.
BEAT_MS = 10


def eds(folder):
    """The description file, as the program writes it."""
    path = folder / "head.eds"
    path.write_bytes(subprocess.run([*PROGRAMS["virtual"], "eds"], check=True, stdout=subprocess.PIPE).stdout)
    return str(path)


class Host:
    """A master with one drive, from boot-up to operational."""

    def __init__(self, server, link, description, node=1):
        self.network = canopen.Network(server.bus(link))
        self.network.connect()
        self.drive = BaseNode402(node, description)
        self.network.add_node(self.drive)
        # Nothing here is about how long an answer takes.
        self.drive.sdo.RESPONSE_TIMEOUT = HANGS
        for wait in ["SWITCH_OP_MODE", "SWITCH_STATE_FINAL", "SWITCH_STATE_SINGLE", "CHECK_TPDO"]:
            setattr(self.drive, f"TIMEOUT_{wait}", HANGS)
        # The library waits here for what it does afterwards.
        self.drive.TIMEOUT_RESET_FAULT = 0
        self.beats = 0
        self.drive.nmt.add_heartbeat_callback(self._beat)
        self.emergencies = []
        self.drive.emcy.add_callback(lambda error: self.emergencies.append(error.code))

    def _beat(self, _):
        self.beats += 1

    def sleep(self, seconds):
        """Waits until so much simulated time has passed, which may go more slowly than that of a clock."""
        until = self.beats + 1 + seconds * 1000 / BEAT_MS
        eventually("simulated time passes", lambda: self.beats >= until)

    def boot(self):
        """Resets the node, and waits for its boot-up."""
        self.drive.nmt.state = "RESET"
        self.drive.nmt.wait_for_bootup(HANGS)

    def set_up(self):
        """Maps what the state machine needs, and goes operational."""
        drive = self.drive
        drive.nmt.state = "PRE-OPERATIONAL"
        self.write(0x1017, BEAT_MS)
        drive.nmt.wait_for_heartbeat(HANGS)
        drive.tpdo.read()
        drive.rpdo.read()
        for pdo in [*drive.tpdo.values(), *drive.rpdo.values()]:
            pdo.clear()
            pdo.enabled = False
        self._map(drive.tpdo[1], [0x6041, 0x6061], 255, event_timer=50)
        self._map(drive.tpdo[2], [0x6064], 1)
        self._map(drive.rpdo[1], [0x6040, 0x6060], 255)
        self._map(drive.rpdo[2], [0x607A], 1)
        for pdo in [*drive.tpdo.values(), *drive.rpdo.values()]:
            pdo.save()
        drive.setup_402_state_machine()
        drive.nmt.state = "OPERATIONAL"
        eventually("the first status", lambda: drive.statusword)

    def _map(self, pdo, objects, transmission, event_timer=None):
        for index in objects:
            pdo.add_variable(index)
        pdo.trans_type = transmission
        pdo.event_timer = event_timer
        pdo.enabled = True

    def enable(self):
        self.drive.state = "OPERATION ENABLED"

    def read(self, index, sub=0):
        """A value by SDO."""
        entry = self.drive.sdo[index]
        return (entry if isinstance(self.drive.object_dictionary[index], canopen.objectdictionary.ODVariable) else entry[sub]).raw

    def write(self, index, value, sub=0):
        """Writes a value by SDO."""
        entry = self.drive.sdo[index]
        simple = isinstance(self.drive.object_dictionary[index], canopen.objectdictionary.ODVariable)
        (entry if simple else entry[sub]).raw = value

    def position(self):
        return self.read(0x6064)

    def home(self, method=35):
        self.write(0x6098, method)
        return self.drive.homing(timeout=HANGS)

    def move(self, target):
        """Profile position: new set point, acknowledged, reached."""
        drive = self.drive
        drive.op_mode = "PROFILED POSITION"
        self.write(0x607A, target)
        drive.controlword = 0x0F
        eventually("acknowledge is low", lambda: not drive.statusword & 1 << 12)
        drive.controlword = 0x1F
        eventually("the set point is acknowledged", lambda: drive.statusword & 1 << 12)
        drive.controlword = 0x0F
        eventually("the target is reached", lambda: drive.statusword & 1 << 10)

    def stream(self, positions):
        """Cyclic synchronous position: a set point and a SYNC each heartbeat; the positions that came back, one for each."""
        drive = self.drive
        back = []
        drive.tpdo[2].add_callback(lambda pdo: back.append(pdo[0].raw))
        drive.rpdo[2][0].raw = self.position()
        drive.rpdo[2].transmit()
        self.network.sync.transmit()
        eventually("an answer to the first SYNC", lambda: back)
        back.clear()
        drive.op_mode = "CYCLIC SYNCHRONOUS POSITION"
        for position in positions:
            answered, beat = len(back), self.beats
            drive.rpdo[2][0].raw = position
            drive.rpdo[2].transmit()
            self.network.sync.transmit()
            eventually("an answer to the SYNC, and the next heartbeat", lambda: len(back) > answered and self.beats > beat)
        return back

    def close(self):
        self.network.disconnect()
