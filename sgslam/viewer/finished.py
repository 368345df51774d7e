"""Finished runs in the browser, read from their folders, with playback."""

import dataclasses
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data import Floor, SceneGraph
from data.common.errors import UserError
from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from sgslam.as_built.deviation_bands import band_of
from sgslam.geometry.frames import inverse
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report import ReportData, RunFolder
from sgslam.report.error_chart import error_lines
from sgslam.report.number_formats import metres
from sgslam.session import Snapshot
from sgslam.session.checkpoints import about_run
from sgslam.viewer.page import Page
from sgslam.viewer.panel import Panel
from sgslam.viewer.scene import SCAN_POINTS, RunScene, rgb
from sgslam.viewer.shapes import path_lines

Floats = NDArray[np.float64]
STEP_S = 0.1  # between two frames of the playback
SPEEDS = ("1x", "4x", "16x", "64x")
MOST_STEPS = 2000  # of the time slider
EARLIER, RED = rgb("#a78bfa"), rgb("#d64045")


class FinishedRun:
    """The data of a run's folder that the page shows. Raises UserError for a folder that is not a run's."""

    def __init__(self, path: Path, truth: Trajectory | None = None) -> None:
        self.path, self.truth, self.folder = path, truth, RunFolder.read(path)
        self.trajectory_map = Trajectory.read_tum(path / "trajectory_map.tum")
        folder, graph = self.folder, self.folder.s_graph
        keyframes = sorted(graph.keyframes, key=lambda k: _number(k.id, path))
        known = [_number(k.id, path) for k in keyframes] == [*range(len(keyframes))]
        anchored = folder.T_bim_map is not None
        floors = _by_floor(graph)
        places = () if anchored else tuple((floors[0].floors[0].id, h) for h in folder.matches.get("hypotheses") or ())
        poses = xyzquat_to_poses(np.array([k.pose for k in keyframes], dtype=float).reshape(-1, 7))
        self.now = Snapshot(
            np.array([k.stamp_ns for k in keyframes], dtype=np.int64), poses, tuple(k.floor for k in keyframes),
            floors, folder.a_graph, folder.T_bim_map,
            folder.matches, places, str(folder.metrics.get("reason") or ""),
            _clouds(path) if known else KeyframeClouds(),
        )  # fmt: skip

    @property
    def first(self) -> int:
        """The index of the newest run's first keyframe; those of earlier runs come before, perhaps by another clock."""
        stamps, begin = self.now.stamps_ns, int(self.trajectory_map.stamps_ns[0])
        back = np.flatnonzero((np.diff(stamps) <= 0) | (stamps[:-1] < begin))
        return int(back[-1]) + 1 if len(back) else 0

    @property
    def earlier(self) -> list[Trajectory]:
        """The trajectories of the runs in the prior map, map frame."""
        T_map_frame = np.eye(4) if self.folder.T_bim_map is None else inverse(self.folder.T_bim_map)
        count = int(self.folder.metrics.get("runs") or 1) - 1
        paths = (self.path / f"trajectory_run{number}.tum" for number in range(1, count + 1))
        return [Trajectory.read_tum(path).transformed(T_map_frame) for path in paths if path.is_file()]

    def bands(self) -> dict[str, str]:
        """The deviation band of each mapped wall surface, by its id."""
        moved = ((d["s_id"], band_of(d["offset_m"])) for d in self.folder.deviations if d["kind"] == "moved")
        return {surface: band for surface, band in moved if surface is not None and band is not None}

    def facts(self) -> list[str]:
        """The lines of the panel."""
        m, accuracy = self.folder.metrics, self.folder.metrics.get("accuracy") or {}
        facts = [self.now.reason, f"{m['scans']} scans, {m['keyframes']} keyframes"]
        facts.append(f"{m['rooms']} rooms, {m['wall_surfaces']} wall surfaces")
        if self.folder.T_bim_map is not None:
            facts.append(f"{sum(bool(d['significant']) for d in self.folder.deviations)} walls deviate from the plan")
        if accuracy.get("rmse_bim_m") is not None:
            facts.append(f"RMSE in the BIM frame: {metres(accuracy['rmse_bim_m'])}")
        return facts

    def errors(self) -> tuple[Floats, dict[str, Floats]]:
        """Seconds (N,) since the first scan, and position errors (N,) of trajectory and odometry; empty without a
        truth."""
        odometry = Trajectory.read_tum(self.path / "trajectory_odometry.tum")
        folder = self.folder
        lines = error_lines(ReportData(
            folder.a_graph, folder.s_graph, self.trajectory_map, odometry, self.truth, folder.T_bim_map, None, {}, []
        ))  # fmt: skip
        if not lines:
            return np.empty(0), {}
        seconds = lines[-1].seconds
        return seconds, {line.name: np.interp(seconds, line.seconds, line.errors) for line in lines}


def stored_truth(path: Path) -> Trajectory | None:
    """The ground truth that was given to a run; None if there was none or its file is gone."""
    try:
        file = about_run(path).get("arguments", {}).get("ground_truth")
        return None if file is None else Trajectory.read_tum(file)
    except UserError:
        return None


def _by_floor(graph: SceneGraph) -> tuple[SceneGraph, ...]:
    if len(graph.floors) > 1:
        return tuple(graph.on_floor(floor.id) for floor in graph.floors)
    return (graph if graph.floors else dataclasses.replace(graph, floors=(Floor("floor-0"),)),)


def _number(keyframe: str, path: Path) -> int:
    try:
        return int(keyframe.removeprefix("k"))
    except ValueError:
        raise UserError(f"{path / 's_graph.json'}: keyframe '{keyframe}' is not k<number>; run it again") from None


def _clouds(path: Path) -> KeyframeClouds:
    try:
        return KeyframeClouds.open(path / CLOUDS)
    except UserError:
        return KeyframeClouds()  # a run on a full disk has none


class FinishedView:
    """Shows runs on a page, one at a time."""

    def __init__(self, page: Page, runs: Sequence[FinishedRun]) -> None:
        self.page, self.runs = page, runs
        self.scene = RunScene(page)
        self._playing = threading.Event()
        gui = page.server.gui
        names = [f"{k}: {run.path.resolve().name}" for k, run in enumerate(runs, 1)]
        if len(runs) > 1:
            chosen = gui.add_dropdown("run", names, initial_value=names[0])
            chosen.on_update(lambda _: self.show(runs[names.index(chosen.value)]))
        self.panel = Panel(page, self.scene)
        with gui.add_folder("time"):
            self.slider = gui.add_slider("seconds", 0.0, 1.0, 0.1, 0.0)
            self._play = gui.add_button("play")
            self._speed = gui.add_dropdown("speed", SPEEDS, initial_value=SPEEDS[1])
        self.slider.on_update(lambda _: self._go())
        self._play.on_click(lambda _: self._press())
        self.show(runs[0])

    def show(self, run: FinishedRun) -> None:
        """Shows a run, at its end."""
        self._playing.clear()
        with self.page.atomic():
            self.run = run
            self.scene.clear()
            self.scene.bands = run.bands()
            self.scene.show_plan(run.now.plan, run.truth if run.folder.T_bim_map is not None else None)
            self.scene.show(run.now)
            for number, earlier in enumerate(run.earlier, 1):
                self.page.lines(f"/map/earlier/run{number}", path_lines(earlier.positions), EARLIER, 2.0)
            anchored = run.folder.T_bim_map is not None
            self.panel.show_status(run.now, "Anchored" if anchored else "Not anchored", run.facts())
            self.panel.draw_errors(*run.errors())
            end = self._seconds(len(run.trajectory_map) - 1)
            self.slider.max, self.slider.step = max(end, 0.1), max(end / MOST_STEPS, 0.01)
            self.slider.value = end
            self.go_to(end)
            self.scene.set_camera(run.now)

    def _seconds(self, scan: int) -> float:
        stamps = self.run.trajectory_map.stamps_ns
        return float(stamps[scan] - stamps[0]) / 1e9

    def go_to(self, seconds: float) -> None:
        """Shows the sensor and the map at that time."""
        run, trajectory = self.run, self.run.trajectory_map
        stamp = trajectory.stamps_ns[0] + round(1e9 * seconds)
        scan = max(int(np.searchsorted(trajectory.stamps_ns, stamp, side="right")) - 1, 0)
        keyframe = run.first + max(int(np.searchsorted(run.now.stamps_ns[run.first :], stamp, side="right")) - 1, 0)
        with self.page.atomic():
            self.page.frame("/map/sensor", trajectory.poses[scan], axes=0.6)
            self.scene.draw_path(run.now, keyframe)
            self.scene.scans.up_to(keyframe)
            points = run.now.clouds[keyframe]
            self.page.points("/map/scan", points[:: 1 + len(points) // SCAN_POINTS], RED, run.now.poses[keyframe], 0.03)

    def _go(self) -> None:
        self.go_to(float(self.slider.value))

    def _press(self) -> None:
        if self._playing.is_set():
            self._playing.clear()
            return
        self._playing.set()
        self._play.label = "pause"
        if self.slider.value >= self.slider.max:
            self.slider.value = 0.0
        while self._playing.is_set() and self.slider.value < self.slider.max:  # in a thread of viser's
            time.sleep(STEP_S)
            speed = float(self._speed.value.removesuffix("x"))
            self.slider.value = min(self.slider.value + STEP_S * speed, self.slider.max)
        self._playing.clear()
        self._play.label = "play"
