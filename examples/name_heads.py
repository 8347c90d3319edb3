"""Gives a node-ID to every head that waits for one (CiA 305), and stores it there: those not in use from --node on."""

import time

from canopen.lss import LssError

from head import connect, options

args = options(__doc__).parse_args()
network = connect(args)
network.scanner.search()
time.sleep(0.5)
taken = sorted(network.scanner.nodes)
print(f"in use: {', '.join(map(str, taken)) or 'none'}")
free = [node for node in range(args.node, 128) if node not in taken]
lss = network.lss
lss.send_switch_state_global(lss.WAITING_STATE)
while True:
    found, identity = lss.fast_scan()
    if not found:
        break
    if not free:
        raise SystemExit(f"serial number {identity[3]} waits, and no node-ID from {args.node} to 127 is free")
    node = free.pop(0)
    try:
        lss.configure_node_id(node)
        lss.store_configuration()
    except LssError as error:
        raise SystemExit(f"serial number {identity[3]} does not become node {node}: {error}") from error
    # It boots with that.
    lss.send_switch_state_global(lss.WAITING_STATE)
    print(f"serial number {identity[3]} is node {node}")
print("no other head waits for a node-ID")
network.disconnect()
