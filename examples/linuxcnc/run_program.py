#!/usr/bin/env python3
"""Display of LinuxCNC without a screen: homes, runs the program of the INI file, says what came of it and ends.

Exit code 1 when LinuxCNC reports an error, or the program does not end.
"""

import os
import subprocess
import sys
import time

import hal
import linuxcnc

# Longest run, s.
PATIENCE = float(os.environ.get("EDM_PATIENCE_S", 1200))
# Speed of the virtual head's time, of which LinuxCNC's overrides are made.
SPEED = float(os.environ.get("EDM_SPEED", 1))


def pin(name):
    return hal.get_value(name)


def main():
    # LinuxCNC keeps to itself what its programs print.
    if log := os.environ.get("EDM_LOG"):
        sys.stdout = sys.stderr = open(log, "a", buffering=1)
    ini = linuxcnc.ini(sys.argv[sys.argv.index("-ini") + 1])
    stat, command, errors = linuxcnc.stat(), linuxcnc.command(), linuxcnc.error_channel()

    def check():
        stat.poll()
        while said := errors.poll():
            kind, text = said
            print(f"LinuxCNC: {text}", flush=True)
            if kind in (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR):
                raise SystemExit(1)

    def wait(what, done, seconds):
        end = time.monotonic() + seconds
        while not done():
            check()
            if time.monotonic() > end:
                raise SystemExit(f"waited {seconds:g} s for {what} in vain")
            time.sleep(0.02)

    # Pins are read by a component only.
    reader = hal.component("run-program")
    reader.ready()
    wait("task", lambda: stat.echo_serial_number >= 0, 10)
    command.state(linuxcnc.STATE_ESTOP_RESET)
    command.wait_complete()
    wait("the drives", lambda: not pin("edm-head.fault"), 20)
    command.state(linuxcnc.STATE_ON)
    wait("the machine to be on", lambda: stat.task_state == linuxcnc.STATE_ON, 20)
    command.mode(linuxcnc.MODE_MANUAL)
    command.wait_complete()
    command.home(-1)
    joints = int(ini.find("KINS", "JOINTS"))
    wait("the homes", lambda: all(stat.homed[:joints]), 20)
    command.feedrate(SPEED)
    command.rapidrate(SPEED)
    command.mode(linuxcnc.MODE_AUTO)
    command.wait_complete()
    command.program_open(os.path.abspath(ini.find("DISPLAY", "OPEN_FILE")))
    command.wait_complete()
    command.auto(linuxcnc.AUTO_RUN, 0)
    began = told = time.monotonic()
    wait("the start", lambda: stat.interp_state != linuxcnc.INTERP_IDLE, 5)
    picture = os.environ.get("EDM_PANEL")
    while stat.interp_state != linuxcnc.INTERP_IDLE or stat.queue:
        check()
        now = time.monotonic()
        if now - began > PATIENCE:
            raise SystemExit(f"the program has not ended after {PATIENCE:g} s")
        if now - told >= 2:
            told = now
            print(
                f"  {now - began:5.0f} s  line {stat.motion_line:3}  Z {pin('edm-head.place') - stat.g5x_offset[2]:8.4f} mm"
                f"  {pin('edm-head.gap-voltage'):5.1f} V  {pin('edm-head.gap-feed'):7.1f} um/s  shorts {pin('edm-head.shorts')}",
                flush=True,
            )
            if picture and pin("edm-head.erodes"):
                subprocess.run(["import", "-display", os.environ["EDM_DISPLAY"], "-window", "root", picture], check=False)
        time.sleep(0.02)
    stat.poll()
    surface = stat.g5x_offset[2]
    deepest = pin("edm-head.deepest") - surface
    print(f"ended after {time.monotonic() - began:.0f} s, deepest Z {deepest:.4f} mm, Z0 at {surface:.4f} mm")
    print(
        f"shorts {pin('edm-head.shorts')}, long retreats {pin('edm-head.long-retreats')}, late set points {pin('edm-head.late')}, "
        f"farthest retreat {1000 * pin('edm-head.retreat-most'):.0f} um, moves of the coarse axis {pin('edm-head.moves')}"
    )
    command.state(linuxcnc.STATE_OFF)
    command.wait_complete()


if __name__ == "__main__":
    main()
