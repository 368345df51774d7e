"""Finished runs in the browser, read from their folders, with playback."""

import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from data import Floor
from data.common.errors import UserError
from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from sgslam.as_built.deviation_bands import band_of
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report import ReportData, RunFolder
from sgslam.report.error_chart import ErrorLine, error_lines
from sgslam.session import Snapshot
from sgslam.session.checkpoints import read_run
from sgslam.viewer.page import Page
from sgslam.viewer.panel import Panel

_STEP_S = 0.1  # between two frames of the playback


class FinishedRun:
    """The data of a run's folder that the page shows. Raises UserError for a folder that is not a run's."""

    def __init__(self, path: Path, truth: Trajectory | None = None) -> None:
        self.path, self.truth, self.folder = path, truth, RunFolder.read(path)
        self.trajectory_map = Trajectory.read_tum(path / "trajectory_map.tum")
        folder, graph = self.folder, self.folder.s_graph
        floors = tuple(graph.on_floor(floor.id) for floor in graph.floors)
        if len(floors) < 2:
            floors = (graph if graph.floors else replace(graph, floors=(Floor("floor-0"),)),)
        ghosts = folder.matches.get("hypotheses") or () if folder.T_bim_map is None else ()
        try:
            clouds = KeyframeClouds.open(path / CLOUDS)
        except UserError:
            clouds = KeyframeClouds()  # a run on a full disk has none
        self.now = Snapshot(
            stamps_ns=np.array([k.stamp_ns for k in graph.keyframes], dtype=np.int64),
            poses=xyzquat_to_poses(np.array([k.pose for k in graph.keyframes], dtype=float).reshape(-1, 7)),
            floors=tuple(k.floor for k in graph.keyframes),
            graphs=floors,
            plan=folder.a_graph,
            T_plan_map=folder.T_bim_map,
            matches=folder.matches,
            hypotheses=tuple((floors[0].floors[0].id, ghost) for ghost in ghosts),
            reason=str(folder.metrics.get("reason") or ""),
            clouds=clouds,
        )

    @property
    def first(self) -> int:
        """The index of the newest run's first keyframe; those of earlier runs come before, perhaps by another clock."""
        stamps, begin = self.now.stamps_ns, int(self.trajectory_map.stamps_ns[0])
        back = np.flatnonzero((np.diff(stamps) <= 0) | (stamps[:-1] < begin))
        return int(back[-1]) + 1 if len(back) else 0

    def bands(self) -> dict[str, str]:
        """The deviation band of each mapped wall surface, by its id."""
        moved = ((d["s_id"], band_of(d["offset_m"])) for d in self.folder.deviations if d["kind"] == "moved")
        return {surface: band for surface, band in moved if surface is not None and band is not None}

    def errors(self) -> list[ErrorLine]:
        """Of the odometry and the trajectory; empty without a truth."""
        odometry, folder = Trajectory.read_tum(self.path / "trajectory_odometry.tum"), self.folder
        truth, T_bim_map = self.truth, folder.T_bim_map
        graphs = folder.a_graph, folder.s_graph
        return error_lines(ReportData(*graphs, self.trajectory_map, odometry, truth, T_bim_map, None, {}, []))


def stored_truth(path: Path) -> Trajectory | None:
    """The ground truth that was given to a run; None if there was none or its file is gone."""
    try:
        file = read_run(path)[0].get("arguments", {}).get("ground_truth")
        return None if file is None else Trajectory.read_tum(file)
    except UserError:
        return None


class FinishedView:
    """Shows runs on a page, one at a time."""

    def __init__(self, page: Page, runs: Sequence[FinishedRun]) -> None:
        self.page, self.runs = page, runs
        self._playing = threading.Event()
        gui = page.server.gui
        names = [f"{k}: {run.path.resolve().name}" for k, run in enumerate(runs, 1)]
        if len(runs) > 1:
            chosen = gui.add_dropdown("run", names, initial_value=names[0])
            chosen.on_update(lambda _: self.show(runs[names.index(chosen.value)]))
        self.panel = Panel(page)
        self.scene = self.panel.scene
        with gui.add_folder("time"):
            self.slider = gui.add_slider("seconds", 0.0, 1.0, 0.1, 0.0)
            self._play = gui.add_button("play")
            self._speed = gui.add_dropdown("speed", ("1x", "4x", "16x", "64x"), initial_value="4x")
        self.slider.on_update(lambda _: self.go_to(float(self.slider.value)))
        self._play.on_click(lambda _: self._press())
        self.show(runs[0])

    def show(self, run: FinishedRun) -> None:
        """Shows a run, at its end."""
        self._playing.clear()
        anchored, walls = run.folder.T_bim_map is not None, run.folder.deviations
        with self.page.atomic():
            self.run = run
            self.scene.clear()
            self.scene.bands = run.bands()
            self.scene.show_plan(run.now.plan, run.truth if anchored else None)
            self.scene.show(run.now)
            facts = [f"{sum(bool(d['significant']) for d in walls)} walls deviate from the plan"] if anchored else []
            facts += [line.summary() for line in run.errors()]
            self.panel.show(run.now, "Anchored" if anchored else "Not anchored", len(run.trajectory_map), facts)
            end = float(np.ptp(run.trajectory_map.stamps_ns)) / 1e9
            self.slider.max, self.slider.step = max(end, 0.1), max(end / 2000, 0.01)
            self.slider.value = end
            self.go_to(end)
            self.panel.set_camera(run.now)

    def go_to(self, seconds: float) -> None:
        """Shows the sensor and the map at that time."""
        run, trajectory = self.run, self.run.trajectory_map
        stamp = trajectory.stamps_ns[0] + round(1e9 * seconds)
        scan = max(int(np.searchsorted(trajectory.stamps_ns, stamp, side="right")) - 1, 0)
        keyframe = run.first + max(int(np.searchsorted(run.now.stamps_ns[run.first :], stamp, side="right")) - 1, 0)
        with self.page.atomic():
            self.scene.show_sensor(trajectory.poses[scan], run.now.clouds[keyframe], run.now.poses[keyframe])
            self.scene.draw_path(run.now, keyframe)
            self.scene.scans.up_to(keyframe)

    def _press(self) -> None:
        if self._playing.is_set():
            self._playing.clear()
            return
        self._playing.set()
        self._play.label = "pause"
        if self.slider.value >= self.slider.max:
            self.slider.value = 0.0
        while self._playing.is_set() and self.slider.value < self.slider.max:  # in a thread of viser's
            time.sleep(_STEP_S)
            speed = float(self._speed.value.removesuffix("x"))
            self.slider.value = min(self.slider.value + _STEP_S * speed, self.slider.max)
        self._playing.clear()
        self._play.label = "play"
