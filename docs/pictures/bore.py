"""The plot of a run as the picture of README: half the size of the SVG, in few colours.

    cargo sim bore --plot bore.svg && python3 docs/pictures/bore.py bore.svg

Needs `pip install cairosvg pillow`.
"""

import io
import pathlib
import sys

import cairosvg
from PIL import Image

png = cairosvg.svg2png(url=sys.argv[1], output_width=1280)
few = Image.open(io.BytesIO(png)).convert("RGB").quantize(160)
few.save(pathlib.Path(__file__).with_name("bore.png"), optimize=True)
