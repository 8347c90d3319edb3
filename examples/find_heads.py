"""Finds all heads on the bus, and prints type, identity, limits and resolution of each."""

import time

import canopen

from head import EDS, connect, options

args = options(__doc__).parse_args()
network = connect(args)
network.scanner.search()
time.sleep(0.5)
for node_id in sorted(network.scanner.nodes):
    node = network.add_node(node_id, str(EDS))
    profile = node.sdo[0x1000].raw & 0xFFFF
    if profile != 402:
        print(f"node {node_id}: no drive (profile {profile})")
        continue
    identity = node.sdo[0x1018]
    counts, millimetres = node.sdo[0x608F][1].raw, node.sdo[0x608F][2].raw
    resolution_um = 1000 * millimetres / counts
    low, high = (node.sdo[0x607D][sub].raw for sub in (1, 2))
    stroke_um = node.sdo["axis"]["stroke_um"].raw
    limits = "none but the stroke" if (low, high) == (-(2**31), 2**31 - 1) else f"{low} to {high} counts"
    print(f"node {node_id}: {node.sdo[0x1008].raw}, hardware {node.sdo[0x1009].raw}, software {node.sdo[0x100A].raw}")
    print(f"  serial number  {identity[4].raw}")
    print(f"  resolution     {resolution_um:g} um a count")
    print(f"  stroke         {stroke_um / 1000:g} mm; software limits: {limits}")
    print(f"  fastest        {node.sdo[0x607F].raw * resolution_um / 1000:g} mm/s")
network.disconnect()
