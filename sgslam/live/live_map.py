"""The map of a live run: it is built from tracked scans, without the scans' files."""

import logging
from argparse import Namespace
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.scans import Scan, ScanSource
from data.scans.scan import SkippedScan
from sgslam.live.answer import HeldAnchor
from sgslam.live.messages import FinishMessage, LiveInputs, MapState, Pose2, TrackedMessage
from sgslam.live.warm_up import warm_up
from sgslam.slam import SceneGraphSlam

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)


class _ComeAndGone(ScanSource):
    """Stands for scans that cannot be read a second time."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path

    def __len__(self) -> int:
        return 0

    def _jobs(self) -> Iterator[Callable[[], Scan]]:
        return iter(())

    def take_report(self, skipped: tuple[SkippedScan, ...], remarks: tuple[str, ...]) -> None:
        """What the process that read them says of them."""
        self.skipped, self.remarks = list(skipped), list(remarks)


class LiveMap:
    """The map of a live run in its output folder."""

    def __init__(self, inputs: LiveInputs) -> None:
        from sgslam.cli.job.arguments import out_folder
        from sgslam.cli.job.inputs import read_job
        from sgslam.cli.job.run import Run  # loads all that a run needs

        warm_up(inputs.config, with_map=True)
        options = _options(inputs)
        out = out_folder(options)
        self._scans = _ComeAndGone(out)
        job = read_job(options, self._scans, inputs.config)
        self._run, self._matcher = Run(job, out), job.matcher
        self._mapped = 0
        self._anchors: tuple[HeldAnchor, ...] = ()
        _log.info("live: the scans come from another process, tracked")

    @property
    def _slam(self) -> SceneGraphSlam:
        return self._run.slam

    def add(self, message: TrackedMessage) -> MapState:
        """Adds a scan; returns the state of the map."""
        self._slam.add_tracked(message.scan, message.notes)
        self._mapped += 1
        slam, anchors = self._slam, _held(self._slam)
        changed = anchors != self._anchors
        self._anchors = anchors
        return MapState(
            self._mapped, slam.kidnaps, slam.T_map_odom, slam.T_bim_map, anchors if changed else None,
            slam.newest_mapped_ns, slam.keyframes,
        )  # fmt: skip

    def set_start(self, pose: Pose2) -> None:
        """Takes a pose of the sensor now for the start of matching; what is anchored stays so."""
        now = self._slam.T_map_sensor
        self._matcher.start = pose if now is None else map_start(pose, now)
        _log.info("the user gives the sensor's pose: x, y, yaw = %.2f, %.2f, %.2f", *pose)

    def finish(self, told: FinishMessage) -> dict[str, Any]:
        """Completes the map and writes the results. Raises UserError."""
        self._scans.take_report(told.skipped, told.remarks)
        self._slam.seconds["odometry"] = told.seconds
        return self._run.finish(None, told.measured)


def map_start(pose: Pose2, T_map_sensor: Floats) -> Pose2:
    """x, y, yaw of the map's origin in the BIM frame, for a sensor at `pose` there and at (4, 4) in the map."""
    x, y, yaw = pose
    turned = yaw - float(np.arctan2(T_map_sensor[1, 0], T_map_sensor[0, 0]))
    c, s = np.cos(turned), np.sin(turned)
    along, across = T_map_sensor[:2, 3]
    return x - float(c * along - s * across), y - float(s * along + c * across), turned


def _held(slam: SceneGraphSlam) -> tuple[HeldAnchor, ...]:
    return tuple(
        HeldAnchor(f"w{record.wall}", record.a_id, record.state)
        for record in slam.anchors
        if record.state != "withdrawn"
    )


def _options(inputs: LiveInputs) -> Namespace:
    """As options of a run."""
    from sgslam.run import default_options

    options = default_options()
    options.out, options.bim, options.layer, options.map = inputs.out, inputs.bim, list(inputs.layers), inputs.map
    options.single_pass = True  # the scans are gone
    options.storey, options.ground_truth, options.verbose = inputs.storey, inputs.ground_truth, inputs.verbose
    options.start = None if inputs.start is None else ",".join(map(repr, inputs.start))
    return options
