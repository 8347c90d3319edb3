"""The bus itself, without heads: python-can by network, serial port and socketcand."""

import contextlib
import itertools
import signal
import socket
import time

import can
import pytest

from heads import HANGS, LINKS, Server, eventually


@pytest.fixture
def server(tmp_path):
    server = Server(tmp_path, "--nodes", "0")
    yield server
    server.stop()


def received(bus, count):
    frames = []
    while len(frames) < count:
        frame = bus.recv(HANGS)
        assert frame is not None, f"{len(frames)} frames of {count}"
        frames.append(frame)
    return [(f.arbitration_id, f.is_extended_id, f.is_remote_frame, f.dlc, bytes(f.data)) for f in frames]


def message(number, **more):
    return can.Message(arbitration_id=number, is_extended_id=False, **more)


@pytest.mark.parametrize("sender, receiver", itertools.product(LINKS, LINKS))
def test_a_frame_of_every_kind_arrives_as_it_was_sent_and_never_comes_back(server, sender, receiver):
    if sender == receiver == "slcan-pty":
        pytest.skip("one program a serial port")
    a, b = server.bus(sender), server.bus(receiver)
    frames = [message(n, data=bytes(range(n % 9))) for n in (0, 0x7FF, 0x181, 0x602, 0x123, 0x304)]
    frames += [can.Message(arbitration_id=0x1ABCDEF0, is_extended_id=True, data=[0xFF, 0x0D, 0x07])]
    if "socketcand" not in (sender, receiver):
        frames += [message(0x701, is_remote_frame=True, dlc=1)]
    for frame in frames:
        a.send(frame)
    sent = [(f.arbitration_id, f.is_extended_id, f.is_remote_frame, f.dlc, bytes(f.data)) for f in frames]
    assert received(b, len(frames)) == sent
    # Its own frames would have come before this one.
    b.send(message(0x7FE))
    assert received(a, 1) == [(0x7FE, False, False, 0, b"")]
    a.shutdown()
    b.shutdown()


def test_ten_thousand_frames_each_way_at_once_and_none_is_lost(server):
    a, b = server.bus("slcan-tcp"), server.bus("socketcand")
    got = {a: [], b: []}
    notifiers = [can.Notifier(bus, [lambda m, bus=bus: got[bus].append(int.from_bytes(m.data, "little"))]) for bus in got]
    for n in range(10_000):
        for bus in got:
            bus.send(message(0x100, data=n.to_bytes(4, "little")))
    eventually("all have come", lambda: min(map(len, got.values())) >= 10_000)
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
    frame = message(0x181, data=bytes(8))
    got = []
    notifier = can.Notifier(good, [got.append])
    end = time.monotonic() + HANGS
    sent = 0
    while not server.complaints:
        assert time.monotonic() < end, f"{sent} frames, and nobody was cut off"
        for _ in range(100):
            sender.send(frame)
        sent += 100
        eventually("the good one keeps up", lambda: sent - len(got) <= 1000)
    assert "disconnected, it does not read fast enough" in server.complaints[0]
    eventually("all have come", lambda: len(got) == sent)
    notifier.stop()
    stuck.close()
    for bus in (good, sender):
        bus.shutdown()


def test_a_load_is_made_and_counted(tmp_path):
    server = Server(tmp_path, "--nodes", "0", "--load", "95")
    bus = server.bus("socketcand")
    received(bus, 5000)
    bus.shutdown()
    # How much of it there is by the clock is checked beside the filler, which is told what the time is.
    last = server.stop()
    assert float(last.split(" % of 1 Mbit/s")[0].split()[-1]) > 0, last


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_it_cleanly(tmp_path, number):
    server = Server(tmp_path, "--nodes", "0")
    bus = server.bus("slcan-tcp")
    server.process.send_signal(number)
    assert "Stopped after" in server.process.stdout.read()
    assert server.process.wait(HANGS) == 0
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
