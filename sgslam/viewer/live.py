"""A live run in the browser: `--view`. A thread of its own draws it, at a low rate; the run is not affected."""

import contextlib
import logging
import queue
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, sleep, thread_time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.trajectory import Trajectory
from sgslam.report.number_formats import metres
from sgslam.session import Snapshot
from sgslam.viewer.errors import CURRENT, LiveErrors, rms
from sgslam.viewer.finished import RED, SCAN_POINTS, FinishedRun, FinishedView
from sgslam.viewer.page import Page, parse_address, serve_until_interrupted
from sgslam.viewer.panel import Panel
from sgslam.viewer.scene import RunScene

if TYPE_CHECKING:
    from sgslam.session import Update
    from sgslam.slam import SceneGraphSlam

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
EVERY_S = 0.4  # between two frames, at least
SHARE = 0.03  # of one core that drawing may take, and that snapshots may take
NEW_CLOUDS = 12  # scans drawn at once, at most


@dataclass(frozen=True, eq=False)
class _Moment:
    now: Snapshot
    T_map_sensor: Floats
    T_bim_map: Floats | None
    points: Floats
    scans: int


class LiveView:
    """Shows a run on `page`. Call `add_scan` between two scans; it takes almost no time. If drawing fails, the run goes
    on without it."""

    def __init__(self, page: Page, plan: SceneGraph | None = None, truth: Trajectory | None = None) -> None:
        self.page = page
        self._scene, self._truth = RunScene(page), truth
        self.panel = Panel(page, self._scene)
        self._errors = None if truth is None else LiveErrors(truth)
        self._scans, self._due = 0, 0.0
        self._moments: queue.Queue[_Moment | None] = queue.Queue(1)
        self._ended = threading.Event()
        with page.atomic():
            self._scene.show_plan(plan, truth if plan is not None else None)
            self._scene.set_camera()
        self._thread = threading.Thread(target=self._draw_loop, name="sgslam view", daemon=True)
        self._thread.start()

    def add_scan(self, slam: "SceneGraphSlam", update: "Update", points: Floats) -> None:
        """Shows a scan that was added to `slam`: `points` (N, 3), sensor frame, not to be changed afterwards."""
        self._scans += 1
        if self._errors is not None:
            self._errors.add(update.stamp_ns, update.T_map_sensor, slam.T_bim_map)
        if perf_counter() < self._due or self._moments.full() or not self._thread.is_alive():
            return
        began = thread_time()
        now = slam.snapshot()
        if now.plan is None:  # without a plan, rooms are segmented only at the end
            current = slam.s_graph()
            now = replace(now, graphs=tuple(current.on_floor(floor.id) for floor in current.floors))
        some = points[:: max(1, len(points) // SCAN_POINTS)]
        self._moments.put(_Moment(now, update.T_map_sensor, slam.T_bim_map, some, self._scans))
        self._due = perf_counter() + _pause(thread_time() - began)

    def _draw_loop(self) -> None:
        while (moment := self._moments.get()) is not None:
            began = thread_time()
            try:
                with self.page.atomic():
                    self._draw(moment)
            except Exception as error:  # a failure to draw must not end the run
                _log.warning("the page in the browser is no longer updated: %s: %s", type(error).__name__, error)
                return
            finally:
                self._moments.task_done()
            if self._ended.wait(_pause(thread_time() - began)):
                return

    def _draw(self, moment: _Moment) -> None:
        now = moment.now
        self._scene.show(now, moment.T_map_sensor, NEW_CLOUDS)
        self.page.points("/map/scan", moment.points, RED, moment.T_map_sensor, size=0.03)
        facts = [now.reason, f"{moment.scans} scans, {len(now.poses)} keyframes"]
        rooms = sum(len(graph.rooms) for graph in now.graphs)
        facts.append(f"{rooms} rooms, {sum(len(g.wall_surfaces) for g in now.graphs)} wall surfaces")
        if self._errors is not None:
            seconds, lines = self._errors.lines(now.stamps_ns, now.poses, moment.T_bim_map)
            self.panel.draw_errors(seconds, lines)
            facts.append(f"RMSE of the trajectory so far: {metres(rms(lines[CURRENT]))}" if CURRENT in lines else "")
        self.panel.show_status(now, self._heading(now, moment.T_bim_map is not None), facts)

    def _heading(self, now: Snapshot, anchored: bool) -> str:
        if now.plan is None:
            return "No plan"
        if now.T_plan_map is None:
            return "Not anchored yet"
        if not anchored:
            return "Relocalised in the prior map"
        here = now.storeys.get(now.floors[-1] or "")
        on = f", on {self._scene.storeys.get(here, here)}" if here is not None else ""
        return f"Anchored{on}"

    def wait(self) -> None:
        """Waits until everything added is drawn, or the view has ended."""
        while self._moments.unfinished_tasks and self._thread.is_alive():
            sleep(0.002)

    def stop(self) -> None:
        """Stops drawing."""
        self._ended.set()
        with contextlib.suppress(queue.Full):
            self._moments.put_nowait(None)
        self._thread.join()

    def show_finished(self, out: Path) -> None:
        """Shows the finished run in the folder `out` instead, until the user presses Ctrl-C."""
        self.stop()
        run = FinishedRun(out, self._truth)
        self.page.clear()
        FinishedView(self.page, [run])
        serve_until_interrupted(self.page)


def _pause(took: float) -> float:
    """Seconds to wait after work that took `took` seconds of CPU time."""
    return max(EVERY_S, took / SHARE)


def open_page(at: str) -> Page:
    """Opens the page of a live run at `[HOST:]PORT`. Raises UserError if that is not possible."""
    page = Page(parse_address(at))
    print(f"view: {page.url}", flush=True)
    return page
