# Sourced by the scripts beside it: sets `target` and `venv`, a Python environment with the pinned packages.
target=${CARGO_TARGET_DIR:-target}
venv=$target/hosts-venv
if ! cmp -s tests/hosts/requirements.txt "$venv/installed.txt"; then
  python3 -m venv --clear "$venv"
  "$venv/bin/pip" install --quiet --disable-pip-version-check -r tests/hosts/requirements.txt
  cp tests/hosts/requirements.txt "$venv/installed.txt"
fi
