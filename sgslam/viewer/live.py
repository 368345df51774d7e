"""A run while it goes on, as a page in the browser: `--view`. What is drawn is drawn in a thread of its own, as seldom
as the run's time allows; nothing of it changes the run."""

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
from sgslam.session.snapshot import Snapshot
from sgslam.viewer.errors import KNOWN, LiveErrors, rms
from sgslam.viewer.finished import RED, SCAN_POINTS, FinishedRun, FinishedView
from sgslam.viewer.page import Page, address, stay
from sgslam.viewer.panel import Panel, metres
from sgslam.viewer.scene import RunScene

if TYPE_CHECKING:
    from sgslam.session.result import Update
    from sgslam.slam import SceneGraphSlam

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
EVERY_S = 0.4  # between two pictures, at least
SHARE = 0.03  # of a processor's time that drawing may take, and that taking stock may
NEW_CLOUDS = 12  # scans that are drawn at once, at most


@dataclass(frozen=True, eq=False)
class _Moment:
    now: Snapshot
    T_map_sensor: Floats
    T_bim_map: Floats | None
    points: Floats
    scans: int


class LiveView:
    """Shows a run on `page`. `tell` is called between two scans and takes next to no time; where drawing fails, the run
    goes on without it."""

    def __init__(self, page: Page, plan: SceneGraph | None = None, truth: Trajectory | None = None) -> None:
        self.page = page
        self._scene, self._truth = RunScene(page), truth
        self.panel = Panel(page, self._scene)
        self._errors = None if truth is None else LiveErrors(truth)
        self._scans, self._due = 0, 0.0
        self._moments: queue.Queue[_Moment | None] = queue.Queue(1)
        self._ended = threading.Event()
        with page.at_once():
            self._scene.show_plan(plan, truth if plan is not None else None)
            self._scene.look()
        self._thread = threading.Thread(target=self._draw_on, name="sgslam view", daemon=True)
        self._thread.start()

    def tell(self, slam: "SceneGraphSlam", update: "Update", points: Floats) -> None:
        """A scan was added: `points` (N, 3), sensor frame, which nobody changes any more."""
        self._scans += 1
        if self._errors is not None:
            self._errors.note(update.stamp_ns, update.T_map_sensor, slam.T_bim_map)
        if perf_counter() < self._due or self._moments.full() or not self._thread.is_alive():
            return
        began = thread_time()
        now = slam.snapshot()
        if now.plan is None:  # rooms are cut at the end only
            cut = slam.s_graph()
            now = replace(now, graphs=tuple(cut.on_floor(floor.id) for floor in cut.floors))
        some = points[:: max(1, len(points) // SCAN_POINTS)]
        self._moments.put(_Moment(now, update.T_map_sensor, slam.T_bim_map, some, self._scans))
        self._due = perf_counter() + _pause(thread_time() - began)

    def _draw_on(self) -> None:
        while (moment := self._moments.get()) is not None:
            began = thread_time()
            try:
                with self.page.at_once():
                    self._draw(moment)
            except Exception as error:  # whatever it is, the run is not to end of it
                _log.warning("the page in the browser stands still: %s: %s", type(error).__name__, error)
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
            facts.append(f"error of the way: {metres(rms(lines[KNOWN]))} RMS" if KNOWN in lines else "")
        self.panel.tell(now, self._heading(now, moment.T_bim_map is not None), facts)

    def _heading(self, now: Snapshot, anchored: bool) -> str:
        if now.plan is None:
            return "No plan was given"
        if now.T_plan_map is None:
            return "Not anchored yet"
        if not anchored:
            return "Found in the known map"
        here = now.storeys.get(now.floors[-1] or "")
        on = f", on {self._scene.storeys.get(here, here)}" if here is not None else ""
        return f"Anchored{on}"

    def wait(self) -> None:
        """Until what was told is drawn, or nothing is drawn any more."""
        while self._moments.unfinished_tasks and self._thread.is_alive():
            sleep(0.002)

    def stop(self) -> None:
        """Draws nothing more."""
        self._ended.set()
        with contextlib.suppress(queue.Full):
            self._moments.put_nowait(None)
        self._thread.join()

    def stay(self, out: Path) -> None:
        """Shows the finished run of a folder in place of what was shown, until the user has seen enough."""
        self.stop()
        run = FinishedRun(out, self._truth)
        self.page.clear()
        FinishedView(self.page, [run])
        stay(self.page)


def _pause(took: float) -> float:
    """Seconds to wait after work that took so many of a processor."""
    return max(EVERY_S, took / SHARE)


def open_page(at: str) -> Page:
    """The page of a run that begins; raises UserError where there can be none."""
    page = Page(address(at))
    print(f"view: {page.url}", flush=True)
    return page
