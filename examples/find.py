"""Finds an edge, or the centre between two, by touching the work from above: the head finds the surface, again and again, and a
second axis of the host moves it sideways between.

The second axis is another drive on the bus by CiA 402, in profile position; positions along it are mm from where it is when this
begins. An edge is found to half of --to-mm, and is that of the work less what the electrode reaches beyond its own middle. For
the centre that is the same on both sides, and cancels.
"""

import time

from canopen.profiles.p402 import BaseNode402

from head import EDS, Head, connect, options

# 2011h:3.
RUNS, FOUND, MISSED, OUTCOMES = 1, 2, 3, ["not requested", "in progress", "found", "nothing within reach", "no open gap", "aborted"]


def surface(head, reach=0):
    """Where the surface is, counts; none where there is no contact within `reach` counts, 0 being the whole travel."""
    head.sdo[0x2011][2].raw = round(reach)
    before = head.sdo[0x2000][7].raw
    head.sdo[0x2011][1].raw = 1
    head.wait("the search to begin", lambda: outcome(head) == RUNS or head.sdo[0x2000][7].raw != before)
    if head.sdo[0x2000][7].raw != before:
        raise SystemExit(f"no search: refusal {head.sdo[0x2000][4].raw} of docs/objects.md (2000h:4)")
    head.wait("the surface", lambda: outcome(head) != RUNS, 120)
    if (ended := outcome(head)) not in (FOUND, MISSED):
        raise SystemExit(f"no surface: {OUTCOMES[ended]}")
    return head.sdo[0x2001][6].raw if ended == FOUND else None


def outcome(head):
    """How the newest search stands."""
    return head.sdo[0x2011][3].raw


def edge(head, axis, inside, outside, drop_mm=0.5, clear_mm=0.5, to_mm=0.01):
    """Where the work ends between two places, mm: there is a surface at `inside`, and at `outside` none less than `drop_mm` below
    it. The electrode is lifted by `clear_mm` above the surface before it moves sideways."""
    scale = head.counts_per_mm()
    axis.move(inside)
    top = surface(head)
    if top is None:
        raise SystemExit(f"no surface at {inside:g} mm")
    above = top - round(clear_mm * scale)
    reach = (clear_mm + drop_mm) * scale

    def is_inside(at):
        head.move(above)
        axis.move(at)
        return surface(head, reach) is not None

    if is_inside(outside):
        raise SystemExit(f"at {outside:g} mm there is work as well")
    while abs(outside - inside) > to_mm:
        middle = (inside + outside) / 2
        if is_inside(middle):
            inside = middle
        else:
            outside = middle
    head.move(above)
    return (inside + outside) / 2


def centre(head, axis, inside, left, right, **how):
    """The middle between the edges to both sides of `inside`, mm."""
    return (edge(head, axis, inside, left, **how) + edge(head, axis, inside, right, **how)) / 2


class Axis(BaseNode402):
    """A drive by CiA 402 that moves the head sideways."""

    def __init__(self, network, node):
        super().__init__(node, str(EDS))
        network.add_node(self)
        for word in (0x06, 0x07, 0x0F):
            self.sdo[0x6040].raw = word
            time.sleep(0.05)
        self.sdo[0x6060].raw = 1
        self.scale = self.sdo[0x608F][1].raw / self.sdo[0x608F][2].raw
        self.begin = self.sdo[0x6064].raw

    def move(self, to_mm, seconds=60):
        """Goes there, and waits until it is there."""
        self.sdo[0x607A].raw = self.begin + round(to_mm * self.scale)
        self.sdo[0x6040].raw = 0x0F
        self.sdo[0x6040].raw = 0x1F
        end = time.monotonic() + seconds
        while not (status := self.sdo[0x6041].raw) & 1 << 10:
            if status & 1 << 3:
                raise SystemExit(f"the second axis is in fault {self.sdo[0x603F].raw:#06x}")
            if time.monotonic() > end:
                raise SystemExit(f"the second axis is not at {to_mm:g} mm within {seconds} s")
            time.sleep(0.01)

    def off(self):
        """Lets go of it."""
        self.sdo[0x6040].raw = 0


def main():
    """The program."""
    parser = options(__doc__)
    parser.add_argument("what", choices=["edge", "centre"])
    parser.add_argument("--axis", type=int, default=2, help="node-ID of the second axis [%(default)s]")
    parser.add_argument("--inside-mm", type=float, default=0.0, help="a place above the work [%(default)s]")
    parser.add_argument("--left-mm", type=float, help="centre: a place beside it")
    parser.add_argument("--right-mm", type=float, required=True, help="a place beside it, to the other side")
    parser.add_argument("--to-mm", type=float, default=0.01, help="how near both sides of an edge are to come [%(default)s]")
    args = parser.parse_args()
    if args.what == "centre" and args.left_mm is None:
        parser.error("centre wants --left-mm")
    network = connect(args)
    with Head(network, args.node) as head:
        head.enable()
        head.home_here()
        axis = Axis(network, args.axis)
        try:
            if args.what == "edge":
                at = edge(head, axis, args.inside_mm, args.right_mm, to_mm=args.to_mm)
            else:
                at = centre(head, axis, args.inside_mm, args.left_mm, args.right_mm, to_mm=args.to_mm)
            axis.move(args.inside_mm)
        finally:
            axis.off()
        print(f"{args.what} at {at:.3f} mm")


if __name__ == "__main__":
    main()
