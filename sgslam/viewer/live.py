"""A live run in the browser: `--view`. A thread of its own draws it, at a low rate; the run is not affected."""

import contextlib
import logging
import queue
import threading
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, sleep, thread_time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.trajectory import Trajectory
from sgslam.geometry.frames import inverse
from sgslam.geometry.trajectory_errors import associate
from sgslam.report.number_formats import metres
from sgslam.session import Snapshot
from sgslam.viewer.finished import RED, FinishedRun, FinishedView
from sgslam.viewer.page import Page, parse_address, serve_until_interrupted
from sgslam.viewer.panel import Panel
from sgslam.viewer.scene import SCAN_POINTS, RunScene, with_rooms

if TYPE_CHECKING:
    from sgslam.slam import SceneGraphSlam
    from sgslam.types import Update

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
EVERY_S = 0.4  # between two frames, at least
SHARE = 0.03  # of one core that drawing may take, and that snapshots may take
LIVE, CURRENT = "live", "current estimate"
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
        now = with_rooms(slam)
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


class LiveErrors:
    """Position errors against `truth` (T_bim_sensor).

    While the map is not anchored, its first pose is set to the true one, so that the error is the drift.
    """

    def __init__(self, truth: Trajectory) -> None:
        self._truth = truth
        self._stamps: list[int] = []
        self._poses: list[Floats] = []
        self._places: list[Floats | None] = []

    def add(self, stamp_ns: int, T_map_sensor: Floats, T_bim_map: Floats | None) -> None:
        """Adds the live pose of a scan."""
        self._stamps.append(stamp_ns)
        self._poses.append(T_map_sensor)
        self._places.append(T_bim_map)

    def lines(
        self, keyframes_ns: NDArray[np.int64], keyframes: Floats, T_bim_map: Floats | None
    ) -> tuple[Floats, dict[str, Floats]]:
        """Seconds (N,) since the first scan, and errors (N,) in metres by name: of the live poses, and of the current
        trajectory through the keyframes (K, 4, 4) T_map_sensor. NaN where there is no truth."""
        count = len(self._stamps)  # the run may add scans meanwhile
        stamps, poses = np.array(self._stamps[:count], dtype=np.int64), np.array(self._poses[:count])
        ours, true = associate(stamps, self._truth.stamps_ns)
        if not len(ours):
            return np.empty(0), {}
        start = self._truth.poses[true[0]] @ inverse(poses[ours[0]])
        T = np.array([start if place is None else place for place in self._places[:count]])
        places = (T @ poses[:, :, 3, None])[:, :3, 0]
        live = np.full(count, np.nan)
        live[ours] = np.linalg.norm(places[ours] - self._truth.positions[true], axis=1)
        seconds = (stamps - stamps[0]) / 1e9
        current = self._of_keyframes(keyframes_ns, keyframes, start if T_bim_map is None else T_bim_map)
        known = np.isfinite(current)
        if not known.any():
            return seconds, {LIVE: live}
        at = (keyframes_ns[known] - stamps[0]) / 1e9
        return seconds, {LIVE: live, CURRENT: np.interp(seconds, at, current[known])}

    def _of_keyframes(self, stamps: NDArray[np.int64], poses: Floats, T_bim_map: Floats) -> Floats:
        errors = np.full(len(stamps), np.nan)
        ours, true = associate(stamps, self._truth.stamps_ns)
        places = (T_bim_map @ poses[ours][:, :, 3, None])[:, :3, 0]
        errors[ours] = np.linalg.norm(places - self._truth.positions[true], axis=1)
        return errors


def rms(errors: Floats) -> float:
    """The root mean square of the finite values; NaN if there are none."""
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
