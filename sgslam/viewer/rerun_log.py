"""A run as a recording for the Rerun viewer: `--rerun FILE`. Needs the extra `rerun`; the run is not affected."""

import logging
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.common.errors import UserError
from sgslam.report.plan_png import BIM, MATCHED, PATHS, UNMATCHED
from sgslam.session import Snapshot
from sgslam.viewer.scene import SCAN_POINTS, rgb, with_rooms
from sgslam.viewer.shapes import elevation_of, merge_meshes, quad_mesh, ring_lines, wall_quads

if TYPE_CHECKING:
    from sgslam.anchoring import AnchorRecord
    from sgslam.anchoring.anchor_log import AnchorEvent
    from sgslam.slam import SceneGraphSlam
    from sgslam.types import Update

Floats = NDArray[np.float64]
_OPACITY = 90  # of walls, out of 255
HEALTH = {"lost": 0.0, "degraded": 1.0, "good": 2.0}
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
        self._map = _Map(rerun, self._stream, plan)

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


class _Map:
    """Logs map, anchors and plan to a recording `stream` with the module `rerun`.

    Positions are relative to the plan's centre, since drawing is in single precision.
    """

    def __init__(self, rerun: Any, stream: Any, plan: SceneGraph | None) -> None:
        """Logs the plan."""
        self._rr, self._stream = rerun, stream
        self._origin = np.zeros(3) if plan is None else _origin(plan)
        self._told: Counter[tuple[str, AnchorEvent]] = Counter()  # by planned surface: walls are renamed when joined
        if plan is not None:
            self._log_plan(plan)

    def log(self, slam: "SceneGraphSlam") -> None:
        """Logs the map as it is now."""
        rr, now = self._rr, with_rooms(slam)
        T = np.eye(4) if now.T_plan_map is None else now.T_plan_map.copy()
        if now.T_plan_map is not None:
            T[:3, 3] -= self._origin
        self._stream.log("map", rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))
        path = rr.LineStrips3D([now.poses[:, :3, 3]], colors=rgb(PATHS["trajectory"]["color"]))
        self._stream.log("map/trajectory", path)
        self._log_surfaces(now)
        if now.reason:
            self._stream.log("matching", rr.TextLog(now.reason))
        self._log_anchors(slam.anchors)

    def _log_surfaces(self, now: Snapshot) -> None:
        pairs, rings = now.pairs("wall_surfaces"), []
        for name, colour, is_matched in (("matched", MATCHED, True), ("unmatched", UNMATCHED, False)):
            quads = [
                wall_quads([w for w in graph.wall_surfaces if (w.id in pairs) is is_matched], z, absolute=False)
                for graph, z in _floors(now)
            ]
            self._log_quads(f"map/walls/{name}", quads, colour)
        for graph, z in _floors(now):
            rings.append(ring_lines([room.polygon for room in graph.rooms if room.polygon], z))
        self._log_lines("map/rooms", rings, MATCHED)

    def _log_anchors(self, anchors: "tuple[AnchorRecord, ...]") -> None:
        states = [anchor.state for anchor in anchors]
        for state in ("tight", "loose", "withdrawn"):
            self._stream.log(f"anchors/{state}", self._rr.Scalars(float(states.count(state))))
        known: Counter[tuple[str, AnchorEvent]] = Counter()
        for anchor in anchors:
            for event in anchor.events:
                known[anchor.a_id, event] += 1
                if known[anchor.a_id, event] > self._told[anchor.a_id, event]:
                    text = f"w{anchor.wall} at {anchor.a_id}: {event.state}, {event.why}"
                    self._stream.log("anchors/changes", self._rr.TextLog(text))
        self._told |= known

    def _log_plan(self, plan: SceneGraph) -> None:
        quads = [wall_quads([w], elevation_of(plan, w.floor), absolute=True) - self._origin for w in plan.wall_surfaces]
        self._log_quads("plan/walls", quads, BIM, static=True)
        rings = [ring_lines([r.polygon], elevation_of(plan, r.floor)) - self._origin for r in plan.rooms if r.polygon]
        self._log_lines("plan/rooms", rings, BIM, static=True)

    def _log_quads(self, name: str, quads: list[Floats], colour: str, static: bool = False) -> None:
        vertices, triangles = merge_meshes([quad_mesh(corners) for corners in quads])
        mesh = self._rr.Mesh3D(
            vertex_positions=vertices, triangle_indices=triangles, albedo_factor=(*rgb(colour), _OPACITY)
        )
        self._stream.log(name, mesh, static=static)

    def _log_lines(self, name: str, ends: list[Floats], colour: str, static: bool = False) -> None:
        lines = np.concatenate([np.empty((0, 2, 3)), *ends])
        self._stream.log(name, self._rr.LineStrips3D(lines, colors=rgb(colour)), static=static)


def _origin(plan: SceneGraph) -> Floats:
    low = min((floor.elevation for floor in plan.floors if floor.elevation is not None), default=0.0)
    return np.array([*np.round(plan.centroid()), low])


def _floors(now: Snapshot) -> list[tuple[SceneGraph, float]]:
    """The floors of the map, each with the z of its ground."""
    return [(graph, graph.floors[0].elevation or 0.0) for graph in now.graphs]
