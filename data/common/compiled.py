"""Functions compiled to machine code, for the few loops that numpy cannot express."""

import atexit
import logging
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import TypeVar

import llvmlite.binding as llvm
import numba
from numba import config, njit

from data.common.build import PRODUCT
from data.common.files import user_cache
from data.common.processes import environment

_F = TypeVar("_F", bound=Callable[..., object])
MOST_VERSIONS = 5  # on disk, of some 12 MB each; more only if they were used within a day
_DAY = 86400.0  # s
_log = logging.getLogger(__name__)
_MESSAGE = "compiling the loops of tracking and matching, once per installed version: about a minute on two cores"


def sources(root: Path) -> list[Path]:
    """The files that compiled functions and their constants come from: those that contain the word `compiled`."""
    files = (path for package in PRODUCT for path in sorted((root / package).rglob("*.py")))
    return [path for path in files if b"compiled" in path.read_bytes()]


def version(root: Path) -> str:
    """A hash of the sources, where and when they were installed, and of what they are compiled by and for. Numba itself
    only checks a function's own file and would keep outdated callees and constants.
    """
    digest = blake2b(digest_size=8)
    made_by = (sys.implementation.cache_tag, numba.__version__)
    made_for = (llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
    digest.update(repr((str(root), made_by, made_for)).encode())
    for path in sources(root):
        digest.update(f"{path.relative_to(root)} {path.stat().st_mtime_ns}\n".encode() + path.read_bytes())
    return digest.hexdigest()


def folder(version: str) -> Path:
    """Returns the folder for a version's machine code, created if needed; versions that were not used for long are
    removed. Where it cannot be written, a temporary one is returned, which ends with the process.
    """
    try:
        chosen = Path(config.CACHE_DIR or user_cache() / "compiled") / f"sgslam-{version}"
        chosen.mkdir(parents=True, exist_ok=True)
        chosen.touch()
        with tempfile.TemporaryFile(dir=chosen):
            pass
    except (OSError, RuntimeError) as error:  # RuntimeError: a user without a home
        what = "compiled code cannot be kept (%s): every run compiles again; set NUMBA_CACHE_DIR to a writable folder"
        _log.warning(what, error)
        chosen = Path(tempfile.mkdtemp(prefix="sgslam-")) / f"sgslam-{version}"
        chosen.mkdir()
        atexit.register(shutil.rmtree, chosen.parent, ignore_errors=True)
        return chosen
    with suppress(OSError):
        used = sorted((path.stat().st_mtime, path) for path in chosen.parent.glob("sgslam-*"))
        for when, path in used[:-MOST_VERSIONS]:
            if when < time.time() - _DAY:
                shutil.rmtree(path, ignore_errors=True)
    return chosen


FOLDER = folder(version(Path(__file__).resolve().parents[2]))


def compiled(function: _F, inline: str = "never") -> _F:
    """Compiles `function` with numba at the first call with given argument types; the result is cached on disk.

    Arithmetic follows IEEE (no fastmath; x / 0 is infinite), so results are reproducible.
    """
    options = {"nogil": True, "error_model": "numpy", "inline": inline, "no_cfunc_wrapper": True}
    others, config.CACHE_DIR = config.CACHE_DIR, str(FOLDER)  # for ours alone, not for an application's own functions
    try:
        fast: _F = njit(function, cache=True, **options)
    finally:
        config.CACHE_DIR = others
    return fast


def compiled_within(function: _F) -> _F:
    """As `compiled`, but inlined into the compiled function that calls it: for long functions with one caller, which
    would otherwise be compiled twice.
    """
    return compiled(function, inline="always")


class Compilation:
    """Calls functions of modules, each in a process of its own, unless this version's code was compiled before.

    What they compile the others can load. If a process fails, its functions are compiled when they are first needed.
    """

    def __init__(self, *works: Callable[[], object]) -> None:
        self._done, quiet = FOLDER / "all.done", subprocess.DEVNULL
        works = () if self._done.exists() else works
        if works:
            print(_MESSAGE, file=sys.stderr)
        codes = [f"from {work.__module__} import {work.__qualname__} as work; work()" for work in works]
        own = {**environment(), "NUMBA_CACHE_DIR": str(FOLDER.parent)}
        self._processes = [
            subprocess.Popen([sys.executable, "-c", code], env=own, stdin=quiet, stdout=quiet, stderr=quiet)
            for code in codes
        ]
        for process in self._processes:
            atexit.register(process.kill)  # of a command that ends before with a mistake of the user

    def wait(self) -> None:
        """Returns when all is compiled."""
        if self._processes and not any([process.wait() for process in self._processes]):
            with suppress(OSError):
                self._done.touch()
