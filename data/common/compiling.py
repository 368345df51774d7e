"""Compiles ahead, in processes of its own, what would otherwise be compiled when it is first called."""

import atexit
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress

from data.common.compiled import FOLDER
from data.common.processes import environment

_MESSAGE = "compiling the loops of tracking and matching, once per installed version: about a minute on two cores"


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
