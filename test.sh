#!/usr/bin/env bash
# Makes the virtual environment where there is none, and runs the tests.
set -euo pipefail
cd "$(dirname "$0")"
. ./setup.sh
python -m pytest "$@"
