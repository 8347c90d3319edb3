"""Three heads go along one path: one down, one X, one Y. The first leads, through its gap.

Try it with `cargo sim serve --nodes 3`. At every SYNC the leader sends its set points of X and Y (200Eh:12, 13), which are those of one
path coordinate, in one PDO. The other two receive that PDO as their own set points (2017h:1). Every head watches the two others:
when one is lost, the rest takes pulses off and stops where it is.

The path is a depth, or an orbit of it: --shape, --radius-um, --pitch-um (orbit.* of docs/settings.md).
"""

import contextlib
import time

from head import Head, connect, options

SHAPES = ("none", "circle", "square", "sphere")
# States of 2000h:1.
DONE, HOLDING = 6, 7
# The leader's set points of X and Y.
PLACES = 0x3C0

parser = options(__doc__)
parser.add_argument("--nodes", type=int, nargs=3, default=[1, 2, 3], help="node-IDs: down, X, Y [%(default)s]")
parser.add_argument("--surface-mm", type=float, default=2.0, help="surface of the work below home [%(default)s]")
parser.add_argument("--depth-mm", type=float, default=0.02, help="depth below the surface [%(default)s]")
parser.add_argument("--shape", choices=SHAPES, default="circle", help="[%(default)s]")
parser.add_argument("--radius-um", type=float, default=20, help="[%(default)s]")
parser.add_argument("--pitch-um", type=float, default=10, help="[%(default)s]")
parser.add_argument("--origin-mm", type=float, default=1.0, help="where X and Y are 0, below their homes [%(default)s]")
parser.add_argument("--sync-ms", type=int, default=5, help="period of SYNC [%(default)s]")
args = parser.parse_args()


class One(Head):
    """A head of several: the network is closed with the last."""

    def __exit__(self, kind, error, trace):
        self.network.disconnect, disconnect = (lambda: None), self.network.disconnect
        try:
            super().__exit__(kind, error, trace)
            for sub in (2, 3):
                self.sdo[0x1016][sub].raw = 0
        finally:
            self.network.disconnect = disconnect


def pdo(map_, objects):
    """A PDO that is sent, or followed, at each SYNC."""
    map_.clear()
    for index, sub in objects:
        map_.add_variable(index, sub)
    map_.cob_id, map_.trans_type, map_.enabled = PLACES, 1, True
    map_.save()


network = connect(args)
with contextlib.ExitStack() as stack:
    stack.callback(network.disconnect)
    heads = [stack.enter_context(One(network, node)) for node in args.nodes]
    leader, *axes = heads
    for name, value in (("shape", SHAPES.index(args.shape)), ("radius_um", args.radius_um), ("pitch_um", args.pitch_um)):
        leader.setting(f"orbit.{name}").raw = value
    # Before it is enabled, or it would refuse a slower retreat. Set points are late by two periods of SYNC (docs/path.md): what that
    # is worth along the path is bounded.
    for name in ("retreat.velocity_um_s", "feed.max_um_s", "feed.retreat_max_um_s"):
        leader.setting(name).raw = 100
    for head in heads:
        # Quick stop where another is lost: its own way back would lead an axis aside.
        head.sdo[0x6007].raw = 3
        head.enable()
        head.home_here()
        head.sdo[0x6081].raw = round(20 * head.counts_per_mm())
    for head, objects in zip(axes, ([(0x2017, 1), (0x0004, 0)], [(0x0004, 0), (0x2017, 1)])):
        head.move(args.origin_mm * head.counts_per_mm())
        x, y = (leader.sdo[0x200E][sub].raw for sub in (12, 13))
        # Where it is now is where the leader has it.
        head.sdo[0x2017][2].raw = round(args.origin_mm * 1e6) - (x if head is axes[0] else y)
        head.sdo[0x60C2][1].raw = args.sync_ms
        pdo(head.rpdo[3], objects)
        head.op_mode = "CYCLIC SYNCHRONOUS POSITION"
    pdo(leader.tpdo[3], [(0x200E, 12), (0x200E, 13)])
    network.sync.start(args.sync_ms / 1000)
    stack.callback(network.sync.stop)
    for head in heads:
        for sub, other in enumerate((one for one in heads if one is not head), 2):
            head.sdo[0x1016][sub].raw = other.id << 16 | 500

    per_mm = leader.counts_per_mm()
    leader.move((args.surface_mm - 0.2) * per_mm)
    print(f"{args.shape}: 0.2 mm above the work, SYNC every {args.sync_ms} ms")
    leader.sdo[0x2001][1].raw = 1
    leader.start_move((args.surface_mm + args.depth_mm) * per_mm)
    began = told = time.monotonic()
    while leader.sdo[0x2000][1].raw != DONE:
        for head in heads:
            head.check("eroding")
        if leader.sdo[0x2000][1].raw == HOLDING:
            raise SystemExit(f"the leader holds: reason {leader.sdo[0x2000][3].raw} of docs/objects.md (2000h:3)")
        if time.monotonic() - told >= 2:
            told = time.monotonic()
            x, y = (leader.sdo[0x200E][sub].raw / 1000 for sub in (12, 13))
            held = [head.sdo[0x6064].raw / head.counts_per_mm() * 1000 - head.sdo[0x2017][2].raw / 1000 for head in axes]
            z = args.surface_mm - leader.sdo[0x6064].raw / per_mm
            print(f"  {told - began:4.0f} s  Z {z:7.3f} mm  X {x:7.2f}, {held[0]:7.2f}  Y {y:7.2f}, {held[1]:7.2f} um")
        time.sleep(0.02)
    leader.sdo[0x2001][1].raw = 0
    print(f"done in {time.monotonic() - began:.0f} s")
    leader.move(0)
