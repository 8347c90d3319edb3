"""A server of virtual heads, started for a test and stopped with it, and programs that connect to it."""

import os
import re
import shlex
import subprocess
import threading
import time

import can

LINKS = ["slcan-tcp", "slcan-pty", "socketcand"]
# What serves: virtual heads, or the firmware on the emulated chip.
PROGRAMS = {
    "virtual": shlex.split(os.environ.get("EDM_SIM", "target/debug/edm-sim")),
    "chip": shlex.split(os.environ.get("EDM_CHIP", "cargo fil")),
}


# Time after which a test hangs, s.
HANGS = 300.0


class Server:
    """A head, or several, with all ways onto its bus."""

    def __init__(self, folder, *options, program="virtual"):
        self.program = program
        self.pty = str(folder / "can")
        words = [*PROGRAMS[program], "serve"]
        words += ["--slcan-tcp", "127.0.0.1:0", "--socketcand", "127.0.0.1:0", "--slcan-pty", self.pty, *options]
        self.process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.complaints = []
        self.said = ""
        listener = threading.Thread(target=lambda: self.complaints.extend(self.process.stderr), daemon=True)
        listener.start()
        for line in self.process.stdout:
            self.said += line
            if "Ctrl-C stops" in line:
                break
        else:
            listener.join(HANGS)
            raise RuntimeError("it did not start: " + "".join(self.complaints))
        self.tcp = re.search(r"socket://\S+", self.said)[0]
        self.socketcand = re.search(r"socketcand +(\S+):(\d+)", self.said).groups()

    def bus(self, link):
        """A program on the bus, by one of LINKS."""
        if link.startswith("slcan"):
            channel = self.tcp if link == "slcan-tcp" else self.pty
            bus = can.Bus(interface="slcan", channel=channel, bitrate=1_000_000, sleep_after_open=0)
            # What answers has been opened.
            assert bus.get_version(HANGS) != (None, None)
            return bus
        host, port = self.socketcand
        return can.Bus(interface="socketcand", channel="can0", host=host, port=int(port), tcp_tune=True)

    def tell(self, line):
        """Pulls or mends a wire: `limit.lower_open=true`."""
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def stop(self):
        """Closes its input; what it said last."""
        if self.process.poll() is None:
            self.process.stdin.close()
        last = self.process.stdout.read()
        assert self.process.wait(HANGS) == 0, "".join(self.complaints)
        return last


def eventually(what, done):
    """Waits until `done` gives something, and gives it back."""
    end = time.monotonic() + HANGS
    while not (found := done()):
        assert time.monotonic() < end, f"never: {what}"
        time.sleep(0.001)
    return found
