# Makes .venv where there is none, installs sgslam into it and activates it; to be sourced.
python3 - <<'PY' || { echo "sgslam needs Python 3.11 or newer with venv" >&2; exit 2; }
import sys, venv, ensurepip
sys.exit(sys.version_info < (3, 11))
PY
if [ ! -x .venv/bin/python ]; then
    python3 -m venv .venv
fi
. .venv/bin/activate
if [ ! -f .venv/.installed ] || [ pyproject.toml -nt .venv/.installed ]; then
    python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
    touch .venv/.installed
fi
