"""Makes a step of the position, records it with the head's own scope, one sample a millisecond, and draws it."""

import struct
import time

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plot

from head import Head, connect, options

DEMAND, ACTUAL, DUTY = 0x6062 << 8, 0x6064 << 8, 0x2007 << 8 | 1

parser = options(__doc__)
parser.add_argument("--step", type=int, default=100, help="counts [%(default)s]")
parser.add_argument("--plot", default="step.svg", help="picture [%(default)s]")
args = parser.parse_args()
network = connect(args)
with Head(network, args.node) as head:
    head.enable()
    rest = head.sdo[0x6064].raw
    start = rest + 500  # counts: away from the upper stop
    head.move(start)

    scope = head.sdo[0x2010]
    for sub, signal in enumerate((DEMAND, ACTUAL, DUTY, 0), start=1):
        scope[sub].raw = signal
    scope[5].raw = 1  # ms from sample to sample
    scope[6].raw = 3  # begins with the first change of the demand
    scope[8].raw = 1
    head.start_move(start + args.step)
    end = time.monotonic() + 5
    while scope[9].raw != 3:
        if time.monotonic() > end:
            raise SystemExit("the scope did not fill up")
        time.sleep(0.05)
    with scope[11].open("rb", block_transfer=True) as record:
        data = record.read()
    samples = [struct.unpack_from("<4i", data, at) for at in range(0, len(data), 16)]
    head.move(rest)

demand, actual, duty, _ = zip(*samples)
moved = [value - start for value in actual]
reached = next((ms for ms, value in enumerate(moved) if value >= 0.9 * args.step), None)
overshoot = max(moved) - args.step
print(f"{len(samples)} samples; 90 % of the step after {reached} ms, overshoot {max(overshoot, 0)} counts")

figure, (above, below) = plot.subplots(2, sharex=True, figsize=(8, 5))
above.plot([value - start for value in demand], label="demand", linewidth=1)
above.plot(moved, label="actual", linewidth=1)
above.set_ylabel("position, counts")
above.legend()
below.plot([value / 100 for value in duty], linewidth=1)
below.set_ylabel("duty, %")
below.set_xlabel("ms")
figure.savefig(args.plot)
print(f"drawn: {args.plot}")
