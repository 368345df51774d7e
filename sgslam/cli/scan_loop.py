"""Scans into a run, one by one, its state kept on the way; a user who interrupts it loses nothing."""

import logging
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter
from types import FrameType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from data import UserError
from data.scans import ScanSource
from sgslam.odometry.external import ExternalOdometry
from sgslam.session.checkpoints import Checkpoints
from sgslam.session.result import Update
from sgslam.slam import SceneGraphSlam

Onlooker: TypeAlias = Callable[[SceneGraphSlam, Update, NDArray[np.float64]], None]


@dataclass
class Progress:
    """How far a run has come: `index` of the newest scan, how many were `fed`, seconds spent outside `SceneGraphSlam`,
    of the clock's and of the processors' before the run was broken off."""

    index: int = -1
    fed: int = 0
    seconds: dict[str, float] = field(default_factory=lambda: {"reading": 0.0, "checkpoints": 0.0})

    def to_dict(self) -> dict[str, Any]:
        """As `Progress(**it)` takes it."""
        return {"index": self.index, "fed": self.fed, "seconds": self.seconds}


class Interruption:
    """Becomes true when the user (Ctrl-C) or the system (SIGTERM) asks the process to end."""

    def __init__(self) -> None:
        self._asked = False

    def __bool__(self) -> bool:
        """Whether it was asked."""
        return self._asked

    def ask(self, number: int, frame: FrameType | None) -> None:
        """Takes note; who asks twice does not want to wait."""
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Within it a signal to end is taken note of, so that a scan is never left half done."""
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    before = {number: signal.signal(number, interruption.ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def feed(
    slam: SceneGraphSlam, scans: ScanSource, progress: Progress, checkpoints: Checkpoints,
    given: ExternalOdometry | None = None, onlooker: Onlooker | None = None,
) -> str | None:  # fmt: skip
    """Feeds the scans after those that `progress` tells of, and keeps it up to date; returns why it had to stop early,
    if it had. The `onlooker` is told of each scan right after it. Raises UserError where not even one could be fed,
    KeyboardInterrupt where the user could not wait."""
    from rich.console import Console
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    with interruptible() as interruption, Bar(console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task("scans", total=len(scans))
        waiting = perf_counter()
        try:
            for scan in scans:
                if scan.index <= progress.index and not interruption:
                    continue
                progress.seconds["reading"] += perf_counter() - waiting
                if interruption:
                    checkpoints.write(slam, progress.to_dict())
                    return f"interrupted after {progress.fed} of {len(scans)} scans"
                if not progress.fed:
                    _doubt_units(scan.points)
                T_odom_sensor = scan.T_odom_sensor if given is None else given.at(scan.stamp_ns)
                update = slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T_odom_sensor)
                if onlooker is not None:
                    onlooker(slam, update, scan.points)
                progress.index, progress.fed = scan.index, progress.fed + 1
                bar.update(task, completed=scan.index + 1)
                began = perf_counter()
                checkpoints.write_if_due(slam, progress.to_dict())
                waiting = perf_counter()
                progress.seconds["checkpoints"] += waiting - began
        except UserError as error:
            if not progress.fed:
                raise
            return str(error)
    return None


def _doubt_units(points: NDArray[np.float64]) -> None:
    """Warns where the first scan is a building's size in millimetres."""
    far = float(np.median(np.linalg.norm(points, axis=1)))
    if far > 500.0:
        logging.getLogger("sgslam").warning("half of the points are over %.0f m away: are the scans in metres?", far)
