"""Node-ID and bit rate over the bus (CiA 305): python canopen's LSS master."""

import canopen
import pytest
from canopen.lss import LssError

from heads import HANGS, Server, eventually

NODE_IDS = [11, 12, 13]


class Master:
    """A master, and the boot-ups that it has heard."""

    def __init__(self, server):
        self.network = canopen.Network(server.bus("slcan-tcp"))
        self.booted = []
        for node in range(1, 128):
            self.network.subscribe(0x700 + node, self.heard)
        self.network.connect()
        self.lss = self.network.lss
        self.lss.RESPONSE_TIMEOUT = HANGS

    def heard(self, can_id, data, _):
        if data[0] == 0:
            self.booted.append(can_id & 0x7F)

    def read(self, node, index, sub, seconds=HANGS):
        sdo = self.network.add_node(node).sdo
        sdo.RESPONSE_TIMEOUT = seconds
        return int.from_bytes(sdo.upload(index, sub), "little")

    def is_silent(self, node):
        with pytest.raises(canopen.SdoCommunicationError):
            self.read(node, 0x1000, 0, 0.3)
        return True

    def scan(self, *patience):
        """The serial number of a head without a node-ID. One that answers too late is not found: then with more patience, s."""
        for self.lss.RESPONSE_TIMEOUT in patience:
            found, address = self.lss.fast_scan()
            if found:
                break
        self.lss.RESPONSE_TIMEOUT = HANGS
        return address[3] if found else None

    def configuring(self, yes):
        self.lss.send_switch_state_global(self.lss.CONFIGURATION_STATE if yes else self.lss.WAITING_STATE)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.network.disconnect()


@pytest.fixture
def three(tmp_path):
    """Starts a server of three heads that keep what they store; again, it is a power cycle."""
    started = []

    def start():
        if started:
            started[-1].stop()
        started.append(Server(tmp_path, "--nodes", "3", "--node-id", "255", "--store", str(tmp_path / "stored")))
        return started[-1]

    yield start
    started[-1].stop()


def test_three_heads_alike_are_found_named_renumbered_and_stay_so(three):
    serials = {}
    with Master(three()) as master:
        for node in NODE_IDS:
            serials[node] = master.scan(0.5, 1, 2, 4)
            assert serials[node], f"only {len(serials) - 1} of three"
            assert master.lss.inquire_node_id() == 255
            master.lss.configure_node_id(node)
            master.lss.store_configuration()
            master.configuring(False)
            eventually(f"boot-up of {node}", lambda: node in master.booted)
        assert len(set(serials.values())) == 3
        assert not master.scan(0.5), "nobody is left"
    with Master(three()) as master:
        for node, serial in serials.items():
            assert master.read(node, 0x1018, 4) == serial
        # Another number, for one of them alone.
        identity = [master.read(12, 0x1018, sub) for sub in (1, 2, 3, 4)]
        assert master.lss.send_switch_state_selective(*identity)
        with pytest.raises(LssError):
            master.lss.configure_node_id(128)
        master.lss.configure_node_id(99)
        master.lss.store_configuration()
        master.configuring(False)
        assert master.read(12, 0x1018, 4) == serials[12], "until it is reset"
        master.network[12].nmt.send_command(130)
        eventually("boot-up of 99", lambda: 99 in master.booted)
    with Master(three()) as master:
        for node in (11, 13, 99):
            assert master.read(node, 0x1000, 0) & 0xFFFF == 402
        assert master.is_silent(12)
        assert master.read(99, 0x1018, 4) == serials[12]


def test_the_firmware_is_named_on_the_chip_and_stays_so(tmp_path):
    options = ("--node-id", "255", "--store", str(tmp_path / "stored"))
    server = Server(tmp_path, *options, program="chip")
    with Master(server) as master:
        assert master.is_silent(1)
        master.configuring(True)
        assert master.lss.inquire_node_id() == 255
        master.lss.configure_node_id(42)
        for index in (1, 5, 9):
            with pytest.raises(LssError):
                master.lss.configure_bit_timing(index)
        master.lss.configure_bit_timing(2)
        master.lss.store_configuration()
        master.configuring(False)
        eventually("boot-up", lambda: 42 in master.booted)
    server.stop()
    server = Server(tmp_path, *options, program="chip")
    with Master(server) as master:
        assert master.read(42, 0x1000, 0) & 0xFFFF == 402
    server.stop()
