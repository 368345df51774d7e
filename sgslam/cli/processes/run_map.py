"""The map of a run in its output folder: it is built from scans that another process tracks."""

import logging
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.plans.bim import IFC_SUFFIXES, Bim
from data.scans.scan import SkippedScan
from matching.matcher import make_ready
from sgslam.anchoring.wall_alignment import planar_pose
from sgslam.cli.job.inputs import RunInputs
from sgslam.cli.job.run import Run
from sgslam.cli.options import Triple
from sgslam.cli.processes.mapping_process import HeldAnchor, MapState
from sgslam.geometry.frames import inverse, level_at, se2_to_se3
from sgslam.result.saving import prepare_folder
from sgslam.tracking import TrackerNotes
from sgslam.types import TrackedScan
from sgslam.warm_up import warm_up

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)


class RunMap:
    """The map of a run whose scans another process reads and tracks."""

    def __init__(self, inputs: RunInputs) -> None:
        """Raises UserError for what is wrong with the inputs."""
        is_live = inputs.options.live
        if is_live:
            warm_up(inputs.config, with_map=True)
        building = inputs.read_building()
        prepare_folder(inputs.out)
        self._scans, self._matcher = inputs.scans, building.matcher
        self._run = Run(inputs, building, tracks=False)
        self._slam = self._run.slam
        threading.Thread(target=_prepare_results, args=(building.bim,), daemon=True).start()
        if is_live and (building.bim is not None or building.prior_map is not None):  # matching is not to stall
            make_ready(building.matcher)
        self._mapped = 0
        self._failed: str | None = None

    def add(self, scan: TrackedScan, notes: TrackerNotes) -> MapState:
        """Adds a tracked scan, with the tracker's notes then; returns the state of the map."""
        if self._failed is None:
            try:
                self._slam.add_tracked(scan, notes)
            except UserError as error:
                self._failed = str(error)  # the map so far is written all the same
        self._mapped += 1
        slam, newest = self._slam, self._slam.newest
        held = [HeldAnchor(f"w{own.wall}", own.a_id, own.state) for own in slam.anchors if own.state != "withdrawn"]
        return MapState(
            scans=self._mapped,
            part=slam.kidnaps,
            T_map_odom=slam.T_map_odom,
            T_bim_map=slam.T_bim_map,
            anchors=tuple(held),
            map_stamp_ns=None if newest is None else newest.stamp_ns,
            keyframes=slam.keyframes,
            failed=self._failed,
            place=slam.place_probabilities,
        )

    def set_start(self, pose: Triple) -> None:
        """Takes a pose of the sensor now for the start of matching; what is anchored stays so."""
        now = self._slam.newest
        self._matcher.start = pose if now is None else map_start(pose, now.T_map_sensor)
        _log.info("the user gives the sensor's pose: x, y, yaw = %.2f, %.2f, %.2f", *pose)

    def log(self, name: str, level: int, text: str) -> None:
        """Adds a line to the log of the run."""
        logging.getLogger(name).log(level, "%s", text)

    def save(self, tracking: bytes, progress: dict[str, Any]) -> None:
        """Writes a checkpoint, with the states of the tracker and of `Progress` after the scans so far."""
        self._run.take_progress(progress)
        self._run.save(tracking)

    def finish(
        self,
        seconds: float = 0.0,
        cpu_seconds: float = 0.0,
        skipped: Sequence[SkippedScan] = (),
        remarks: Sequence[str] = (),
        stopped: str | None = None,
        progress: Mapping[str, Any] | None = None,
        measured: dict[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Completes the map and writes the results, as no scan comes any more, for the reason `stopped` where it is not
        the last one; returns the content of metrics.json, to which `measured` is added. Raises UserError.

        `seconds` are those of tracking, `cpu_seconds` those of all that the other process did.
        """
        self._scans.skipped, self._scans.remarks = list(skipped), list(remarks)
        self._slam.seconds["odometry"] += seconds
        self._run.take_progress(progress or {})
        return self._run.finish(stopped or self._failed, measured, cpu_seconds)


def _prepare_results(bim: Bim | None) -> None:
    """Loads what draws the results, and makes the shapes of an IFC model's elements, while this process waits for
    scans."""
    import matplotlib.backends.backend_agg
    import matplotlib.figure  # noqa: F401

    if bim is not None and bim.path is not None and bim.path.suffix.lower() in IFC_SUFFIXES:
        from data.plans.elements import planned_elements  # loads ifcopenshell

        with suppress(UserError):  # it is raised again when they are needed
            planned_elements(bim.path)


def map_start(pose: Triple, T_map_sensor: Floats) -> Triple:
    """x, y, yaw of the map's origin in the BIM frame, for a sensor at `pose` there and at (4, 4) in the map."""
    x, y, yaw = pose
    yaw, x, y = planar_pose(se2_to_se3(yaw, x, y) @ inverse(level_at(T_map_sensor))).tolist()
    return x, y, yaw
