"""Homes the head at its upper stop and erodes along a path of G-code: lines and arcs that lead X and Y along.

X, Y and Z are mm, Z0 the surface of the work. The head is Z; its set points of X and Y are objects 200Eh:12 and 13, for
whoever drives these axes. A virtual head has nobody who does, and a gap below it alone.
"""

import pathlib
import time

import canopen
from gcode import Wrong, segments
from head import Head, connect, options

# State of 2000h:1.
DONE = 6

parser = options(__doc__)
parser.add_argument("program", type=pathlib.Path, help="file of G-code, such as examples/cavity.ngc")
parser.add_argument("--surface-mm", type=float, default=2.0, help="surface of the work below home [%(default)s]")
args = parser.parse_args()
try:
    path = list(segments(args.program.read_text()))
except (OSError, UnicodeDecodeError, Wrong) as error:
    raise SystemExit(f"{args.program}: {error}") from None
if not path:
    raise SystemExit(f"{args.program}: no move")


def push(head, segment):
    """Appends a segment, or says what is wrong with it."""
    record = head.sdo[0x200E]
    values = [segment.down + round(args.surface_mm * 1e6), segment.x, segment.y, *segment.centre, segment.shape, 0]
    for sub, value in enumerate(values, 1):
        record[sub].raw = value
    try:
        record[8].raw = 1
    except canopen.SdoAbortedError:
        pass
    # The head has a millisecond to answer.
    time.sleep(0.002)
    if refused := record[9].raw:
        raise SystemExit(f"{args.program}: line {segment.line}: refused, {refused} of docs/objects.md (200Eh:9)")


network = connect(args)
with Head(network, args.node) as head:
    counts_per_mm = head.counts_per_mm()
    head.enable()
    head.home_here()
    head.sdo[0x6081].raw = round(20 * counts_per_mm)
    head.move((args.surface_mm - 0.2) * counts_per_mm)
    print(f"homed, 0.2 mm above the work; {len(path)} segments")

    head.sdo[0x200E][8].raw = 0  # of what was before
    appended = head.sdo[0x200E][10].raw
    waiting = list(path)
    feed_max = head.sdo[0x2102][9].raw
    bounded = None
    began = told = time.monotonic()
    while True:
        while waiting and head.sdo[0x2004][4].raw > 1:
            push(head, waiting.pop(0))
        # The segment under way bounds the feed.
        under_way = path[max(0, head.sdo[0x2004][5].raw - appended - 1)]
        if bounded != under_way.feed:
            bounded = under_way.feed
            head.sdo[0x2102][9].raw = feed_max if bounded is None else min(feed_max, bounded)
        if not head.sdo[0x2001][1].raw:
            head.sdo[0x2001][1].raw = 1
        state = head.sdo[0x2000][1].raw
        head.check("eroding")
        if state == DONE and not waiting:
            break
        if time.monotonic() - told >= 2:
            told = time.monotonic()
            x, y = (head.sdo[0x200E][sub].raw * 1e-6 for sub in (12, 13))
            z = args.surface_mm - head.sdo[0x6064].raw / counts_per_mm
            print(f"  {told - began:4.0f} s  X {x:7.3f}  Y {y:7.3f}  Z {z:7.3f} mm  {head.sdo[0x2005][1].raw / 100:5.1f} V")
        time.sleep(0.02)
    head.sdo[0x2001][1].raw = 0
    head.sdo[0x2102][9].raw = feed_max
    x, y = (head.sdo[0x200E][sub].raw * 1e-6 for sub in (12, 13))
    z = args.surface_mm - head.sdo[0x6064].raw / counts_per_mm
    taken = head.sdo[0x200E][10].raw - appended
    print(f"{taken} segments eroded in {time.monotonic() - began:.0f} s, at X {x:.3f}, Y {y:.3f}, Z {z:.3f} mm")
    head.move(0)
