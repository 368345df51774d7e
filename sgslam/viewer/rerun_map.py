"""Map and plan of a run as entities of a Rerun recording."""

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.report.plan_png import BIM, MATCHED, PATHS, UNMATCHED
from sgslam.session import Snapshot
from sgslam.viewer.scene import rgb
from sgslam.viewer.shapes import elevation_of, merge_meshes, quad_mesh, ring_lines, wall_quads

if TYPE_CHECKING:
    from sgslam.anchoring import AnchorRecord
    from sgslam.anchoring.anchor_log import AnchorEvent
    from sgslam.slam import SceneGraphSlam

Floats = NDArray[np.float64]
_OPACITY = 90  # of walls, out of 255


class RerunMap:
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
        rr, now = self._rr, slam.snapshot()
        if now.plan is None:  # without a plan, rooms are segmented only at the end
            current = slam.s_graph()
            now = replace(now, graphs=tuple(current.on_floor(floor.id) for floor in current.floors))
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
