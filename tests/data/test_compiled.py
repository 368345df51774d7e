"""Compiled functions are kept on disk: nothing outdated is loaded, and what cannot be kept is compiled all the same."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import config

from data.common.compiled import folder, version
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
from data.common.compiled import Compilation
Compilation(small.begin, small.other).wait()
small.begin(), small.other()
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
    for lines in (1, 0):
        line = [sys.executable, "-c", RUN]
        done = subprocess.run(line, env=variables, capture_output=True, text=True, timeout=60, check=True)
        assert done.stdout.split() == ["0", "0"] and len(done.stderr.splitlines()) == lines


def test_where_the_cache_cannot_be_written_another_folder_is_used_and_one_line_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "file"))
    assert folder("some").is_dir() and tmp_path not in folder("some").parents
    assert all("NUMBA_CACHE_DIR" in line for line in caplog.messages) and len(caplog.messages) == 2
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "kept"))
    assert folder("some") == tmp_path / "kept/sgslam-some" and len(caplog.messages) == 2
