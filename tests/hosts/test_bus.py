"""The bus itself, without heads: python-can by network, serial port and socketcand."""

import contextlib
import itertools
import signal
import socket
import time

import can
import pytest

from heads import LINKS, Server


@pytest.fixture
def server(tmp_path):
    server = Server(tmp_path, "--nodes", "0")
    yield server
    server.stop()


def received(bus, count, seconds=5.0):
    end = time.monotonic() + seconds
    frames = []
    while len(frames) < count and time.monotonic() < end:
        frame = bus.recv(0.2)
        if frame is not None:
            frames.append(frame)
    return [(f.arbitration_id, f.is_extended_id, f.is_remote_frame, f.dlc, bytes(f.data)) for f in frames]


def message(number, **more):
    return can.Message(arbitration_id=number, is_extended_id=False, **more)


@pytest.mark.parametrize("sender, receiver", itertools.product(LINKS, LINKS))
def test_a_frame_of_every_kind_arrives_as_it_was_sent_and_never_comes_back(server, sender, receiver):
    if sender == receiver == "slcan-pty":
        pytest.skip("one program a serial port")
    a, b = server.bus(sender), server.bus(receiver)
    time.sleep(0.1)
    frames = [message(n, data=bytes(range(n % 9))) for n in (0, 0x7FF, 0x181, 0x602, 0x123, 0x304)]
    frames += [can.Message(arbitration_id=0x1ABCDEF0, is_extended_id=True, data=[0xFF, 0x0D, 0x07])]
    if "socketcand" not in (sender, receiver):
        frames += [message(0x701, is_remote_frame=True, dlc=1)]
    for frame in frames:
        a.send(frame)
    sent = [(f.arbitration_id, f.is_extended_id, f.is_remote_frame, f.dlc, bytes(f.data)) for f in frames]
    assert received(b, len(frames)) == sent
    assert received(a, 1, 0.3) == []
    a.shutdown()
    b.shutdown()


def test_ten_thousand_frames_each_way_at_once_and_none_is_lost(server):
    a, b = server.bus("slcan-tcp"), server.bus("socketcand")
    time.sleep(0.1)
    got = {a: [], b: []}
    notifiers = [can.Notifier(bus, [lambda m, bus=bus: got[bus].append(int.from_bytes(m.data, "little"))]) for bus in got]
    for n in range(10_000):
        for bus in got:
            bus.send(message(0x100, data=n.to_bytes(4, "little")))
    end = time.monotonic() + 20
    while min(map(len, got.values())) < 10_000 and time.monotonic() < end:
        time.sleep(0.01)
    for notifier in notifiers:
        notifier.stop()
    assert all(numbers == list(range(10_000)) for numbers in got.values()), {k: len(v) for k, v in got.items()}
    a.shutdown()
    b.shutdown()


def not_reading(server):
    """A socketcand client that reads nothing once it gets frames. Few frames fill its buffer, and with short segments
    the server's, which grows with them."""
    host, port = server.socketcand
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG, 536)
    client.connect((host, int(port)))
    for asked, answer in ((b"", b"< hi >"), (b"< open can0 >", b"< ok >"), (b"< rawmode >", b"< ok >")):
        client.sendall(asked)
        assert client.recv(len(answer), socket.MSG_WAITALL) == answer
    return client


def test_a_program_that_stops_reading_is_cut_off_and_the_others_go_on(server):
    good, sender = server.bus("slcan-tcp"), server.bus("slcan-pty")
    stuck = not_reading(server)
    time.sleep(0.1)
    frame = message(0x181, data=bytes(8))
    got = []
    notifier = can.Notifier(good, [got.append])
    end = time.monotonic() + 60
    sent = 0
    while not server.complaints and time.monotonic() < end:
        for _ in range(100):
            sender.send(frame)
        sent += 100
        while sent - len(got) > 1000 and time.monotonic() < end:
            time.sleep(0.001)
    assert server.complaints, f"{sent} frames, and nobody was cut off"
    assert "disconnected, it does not read fast enough" in server.complaints[0]
    while len(got) < sent and time.monotonic() < end:
        time.sleep(0.01)
    assert len(got) == sent
    notifier.stop()
    stuck.close()
    for bus in (good, sender):
        bus.shutdown()


def test_a_load_is_made_and_counted(tmp_path):
    server = Server(tmp_path, "--nodes", "0", "--load", "95")
    bus = server.bus("socketcand")
    frames = len(received(bus, 1_000_000, 2.0))
    assert frames > 5000, frames
    bus.shutdown()
    last = server.stop()
    share = float(last.split(" % of 1 Mbit/s")[0].split()[-1])
    assert 90 < share < 100, last


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_it_cleanly(tmp_path, number):
    server = Server(tmp_path, "--nodes", "0")
    bus = server.bus("slcan-tcp")
    server.process.send_signal(number)
    assert "Stopped after" in server.process.stdout.read()
    assert server.process.wait(5) == 0
    assert not (tmp_path / "can").is_symlink()
    with contextlib.suppress(can.CanError):
        bus.shutdown()


def test_what_is_in_the_way_is_named(tmp_path):
    (tmp_path / "can").write_text("mine")
    with pytest.raises(RuntimeError, match="--slcan-pty .*can: cannot be made"):
        Server(tmp_path)
    (tmp_path / "can").unlink()
    for words, message in [
        (["--nodes", "2", "--node-id", "127"], "--nodes 2: must be at most 1"),
        (["--speed", "0"], "must be a number from 0.01 to 100"),
        (["--load", "101"], "must be a number from 0 to 100"),
        (["--socketcan", "nocan0"], "--socketcan nocan0: "),
    ]:
        with pytest.raises(RuntimeError, match=message):
            Server(tmp_path, *words)
