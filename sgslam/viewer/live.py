"""A live run in the browser: `--view`. It is drawn between two scans, at a low rate; the results are not affected."""

import logging
from pathlib import Path
from time import perf_counter, thread_time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.trajectory import Trajectory
from sgslam.session import Snapshot
from sgslam.viewer.finished import FinishedRun, FinishedView
from sgslam.viewer.page import Page, serve_until_interrupted
from sgslam.viewer.panel import Panel

if TYPE_CHECKING:
    from sgslam.slam import SceneGraphSlam
    from sgslam.types import Update

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
EVERY_S = 0.4  # between two frames, at least
SHARE = 0.03  # of the run's time that drawing may take
_NEW_CLOUDS = 12  # scans drawn at once, at most


class LiveView:
    """Shows a run on `page`. Call `add_scan` between two scans. If drawing fails, the run goes on without it."""

    def __init__(self, page: Page, plan: SceneGraph | None = None, truth: Trajectory | None = None) -> None:
        self.page, self._truth = page, truth
        self.panel = Panel(page)
        self._scans, self._due, self._failed = 0, 0.0, False
        with page.atomic():
            self.panel.scene.show_plan(plan, truth if plan is not None else None)
            self.panel.set_camera()

    def add_scan(self, slam: "SceneGraphSlam", update: "Update", points: Floats) -> None:
        """Shows a scan that was added to `slam`: `points` (N, 3), sensor frame."""
        self._scans += 1
        if perf_counter() < self._due or self._failed:
            return
        began = thread_time()
        try:
            with self.page.atomic():
                now = slam.snapshot()
                self.panel.scene.show(now, _NEW_CLOUDS)
                self.panel.scene.show_sensor(update.T_map_sensor, points, update.T_map_sensor)
                self.panel.show(now, self._heading(now, slam.anchored), self._scans)
        except Exception as error:  # a failure to draw must not end the run
            _log.warning("the page in the browser is no longer updated: %s: %s", type(error).__name__, error)
            self._failed = True
        self._due = perf_counter() + max(EVERY_S, (thread_time() - began) / SHARE)

    def _heading(self, now: Snapshot, anchored: bool) -> str:
        if now.plan is None:
            return "No plan"
        if now.T_plan_map is None:
            return "Not anchored yet"
        if not anchored:
            return "Relocalised in the prior map"
        here = now.storeys.get(now.floors[-1] or "")
        return "Anchored" if here is None else f"Anchored, on {self.panel.scene.storeys.get(here, here)}"

    def show_finished(self, out: Path) -> None:
        """Shows the finished run in the folder `out` instead, until the user presses Ctrl-C."""
        run = FinishedRun(out, self._truth)
        self.page.clear()
        FinishedView(self.page, [run])
        serve_until_interrupted(self.page)
