"""A whole session with python canopen's BaseNode402, over each link."""

import threading
import time

import canopen
import pytest

from drive import Host, eds
from heads import HANGS, LINKS, PROGRAMS, Server, eventually

# Default scenario: a count is 1 um, the work lies 2 mm below the resting head.
WORK = 2000


# The links are the same programs for both, and the chip takes a whole core for as long as it serves.
@pytest.mark.parametrize("link, program", [*((link, "virtual") for link in LINKS), ("slcan-tcp", "chip")])
def test_a_session_from_boot_up_to_a_hole(tmp_path, link, program):
    description = eds(tmp_path)
    store = ["--store", str(tmp_path / "store")]
    server = Server(tmp_path, *store, program=program)
    host = Host(server, link, description)
    drive = host.drive

    # Boot and remap.
    host.boot()
    host.set_up()
    assert drive.state == "SWITCH ON DISABLED"

    # Enable, home where it is.
    host.enable()
    assert host.home(method=35)
    assert host.position() == pytest.approx(0, abs=2)

    # Profile position, and back.
    host.write(0x6081, 20_000)
    for target in (1500, 200, 500):
        host.move(target)
        assert host.position() == pytest.approx(target, abs=3)

    # A stream of set points.
    start = host.position()
    ramp = [start + 2 * n for n in range(150)] + [start + 300] * 30
    back = host.stream(ramp)
    assert len(back) == len(ramp)
    assert back[-1] == pytest.approx(start + 300, abs=3)
    assert all(b >= a - 3 for a, b in zip(back, back[1:])), "it never runs back"

    # Quick stop stays until it is left.
    drive.state = "QUICK STOP ACTIVE"
    host.sleep(0.3)
    assert drive.state == "QUICK STOP ACTIVE"
    drive.state = "OPERATION ENABLED"

    # A fault, its code, its emergency; a reset only when its cause has gone.
    server.tell("bridge.fault=true")
    eventually("the fault", lambda: drive.state == "FAULT")
    code = eventually("the error code", lambda: host.read(0x603F))
    assert eventually("an emergency", lambda: code in host.emergencies)
    drive.controlword = 0x80
    host.sleep(0.3)
    assert drive.state == "FAULT", "the cause is still there"
    drive.controlword = 0x00
    server.tell("bridge.fault=false")
    eventually("the input is low", lambda: not host.read(0x60FD) & 1 << 18)
    drive.reset_from_fault()
    assert drive.state == "OPERATION ENABLED"

    # Store; a refused write changes nothing; while enabled nothing is stored.
    host.write(0x6067, 7)
    with pytest.raises(canopen.SdoAbortedError):
        host.write(0x605A, 99)
    with pytest.raises(canopen.SdoAbortedError):
        drive.store(1)
    drive.state = "SWITCH ON DISABLED"
    drive.store(1)
    host.write(0x6067, 9)

    # Power cycle: what was stored is there, what was not is gone.
    host.close()
    server.process.kill()
    server.process.wait()
    server = Server(tmp_path, *store, program=program)
    host = Host(server, link, description)
    drive = host.drive
    host.boot()
    host.set_up()
    assert host.read(0x6067) == 7

    # Erode to depth.
    host.enable()
    assert host.home(method=35)
    host.write(0x6081, 20_000)
    host.move(WORK - 200)
    host.write(0x2001, 1, sub=1)
    drive.controlword = 0x0F
    host.write(0x607A, WORK + 10)
    drive.controlword = 0x1F
    eventually("it erodes", lambda: host.read(0x2000, 1) == 4)
    volts = [host.read(0x2005, 1) / 100 for _ in range(50) if not host.sleep(0.02)]
    assert 30 < sum(volts) / len(volts) < 90, volts
    eventually("the hole is bored", lambda: drive.statusword & 1 << 10)
    assert host.position() >= WORK + 10 - 2
    assert host.read(0x2003, 3) == 1, "depth has ended it"
    assert host.emergencies == []
    drive.state = "SWITCH ON DISABLED"
    host.close()
    server.stop()


def test_two_masters_at_once_do_no_harm(tmp_path):
    description = eds(tmp_path)
    server = Server(tmp_path)
    first, second = (Host(server, link, description) for link in ("slcan-tcp", "socketcand"))
    first.boot()
    first.set_up()
    first.enable()
    first.home()
    # Both use the one SDO server at the same time, and hear each other's answers: either may have to try again, but nothing
    # wrong is written, and the drive goes on.
    def busy(host, index):
        for value in range(1000, 1100):
            insist(host.write, index, value)

    threads = [threading.Thread(target=busy, args=pair) for pair in ((first, 0x6083), (second, 0x6084))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(HANGS)
    first.sleep(0.1)
    assert (insist(first.read, 0x6083), insist(first.read, 0x6084)) == (1099, 1099)
    assert first.drive.state == "OPERATION ENABLED"
    for index in (0x6083, 0x6084):
        insist(first.write, index, 1_000_000)
    first.move(300)
    assert first.emergencies == []
    for host in (first, second):
        host.close()
    server.stop()


def insist(action, *values):
    """Tries again when another master's answer came in between."""
    for _ in range(50):
        try:
            return action(*values)
        except (canopen.SdoCommunicationError, canopen.SdoAbortedError):
            time.sleep(0.002)
    raise AssertionError(f"{action.__name__}{values} never works")


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_description_loads_and_every_object_in_it_is_there(tmp_path, program):
    server = Server(tmp_path, program=program)
    host = Host(server, "socketcand", eds(tmp_path))
    missing = []
    for index, entry in host.drive.object_dictionary.items():
        subs = [entry] if isinstance(entry, canopen.objectdictionary.ODVariable) else list(entry.values())
        for variable in subs:
            if index < 0x20 or not variable.readable or variable.data_type == canopen.objectdictionary.DOMAIN:
                continue
            try:
                variable.decode_raw(host.drive.sdo.upload(index, variable.subindex))
            except (canopen.SdoCommunicationError, canopen.SdoAbortedError, ValueError) as error:
                missing.append((index, variable.subindex, str(error)))
    # No error has happened yet: the list of errors is empty.
    assert [item for item in missing if item[0] != 0x1003] == []
    host.close()
    server.stop()
