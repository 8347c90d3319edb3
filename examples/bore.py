"""Homes the head at its upper stop, bores a hole to a depth below the surface, goes home, and saves the parameters."""

import time

from head import Head, connect, options

parser = options(__doc__)
parser.add_argument("--surface-mm", type=float, default=2.0, help="surface of the work below home [%(default)s]")
parser.add_argument("--depth-mm", type=float, default=0.05, help="depth of the hole [%(default)s]")
args = parser.parse_args()
network = connect(args)
with Head(network, args.node) as head:
    counts_per_mm = head.counts_per_mm()
    head.enable()
    head.home_here()
    print("homed")
    head.sdo[0x6081].raw = round(20 * counts_per_mm)
    head.move((args.surface_mm - 0.2) * counts_per_mm)
    print(f"0.2 mm above the work, at {head.sdo[0x6064].raw / counts_per_mm:.3f} mm")

    # From here on set points are reached through the gap.
    head.sdo[0x2001][1].raw = 1
    target = round((args.surface_mm + args.depth_mm) * counts_per_mm)
    began = time.monotonic()
    head.start_move(target)
    told = began
    while not head.statusword & 1 << 10:
        head.check("eroding")
        if time.monotonic() - told >= 2:
            told = time.monotonic()
            depth = head.sdo[0x6064].raw / counts_per_mm - args.surface_mm
            print(f"  {told - began:4.0f} s  {depth:7.3f} mm  {head.sdo[0x2005][1].raw / 100:5.1f} V")
        time.sleep(0.02)
    head.sdo[0x2001][1].raw = 0
    bored = head.sdo[0x6064].raw / counts_per_mm - args.surface_mm
    print(f"bored to {bored:.3f} mm in {time.monotonic() - began:.0f} s")
    head.move(0)

    head.state = "SWITCH ON DISABLED"
    head.store(3)  # settings and profile, not how this program watches
    print("saved")
