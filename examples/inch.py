"""Bores a hole deeper than the stroke: a coarse axis carries the head when it asks (inch-worm).

The coarse axis is another CANopen drive in profile position; `cargo sim serve --coarse-axis` has one behind the heads. Its home is
where it rests when this program begins, and there it goes back in the end.
"""

import time

from head import Head, connect, options

# Bit 15 of the statusword, and states of 2000h:1.
ASKS, DONE, INCHING = 1 << 15, 6, 16
# What 2014h:1 says of a question that is over.
WHY = {4: "the coarse axis was late", 5: "the move was not the one asked for"}

parser = options(__doc__)
parser.add_argument("--coarse-node", type=int, default=2, help="node-ID of the coarse axis [%(default)s]")
parser.add_argument("--surface-mm", type=float, default=2.0, help="surface of the work below home [%(default)s]")
parser.add_argument("--depth-mm", type=float, default=20.0, help="depth of the hole [%(default)s]")
parser.add_argument("--step-mm", type=float, default=8.0, help="length of a move of the coarse axis [%(default)s]")
parser.add_argument("--touch", action="store_true", help="measure each move by touching the bottom of the hole")
args = parser.parse_args()
network = connect(args)


class Coarse(Head):
    """The axis that carries the head. The network is closed with the head."""

    def __exit__(self, kind, error, trace):
        self.network.disconnect, disconnect = (lambda: None), self.network.disconnect
        try:
            super().__exit__(kind, error, trace)
        finally:
            self.network.disconnect = disconnect


with Head(network, args.node) as head, Coarse(network, args.coarse_node) as coarse:
    counts_per_mm, coarse_per_mm = head.counts_per_mm(), coarse.counts_per_mm()
    head.setting("inch.step_um").raw = 1000 * args.step_mm
    head.setting("inch.seen").raw = 1 if args.touch else 0
    for axis in (coarse, head):
        axis.enable()
        axis.home_here()
    coarse.sdo[0x6081].raw = round(5 * coarse_per_mm)
    head.sdo[0x6081].raw = round(20 * counts_per_mm)
    # The travel ends at 12 mm, whatever the surface is.
    head.move(min(args.surface_mm - 0.2, 10) * counts_per_mm)

    head.sdo[0x2001][1].raw = 1
    began = told = time.monotonic()
    head.start_move((args.surface_mm + args.depth_mm) * counts_per_mm)
    while head.sdo[0x2000][1].raw != DONE:
        head.check("eroding")
        coarse.check("carrying")
        if head.statusword & ASKS:
            to = head.sdo[0x2014][3].raw / counts_per_mm
            print(f"  {time.monotonic() - began:4.0f} s  coarse axis to {to:.3f} mm")
            coarse.move(to * coarse_per_mm)
            head.sdo[0x2014][4].raw = round(coarse.sdo[0x6064].raw / coarse_per_mm * counts_per_mm)
            head.wait("the head to go on", lambda: not head.statusword & ASKS)
        elif head.sdo[0x2014][1].raw in WHY:
            raise SystemExit(WHY[head.sdo[0x2014][1].raw])
        if time.monotonic() - told >= 2:
            told = time.monotonic()
            depth = head.sdo[0x6064].raw / counts_per_mm - args.surface_mm
            print(f"  {told - began:4.0f} s  {depth:7.3f} mm  {head.sdo[0x2005][1].raw / 100:5.1f} V")
        time.sleep(0.05)
    head.sdo[0x2001][1].raw = 0
    bored = head.sdo[0x6064].raw / counts_per_mm - args.surface_mm
    moves, carried = head.sdo[0x2014][7].raw, head.sdo[0x2014][6].raw / counts_per_mm
    print(f"bored to {bored:.3f} mm with {moves} moves, carried by {carried:.3f} mm")

    # Out of the hole: the head to the top of its travel, the coarse axis to its home.
    head.move(head.sdo[0x2014][6].raw)
    coarse.move(0)
    head.sdo[0x2014][4].raw = 0
    print("out of the hole")
