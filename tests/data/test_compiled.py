"""Compiled functions are kept on disk: nothing outdated is loaded, and what cannot be kept is compiled all the same."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from data.common.compiled import version
from data.common.processes import environment

SMALL = """
from data.common.compiled import compiled
@compiled
def twice(x): return 2 * x
@compiled
def thrice(x): return 3 * x
def begin(): assert twice(21.0) == 42.0
def other(): assert thrice(7.0) == 21.0
"""
RUN = """
import small
from data.common.compiling import on_two_cores
on_two_cores(small.begin, small.other)
small.other()
print(*(sum(f.stats.cache_misses.values()) for f in (small.twice, small.thrice)))
"""


def test_a_change_of_any_compiled_file_is_another_version(tmp_path: Path) -> None:
    (tmp_path / "matching").mkdir()
    versions = []
    for name, text in (("inner", "compiled"), ("outer", "compiled"), ("other", "no loop"), ("inner", "compiled x")):
        (tmp_path / "matching" / f"{name}.py").write_text(text)
        versions.append(version(tmp_path))
    assert versions[1] == versions[2] and len(set(versions)) == 3


@pytest.mark.slow
def test_what_another_process_compiles_is_loaded(tmp_path: Path) -> None:
    (tmp_path / "small.py").write_text(SMALL)
    variables = {**environment(), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    variables["PYTHONPATH"] = f"{tmp_path}{os.pathsep}{variables['PYTHONPATH']}"
    for expected in ("1 0", "0 0"):
        line = [sys.executable, "-c", RUN]
        done = subprocess.run(line, env=variables, capture_output=True, text=True, timeout=60, check=True)
        assert done.stdout.split() == expected.split() and not done.stderr
