"""A run as a recording for the Rerun viewer: `--rerun FILE`. Needs the extra `rerun`; the run is not affected."""

import logging
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.common.errors import UserError
from sgslam.viewer.rerun_map import RerunMap

if TYPE_CHECKING:
    from sgslam.session import Update
    from sgslam.slam import SceneGraphSlam

Floats = NDArray[np.float64]
HEALTH = {"lost": 0.0, "degraded": 1.0, "good": 2.0}
SCAN_POINTS = 4000  # of each scan, about
_log = logging.getLogger(__name__)


@contextmanager
def recorded(path: Path | None, plan: SceneGraph | None) -> "Iterator[RerunLog | None]":
    """Context in which a run is recorded, unless `path` is None; an early end keeps what was recorded. Raises UserError
    as `RerunLog` does."""
    log = None if path is None else RerunLog(path, plan)
    try:
        yield log
    finally:
        if log is not None:
            log.close()


class RerunLog:
    """Writes a run to an `.rrd` file. Call `add_scan` after each scan and `close` at the end.

    Its timelines are `stamp` and `scan`. `/map` lies at its place in `/plan`, once that is known, and holds the walls,
    rooms and keyframes at each keyframe, and sensor and points at each scan. `/health` is 0 for lost, 1 for degraded, 2
    for good scans; `/anchors` has the numbers of anchors by their state and the reasons of all changes. Positions are
    relative to the plan's centre, since drawing is in single precision. If logging fails, the run continues without it.
    """

    def __init__(self, path: Path, plan: SceneGraph | None = None) -> None:
        """Begins the recording. The file appears when it is complete. Raises UserError if rerun is missing or the
        folder cannot be written to."""
        try:
            import rerun
        except ImportError:
            raise UserError("--rerun: rerun is not installed; pip install 'sgslam[rerun]'") from None
        self._path, self._rr = path, rerun
        try:
            handle, self._temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        except OSError as error:
            raise UserError(f"--rerun {path}: cannot be written ({error.strerror}); give another file") from None
        os.close(handle)
        self._stream: Any = rerun.RecordingStream("sgslam")
        self._stream.save(self._temporary)
        self._scans, self._keyframes, self._failed = 0, -1, False
        self._map = RerunMap(rerun, self._stream, plan)

    def add_scan(self, slam: "SceneGraphSlam", update: "Update", points: Floats) -> None:
        """Logs a scan that was added to `slam`: `points` (N, 3), sensor frame."""
        self._attempt(lambda: self._log_scan(slam, update, points))

    def add_map(self, slam: "SceneGraphSlam") -> None:
        """Logs the map as it is now, such as at the end of the run."""
        self._attempt(lambda: self._map.log(slam))

    def close(self) -> None:
        """Completes the file. Without a scan there is none."""
        self._stream.flush()
        self._stream.disconnect()
        if not self._scans:
            os.unlink(self._temporary)
            return
        os.chmod(self._temporary, 0o644)
        os.replace(self._temporary, self._path)

    def _attempt(self, log: Callable[[], None]) -> None:
        if self._failed:
            return
        try:
            log()
        except Exception as error:  # a failure to log must not end the run
            self._failed = True
            _log.warning("%s is no longer written: %s: %s", self._path, type(error).__name__, error)

    def _log_scan(self, slam: "SceneGraphSlam", update: "Update", points: Floats) -> None:
        rr, stream = self._rr, self._stream
        stream.set_time("stamp", timestamp=np.datetime64(update.stamp_ns, "ns"))
        stream.set_time("scan", sequence=self._scans)
        self._scans += 1
        T = update.T_map_sensor
        stream.log("map/sensor", rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))
        some = points[:: max(1, len(points) // SCAN_POINTS)]
        stream.log("map/sensor/scan", rr.Points3D(some.astype(np.float32), radii=0.02))
        if update.health is not None:
            stream.log("health", rr.Scalars(HEALTH[update.health]))
        if update.keyframes != self._keyframes:
            self._keyframes = update.keyframes
            self._map.log(slam)
