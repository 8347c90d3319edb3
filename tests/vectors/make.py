#!/usr/bin/env python3
"""Reference vectors for tests/filter_vectors.rs: python3 make.py (numpy 2.4, scipy 1.17).

Two signals as converter codes at 500 kS/s, and what scipy.signal makes of them in f64: a 4th-order Butterworth
low-pass, then iirnotch at the mains frequency, then, where asked for, iirnotch at twice that. Both signals are those of
[R] 6.5: tones of 50, 100 and 400 Hz with white noise and an offset; pulses with sloped edges and Gaussian noise.

Written beside this script, all little-endian:
  NAME.sums      u32, one a tick: the sum of the 25 codes of the tick's block
  cases.csv      signal, corner, mains frequency, notch Q, second harmonic (0 or 1), one case a line
  expected.f64   for each case in that order, the filtered mean code at every STRIDE-th tick, starting with the STRIDE-th
"""

from pathlib import Path

import numpy as np
from scipy import signal

HERE = Path(__file__).parent
TICK_HZ = 20_000
BLOCK = 25
TICKS = 12_000
STRIDE = 20
Q = 2.5

rng = np.random.default_rng(2014)
t = np.arange(TICKS * BLOCK) / (TICK_HZ * BLOCK)


def codes(volts_in_codes):
    return np.clip(np.rint(volts_in_codes), 0, 4095).astype(np.uint32)


def tones():
    clean = 1800 + sum(a * np.sin(2 * np.pi * f * t) for a, f in [(400, 50), (300, 100), (250, 400)])
    return codes(clean + rng.normal(0, 300, t.size))


def pulses():
    """187 us pulses, incommensurate with the tick, edges of 6 us; the on-time share changes every 0.2 s."""
    period, edge = 187e-6, 6e-6
    on = np.choose((t / 0.2).astype(int), [0.8, 0.45, 0.7]) * period
    phase = t % period
    trapezium = np.clip(np.minimum(phase, on - phase) / edge, 0, 1)
    return codes(200 + 2600 * trapezium + rng.normal(0, 60, t.size))


def reference(x, corner, mains, second_harmonic):
    y = signal.sosfilt(signal.butter(4, corner, fs=TICK_HZ, output="sos"), x)
    for centre in [mains, 2 * mains][: 1 + second_harmonic]:
        y = signal.sosfilt(signal.tf2sos(*signal.iirnotch(centre, Q, fs=TICK_HZ)), y)
    return y


cases, expected = [], []
for make in [tones, pulses]:
    name = make.__name__
    sums = make().reshape(TICKS, BLOCK).sum(axis=1)
    sums.astype("<u4").tofile(HERE / f"{name}.sums")
    variants = [(corner, 50, 0) for corner in [20, 67, 89, 100, 195, 200, 2000]]
    for corner, mains, second_harmonic in variants + [(200, 60, 0), (200, 50, 1)]:
        cases.append(f"{name},{corner},{mains},{Q},{second_harmonic}\n")
        expected.append(reference(sums / BLOCK, corner, mains, second_harmonic)[STRIDE - 1 :: STRIDE])

(HERE / "cases.csv").write_text("".join(cases))
np.concatenate(expected).astype("<f8").tofile(HERE / "expected.f64")
