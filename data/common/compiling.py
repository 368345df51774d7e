"""Compiles on two cores after an installation or an update, which halves the time."""

import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress

from data.common.compiled import FOLDER
from data.common.processes import cores, environment

Work = Callable[[], object]


def on_two_cores(work: Work, other: Work) -> None:
    """Runs `work`, and `other` (a function of a module) in another process, and waits for both.

    What one has compiled the other can load. If the other process fails, its functions are compiled when first needed.
    """
    code = f"from {other.__module__} import {other.__qualname__} as work; work()"
    quiet = subprocess.DEVNULL
    helper = subprocess.Popen(
        [sys.executable, "-c", code], env=environment(), stdin=quiet, stdout=quiet, stderr=quiet
    )  # fmt: skip
    try:
        work()
        helper.wait()
    finally:
        helper.kill()
        helper.wait()


def once_on_two_cores(name: str, work: Work, other: Work) -> None:
    """As `on_two_cores`, unless this version's code has done it before; nothing on a single core.

    `name` distinguishes this work from other such work.
    """
    done = FOLDER / f"{name}.done"
    if FOLDER.is_dir() and not done.exists() and cores() > 1:
        on_two_cores(work, other)
        with suppress(OSError):
            done.touch()
