"""Compiling on two cores, the first time after an installation or an update: it takes half as long."""

import subprocess
import sys
from collections.abc import Callable

from data.common.processes import environment

Work = Callable[[], object]


def on_two_cores(work: Work, other: Work) -> None:
    """Does `work`, and in another process `other`, a function of a module, and waits for both: what one has compiled
    the other loads. Where the other process fails, what it should have compiled is compiled by who needs it."""
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
