"""A run as a recording for the Rerun viewer: `--rerun FILE`. Needs the extra `rerun`; the run is not affected."""

import logging
import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.common.errors import UserError
from sgslam.viewer.canvas import Canvas
from sgslam.viewer.scene import RunScene

if TYPE_CHECKING:
    from sgslam.anchoring.anchor_log import AnchorEvent
    from sgslam.slam import SceneGraphSlam
    from sgslam.types import Update

Floats = NDArray[np.float64]
HEALTH = {"lost": 0.0, "degraded": 1.0, "good": 2.0}
_log = logging.getLogger(__name__)


class Recording(Canvas):
    """Logs what a scene draws to a `stream` of the module `rerun`."""

    def __init__(self, rerun: Any, stream: Any) -> None:
        super().__init__()
        self._rr, self._stream = rerun, stream

    def draw(self, kind: str, name: str, *content: Any) -> None:
        rr = self._rr
        if kind == "lines":
            ends, colour, _ = content
            self._stream.log(name, rr.LineStrips3D(ends, colors=colour))
        elif kind == "mesh":
            triangles, colour, opacity = content
            factor = (*colour, round(255 * opacity))
            self._stream.log(name, rr.Mesh3D(vertex_positions=triangles.reshape(-1, 3), albedo_factor=factor))
        elif kind == "points":
            points, colours, size = content
            self._stream.log(name, rr.Points3D(points.astype(np.float32), colors=colours, radii=size / 2))
        elif kind == "label":
            text, place = content
            self._stream.log(name, rr.Points3D([place], labels=[text], radii=0.01))

    def move(self, name: str, T: Floats) -> None:
        self._stream.log(name, self._rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))

    def erase(self, name: str) -> None:
        self._stream.log(name, self._rr.Clear(recursive=False))

    def hide(self, name: str, hidden: bool) -> None:
        """The viewer hides what its user wants."""


class RerunLog:
    """Writes a run to an `.rrd` file. Call `add_scan` after each scan and `close` at the end; an early end keeps
    what was recorded.

    Its timelines are `stamp` and `scan`. It holds what the page of a run shows, the map as of each keyframe, and sensor
    and points of each scan. `/health` is 0 for lost, 1 for degraded, 2 for good scans; `/anchors` has the numbers of
    anchors by their state and the reasons of all changes. If logging fails, the run continues without it.
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
        self._scene = RunScene(Recording(rerun, self._stream))
        self._scene.show_plan(plan)
        self._told: Counter[tuple[str, AnchorEvent]] = Counter()  # by planned surface: walls are renamed when joined

    def add_scan(self, slam: "SceneGraphSlam", update: "Update", points: Floats) -> None:
        """Logs a scan that was added to `slam`: `points` (N, 3), sensor frame."""
        if self._failed:
            return
        with self._guarded():
            self._stream.set_time("stamp", timestamp=np.datetime64(update.stamp_ns, "ns"))
            self._stream.set_time("scan", sequence=self._scans)
            self._scans += 1
            self._scene.show_sensor(update.T_map_sensor, points, update.T_map_sensor)
            if update.health is not None:
                self._stream.log("health", self._rr.Scalars(HEALTH[update.health]))
            if update.keyframes != self._keyframes:
                self._keyframes = update.keyframes
                self._log_map(slam)

    def add_map(self, slam: "SceneGraphSlam") -> None:
        """Logs the map as it is now, such as at the end of the run."""
        if not self._failed:
            with self._guarded():
                self._log_map(slam)

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # a failure to log must not end the run
            self._failed = True
            _log.warning("%s is no longer written: %s: %s", self._path, type(error).__name__, error)

    def _log_map(self, slam: "SceneGraphSlam") -> None:
        now, rr = slam.snapshot(), self._rr
        self._scene.show(now)
        if now.reason:
            self._stream.log("matching", rr.TextLog(now.reason))
        states = [anchor.state for anchor in slam.anchors]
        for state in ("tight", "loose", "withdrawn"):
            self._stream.log(f"anchors/{state}", rr.Scalars(float(states.count(state))))
        known: Counter[tuple[str, AnchorEvent]] = Counter()
        for anchor in slam.anchors:
            for event in anchor.events:
                known[anchor.a_id, event] += 1
                if known[anchor.a_id, event] > self._told[anchor.a_id, event]:
                    text = f"w{anchor.wall} at {anchor.a_id}: {event.state}, {event.why}"
                    self._stream.log("anchors/changes", rr.TextLog(text))
        self._told |= known

    def close(self) -> None:
        """Completes the file. Without a scan there is none."""
        self._stream.flush()
        self._stream.disconnect()
        if not self._scans:
            os.unlink(self._temporary)
            return
        os.chmod(self._temporary, 0o644)
        os.replace(self._temporary, self._path)
