"""Compiling on several cores, and what a process that helps may not do to the one that it helps."""

import importlib
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from data.common import compiling
from data.common.processes import environment

SMALL = '''
from pathlib import Path

from data.common.compiled import compiled

HERE = Path(__file__).parent


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


def last():
    import time

    (HERE / "begun").touch()
    time.sleep(60)
'''
ASK = """
import sys

from numba.core import event

import small
from data import compiling

compiling.cores, compiling.PATIENCE_S = lambda: 3, float(sys.argv[1])
compiled = []


class Listener(event.Listener):
    def on_start(self, event):
        compiled.append(event.data["dispatcher"].__name__)

    def on_end(self, event):
        pass


with event.install_listener("numba:compile", Listener()):
    compiling.helped(small.begin, [getattr(small, name) for name in sys.argv[2:]])
    small.go_on()
print(*compiled)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With a module of two functions that have never been compiled."""
    (tmp_path / "small.py").write_text(SMALL)
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


def test_what_a_helper_compiles_is_loaded_and_once_all_is_compiled_nobody_helps(folder: Path) -> None:
    assert compiled_by(folder, "go_on") == ["_twice"]
    assert compiled_by(folder, "go_on", "last") == []
    assert not (folder / "begun").exists()


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
