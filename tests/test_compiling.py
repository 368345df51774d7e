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


@pytest.mark.parametrize(("other", "compiled"), [("go_on", "1 0"), ("fail", "1 1")])
def test_what_the_other_process_compiles_is_loaded(tmp_path: Path, other: str, compiled: str) -> None:
    (tmp_path / "small.py").write_text(SMALL)
<<<<<<< HEAD
    told = {**environment(), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    told["PYTHONPATH"] = f"{tmp_path}{os.pathsep}{told['PYTHONPATH']}"
    for expected in (compiled, "0 0"):
        line = [sys.executable, "-c", ASK, other]
        done = subprocess.run(line, env=told, capture_output=True, text=True, timeout=60, check=True)
        assert done.stdout.splitlines() == ["a word", expected] and not done.stderr  # of the other nothing is heard
=======
    return tmp_path


def compiled_by(folder: Path, *others: str, patience: float = 60.0) -> list[str]:
    """What a new process has to compile itself, while helpers do the others."""
    told = {**environment(), "NUMBA_CACHE_DIR": str(folder / "kept")}
    told["PYTHONPATH"] = f"{folder}{os.pathsep}{told['PYTHONPATH']}"
    line = [sys.executable, "-c", ASK, str(patience), *others]
    done = subprocess.run(line, env=told, capture_output=True, text=True, timeout=60, check=True)
    word, names = done.stdout.splitlines()
    assert word == "a word" and not done.stderr  # its own; of its helpers nothing is heard
    return names.split()


@pytest.mark.slow
def test_what_a_helper_compiles_is_loaded_and_once_all_is_compiled_nobody_helps(folder: Path) -> None:
    assert compiled_by(folder, "go_on") == ["_twice"]
    assert compiled_by(folder, "go_on", "last") == []
    assert not (folder / "begun").exists()


@pytest.mark.slow
def test_helpers_that_fail_or_do_not_end_harm_nothing(folder: Path) -> None:
    assert compiled_by(folder, "fail", "last", patience=0.5) == ["_twice", "_thrice"]


def test_a_helper_ends_with_the_process_that_it_helps(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(compiling, "cores", lambda: 2)
    (helper,) = compiling._started([importlib.import_module("small").last])
    while not (folder / "begun").exists():
        assert helper.poll() is None
        time.sleep(0.02)
    assert helper.stdin is not None
    helper.stdin.close()  # as the system does where a process is killed
    assert helper.wait(20) == 1
>>>>>>> b3b1813 (Tests: the marker slow, by measured durations; -m 'not slow' is the quick tier)
