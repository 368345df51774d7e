"""Compiles on two cores after an installation or an update, which halves the time."""

import subprocess
import sys
from collections.abc import Callable

from data.common.processes import environment

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
