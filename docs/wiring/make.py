"""Draws the wiring sheets of docs/wiring.md.

pip install -r docs/wiring/requirements.txt
python docs/wiring/make.py
"""

from pathlib import Path

import drive
import gap
import overview
import signals

HERE = Path(__file__).parent

for stem, module in {"1-overview": overview, "2-gap": gap, "3-drive": drive, "4-signals": signals}.items():
    module.sheet().save(HERE, stem)
