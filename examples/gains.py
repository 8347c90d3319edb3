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
    try:
        setting = head.setting(key)
    except (KeyError, ValueError):
        print(f"{key}: no such setting; docs/settings.md lists all")
        continue
    before = setting.raw
    if value:
        try:
            # Yes and no are 1 and 0, one of several words its number: docs/objects.md.
            setting.raw = bool(int(value)) if isinstance(before, bool) else type(before)(value)
        except ValueError:
            print(f"{key} = {value}: must be a number")
            continue
        except canopen.SdoAbortedError as error:
            print(f"{key} = {value}: refused: {error}")
            continue
    print(f"{key} = {before:g}" + (f" -> {setting.raw:g}" if value else ""))
network.disconnect()
