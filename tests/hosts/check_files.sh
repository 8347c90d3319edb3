#!/usr/bin/env bash
# Reads the committed EDS and DBC with lely's dcfchk, python canopen and cantools, without building anything. Needs python3
# with venv; `tests/hosts/run` makes the same checks among its own.
set -euo pipefail
cd "$(dirname "$0")/../.."
. tests/hosts/venv.sh
PYTHONDONTWRITEBYTECODE=1 "$venv/bin/python" -m pytest -p no:cacheprovider tests/hosts/test_files.py "$@"
