"""Has the axis follow the step and direction inputs (mode -1), and says where they have led, until Ctrl-C."""

import time

from head import Head, connect, options

parser = options(__doc__)
parser.add_argument("--ratio", default="1/1", help="counts by which so many steps move the axis [%(default)s]")
parser.add_argument("--record", action="store_true", help="erode along a path that the steps make")
parser.add_argument("--seconds", type=float, default=float("inf"), help="how long [until Ctrl-C]")
args = parser.parse_args()
counts, steps = (int(number) for number in args.ratio.split("/"))
network = connect(args)
with Head(network, args.node) as head:
    head.setting("step.counts").raw = counts
    head.setting("step.steps").raw = steps
    head.enable()
    head.home_here()
    start = 0.5 * head.counts_per_mm()
    head.move(start)
    head.rpdo[1][0x6060].raw = -1
    head.rpdo[1].transmit()
    if args.record:
        head.wait("mode -1", lambda: head.sdo[0x6061].raw == -1)
        head.sdo[0x2001][1].raw = 1
    head.wait("the head to follow steps", lambda: head.sdo[0x6061].raw == -1 and head.statusword & 1 << 12)
    print(f"{'records' if args.record else 'follows'} {steps} steps by {counts} counts, from {start / head.counts_per_mm():.3f} mm on")
    end = time.monotonic() + args.seconds
    try:
        while time.monotonic() < end:
            time.sleep(min(1.0, max(end - time.monotonic(), 0)))
            head.check(f"following steps; 2016h:5 is {head.sdo[0x2016][5].raw}")
            mm = head.sdo[0x6062].raw / head.counts_per_mm()
            print(f"{head.sdo[0x2016][1].raw:>9} steps, {head.sdo[0x2016][2].raw:>7} a second: {mm:.3f} mm")
    except KeyboardInterrupt:
        pass
