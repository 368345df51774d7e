"""Work for a cluster whose workers are to be tried."""

import time
from pathlib import Path

from data.common import build as of_build
from data.common.build import build


def slowly_doubled(n: int) -> int:
    time.sleep(0.05)
    return 2 * n


def failing(log: Path, error: type[Exception], times: int, n: int) -> int:
    """Logs that it is called; three raises an error so many times."""
    if n == 3:
        with log.open("a") as lines:
            lines.write("called\n")
        if len(log.read_text().splitlines()) <= times:
            raise error("three\nis too much")
    return 2 * n


def pretend(version: str | None) -> None:
    """Lets this process take itself for another build; None ends it."""
    of_build.build = build if version is None else lambda: version
