"""Shows settings of a head, or changes them while it runs: gains.py servo.velocity_hz=120 feed.gain_um_s_v"""

import canopen

from head import Head, connect, options

parser = options(__doc__)
parser.add_argument("settings", nargs="+", metavar="KEY[=VALUE]")
args = parser.parse_args()
network = connect(args)
head = Head(network, args.node)
for word in args.settings:
    key, _, value = word.partition("=")
    setting = head.setting(key)
    before = setting.raw
    if value:
        try:
            setting.raw = type(before)(value)
        except canopen.SdoAbortedError as error:
            print(f"{key} = {value}: refused: {error}")
            continue
    print(f"{key} = {before:g}" + (f" -> {setting.raw:g}" if value else ""))
network.disconnect()
