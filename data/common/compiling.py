"""Compiling on several cores, the first time after an installation: each process loads what another has compiled."""

import importlib
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence

from numba.core import event

from data.common.processes import cores, environment

Work = Callable[[], object]
MOST = 4  # processes; each takes up to a gigabyte
PATIENCE_S = 300.0  # with a helper, after the own work is done


def helped(work: Work, others: Sequence[Work]) -> None:
    """Does `work`; should it have to compile anything, other processes do the `others` meanwhile, and are waited for.

    All are functions of modules, by whose names the processes find them. Where there is one core only none is started;
    one that fails is passed over, so that what it should have compiled is compiled by who needs it.
    """
    helpers: list[subprocess.Popen[bytes]] = []
    try:
        with event.install_listener("numba:compile", _AtFirst(lambda: helpers.extend(_started(others)))):
            work()
        for helper in helpers:
            helper.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        pass
    finally:
        for helper in helpers:
            helper.kill()
            helper.communicate()


class _AtFirst(event.Listener):  # type: ignore[misc]
    """Does something when a function is compiled, not loaded from disk, for the first time."""

    def __init__(self, act: Work) -> None:
        self._act: Work | None = act

    def on_start(self, event: event.Event) -> None:
        """Of any compilation."""
        act, self._act = self._act, None
        if act is not None:
            act()

    def on_end(self, event: event.Event) -> None:
        """Of any compilation."""


def _started(works: Sequence[Work]) -> list[subprocess.Popen[bytes]]:
    count = min(cores(), MOST, len(works) + 1) - 1
    code = "from data.common.compiling import _help; _help()"
    started = []
    for n in range(count):
        names = [f"{work.__module__}:{work.__qualname__}" for work in works[n::count]]
        try:
            started.append(
                subprocess.Popen(
                    [sys.executable, "-c", code, *names], env=environment(), stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                )
            )  # fmt: skip
        except OSError:  # no memory, or no Python of its own: an application that holds one
            break
    return started


def _help() -> None:
    """A helper's life: it ends with its work, or with the process that it helps, whose end it hears by its input's."""
    threading.Thread(target=lambda: (os.read(0, 1), os._exit(1)), daemon=True).start()
    for name in sys.argv[1:]:
        module, _, function = name.partition(":")
        getattr(importlib.import_module(module), function)()
