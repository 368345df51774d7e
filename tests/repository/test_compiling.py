"""Compiling on two cores: what one process has compiled the other loads."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from data.common.processes import environment

SMALL = """
from data.common.compiled import compiled


@compiled
def _twice(x):
    return 2 * x


@compiled
def _thrice(x):
    return 3 * x


def begin():
    assert _twice(21.0) == 42.0


def go_on():
    print("a word")
    assert _thrice(7.0) == 21.0


def fail():
    raise SystemExit("a reason")
"""
ASK = """
import sys

import small
from data.common.compiling import on_two_cores

on_two_cores(small.begin, getattr(small, sys.argv[1]))
small.go_on()
print(*(sum(f.stats.cache_misses.values()) for f in (small._twice, small._thrice)))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("other", "compiled"), [("go_on", "1 0"), ("fail", "1 1")])
def test_what_the_other_process_compiles_is_loaded(tmp_path: Path, other: str, compiled: str) -> None:
    (tmp_path / "small.py").write_text(SMALL)
    told = {**environment(), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    told["PYTHONPATH"] = f"{tmp_path}{os.pathsep}{told['PYTHONPATH']}"
    for expected in (compiled, "0 0"):
        line = [sys.executable, "-c", ASK, other]
        done = subprocess.run(line, env=told, capture_output=True, text=True, timeout=60, check=True)
        assert done.stdout.splitlines() == ["a word", expected] and not done.stderr  # of the other nothing is heard
