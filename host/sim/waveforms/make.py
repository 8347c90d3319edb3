#!/usr/bin/env python3
"""Waveforms for `cargo sim replay`: python3 make.py (Python alone; the same bytes every time).

The shapes that [R] 6.5 describes, made up, not recorded: tones of 50, 100 and 400 Hz with white noise on an offset; pulses with
sloped edges and Gaussian noise. Times in s, voltages in V, currents in A; what is not from [R] is assumed.

  tones.csv       0.4 s at 10 kS/s, t_s,gap_v: 55 V, 8 V of 50 Hz, 4 V of 100 Hz, 4 V of 400 Hz, noise of 3 V
  pulses.csv      12 ms at 500 kS/s, t_s,gap_v,gap_i,gate: 5 kHz, on for 120 us; in turn open, spark, arc, short, spark
  rigol.csv, rigol-memory.csv, siglent.csv, tektronix.csv, tektronix-tds.csv
                  one pulse period in two, as these oscilloscopes write it: CH1 voltage, CH2 current, CH3 gate (TDS: CH1 alone)
"""

import math
import random
from pathlib import Path

HERE = Path(__file__).parent
OPEN, SPARK, ARC, SHORT = 100.0, 40.0, 28.0, 3.0
AMPS = 6.0
EDGE_S = 1.5e-6
PERIOD_S, ON_S = 200e-6, 120e-6
KINDS = ["open", "spark", "arc", "short", "spark"]


def tones(rng):
    rate = 10_000
    for n in range(int(0.4 * rate)):
        t = n / rate
        tone = sum(volts * math.sin(2 * math.pi * hertz * t) for volts, hertz in [(8, 50), (4, 100), (4, 400)])
        yield t, 55 + tone + rng.gauss(0, 3)


def gap(t):
    """Voltage, current and gate of the pulses at a time, without noise."""
    number, phase = divmod(t + 1e-12, PERIOD_S)
    kind = KINDS[int(number) % len(KINDS)]
    waits_s = {"open": ON_S, "spark": (10 + 13 * (number % 4)) * 1e-6, "arc": 0, "short": 0}[kind]
    burn = {"open": OPEN, "spark": SPARK, "arc": ARC, "short": SHORT}[kind]
    rise = min(phase / EDGE_S, 1.0)
    if phase >= ON_S:
        fall = max(1 - (phase - ON_S) / EDGE_S, 0.0)
        return burn * fall, 0.0, 0
    if phase < waits_s:
        return OPEN * rise, 0.0, 1
    slope = min((phase - waits_s) / EDGE_S, 1.0)
    before = OPEN if waits_s else 0.0
    return before + (burn - before) * slope, (0.0 if kind == "open" else AMPS * slope), 1


def pulses(rng, seconds, rate):
    for n in range(int(seconds * rate)):
        t = n / rate
        volts, amps, gate = gap(t)
        yield t, volts + rng.gauss(0, 1.5), amps + rng.gauss(0, 0.1), gate


def write(name, lines):
    (HERE / name).write_text("\n".join(lines) + "\n")


def main():
    rng = random.Random(2014)
    write("tones.csv", ["t_s,gap_v"] + [f"{t:.4f},{v:.2f}" for t, v in tones(rng)])
    rows = list(pulses(rng, 0.012, 500_000))
    write("pulses.csv", ["t_s,gap_v,gap_i,gate"] + [f"{t:.6f},{v:.1f},{i:.1f},{g}" for t, v, i, g in rows])

    short = [(t - 1e-4, v, i, 3.3 * g) for t, v, i, g in pulses(rng, 0.0008, 500_000)]
    start, step, count = -1e-4, 2e-6, len(short)
    head = ["X,CH1,CH2,CH3,Start,Increment,", f"Sequence,Volt,Volt,Volt,{start:.6e},{step:.6e}"]
    write("rigol.csv", head + [f"{n},{v:.2e},{i:.2e},{g:.2e}," for n, (_, v, i, g) in enumerate(short)])
    head = [f"CH1(V),CH2(V),CH3(V),t0 = {start}s, tInc = {step}s,"]
    write("rigol-memory.csv", head + [f"{v:.3f},{i:.3f},{g:.3f},," for _, v, i, g in short])
    head = [
        f"Record Length,Analog:{count},",
        f"Sample Interval,Analog:{step:.6E},",
        "Vertical Units,CH1:V,CH2:V,CH3:V,,",
        "Vertical Scale,CH1:20.00,CH2:2.00,CH3:1.00,,",
        "Horizontal Units,s,",
        "Model Number,SDS1104X-E,",
        "Source,CH1,CH2,CH3",
        "Second,Volt,Volt,Volt",
    ]
    write("siglent.csv", head + [f"{t:.11f},{v:.5f},{i:.5f},{g:.5f}" for t, v, i, g in short])
    head = [
        "Model,MDO3014",
        "Firmware Version,1.26",
        "",
        "Waveform Type,ANALOG,ANALOG,ANALOG",
        "Point Format,Y,Y,Y",
        "Horizontal Units,s,s,s",
        f"Sample Interval,{step},{step},{step}",
        f"Record Length,{count},{count},{count}",
        "Vertical Units,V,A,V",
        ",,,",
        "TIME,CH1,CH2,CH3",
    ]
    write("tektronix.csv", head + [f"{t:.6e},{v:.4f},{i:.4f},{g:.2f}" for t, v, i, g in short])
    left = [
        f"Record Length,{count:.6e}",
        f"Sample Interval,{step:.6e}",
        f"Trigger Point,{-start / step:.12e}",
        "Source,CH1",
        "Vertical Units,V",
        "Vertical Scale,2.000000e+01",
        "Vertical Offset,0.000000e+00",
        "Horizontal Units,s",
        "Horizontal Scale,1.000000e-04",
        "Pt Fmt,Y",
        "Yzero,0.000000e+00",
        "Probe Atten,1.000000e+01",
        "Model Number,TDS2024B",
    ]
    lines = [f"{t:014.9f},{v:10.5f}," for t, v, _, _ in short]
    write("tektronix-tds.csv", [f"{left[n] if n < len(left) else ','},,{line}" for n, line in enumerate(lines)])


main()
