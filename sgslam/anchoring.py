"""When the S-graph is matched, and what of a match becomes an anchor."""

import logging
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import factors
from data import SceneGraph, WallSurface
from sgslam.backend import Anchors, PlannedWall
from sgslam.config import Config
from sgslam.frames import inverse, se2_to_se3, transform_points
from sgslam.scene import Scene
from sgslam.wall_map import WallMap

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)


class Match(Protocol):
    """What a matcher answers; `matching.MatchResult` is one."""

    @property
    def status(self) -> str:
        """`unique`, `ambiguous` or `none`."""
        ...

    @property
    def reason(self) -> str:
        """One line for the user."""
        ...

    @property
    def wall_surfaces(self) -> tuple[tuple[str, str, float], ...]:
        """(S id, A id, confidence) of the first hypothesis."""
        ...

    @property
    def T_a_s(self) -> tuple[float, float, float] | None:  # noqa: N802
        """(yaw, x, y) of the first hypothesis."""
        ...

    @property
    def floor(self) -> str | None:
        """The storey of the first hypothesis."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """The form of matches.json."""
        ...


class AnyMatcher(Protocol):
    """Any object that finds an S-graph in an A-graph."""

    def match(self, s: SceneGraph, a: SceneGraph) -> Match:
        """Returns rooms and wall surfaces that correspond, or says that none or several answers fit."""
        ...


@dataclass(frozen=True)
class _Growth:
    """What of the S-graph can change the answer."""

    rooms: int = 0
    length: float = 0.0

    @staticmethod
    def of(graph: SceneGraph) -> "_Growth":
        return _Growth(len(graph.rooms), sum(w.length or 0.0 for w in graph.wall_surfaces))

    def enough_since(self, last: "_Growth") -> bool:
        return self.rooms > last.rooms or self.length > 1.1 * last.length


class Anchoring:
    """Keeps the answer of the matcher, and turns a unique one into anchors.

    `a_graph` in the BIM frame; inside, a frame near the building is used (the BIM's, moved by `origin`), because a
    site may lie kilometres from zero.
    """

    def __init__(self, a_graph: SceneGraph, matcher: AnyMatcher, config: Config) -> None:
        self._a, self._matcher, self._config = a_graph, matcher, config
        self.origin = np.array([*a_graph.centroid(), 0.0])
        self.match: Match | None = None  # the newest answer
        self.committed: Match | None = None  # the answer that the anchors stand on
        self._pairs: set[tuple[int, str]] = set()  # committed: wall, A surface
        self._matched: Scene | None = None  # what the newest answer is about
        self._tried = _Growth()

    def update(self, scene: Scene, walls: WallMap, T_map_local: Floats | None, last: bool) -> Anchors | None:
        """Matches if the S-graph has grown enough (or it is the `last` time); returns the anchors that hold now.

        `T_map_local` is the back end's estimate of the BIM's local frame where there is one. A new answer replaces a
        committed one only where it is unique and says the same.
        """
        self._pairs = {(walls.current(wall), a_id) for wall, a_id in self._pairs}
        growth = _Growth.of(scene.graph)
        if last or growth.enough_since(self._tried):
            self._tried = growth
            self._try(scene, walls, T_map_local)
        if self.committed is None:
            return None
        return self._anchors(scene, walls, T_map_local)

    def confirm(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> bool:
        """Whether the matcher, with the whole building open to it, says of `scene` what was committed to.

        Where it does not, the commitment is withdrawn. True where there was none.
        """
        committed, self.committed = self.committed, None
        self._try(scene, walls, T_map_local)
        if committed is None or self.committed is not None:
            return True
        self._pairs = set()
        assert self.match is not None
        _log.warning("the match that the anchors stood on is withdrawn: %s", self.match.reason)
        return False

    def _try(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> None:
        T_level_map = walls.T_level_map
        fixed = self.committed.floor if self.committed is not None else None
        candidates = self._a if fixed is None else self._a.on_floor(fixed)
        self.match = self._matcher.match(scene.graph, candidates)
        self._matched = scene
        if self.match.status == "unique" and self._agrees(self.match, T_level_map, T_map_local):
            self.committed = self.match
            self._pairs = {(scene.wall_of_surface[s], a) for s, a, _ in self.match.wall_surfaces}
        _log.info("matching %d rooms: %s, %s", len(scene.graph.rooms), self.match.status, self.match.reason)

    def bim_from_map(self, T_map_local: Floats) -> Floats:
        """(4, 4) the map in the BIM frame, from the back end's estimate."""
        T = inverse(T_map_local)
        T[:3, 3] += self.origin
        return T

    def _elevation(self, floor: str | None) -> float | None:
        return next((f.elevation for f in self._a.floors if f.id == floor), None)

    def _place(self, match: Match, T_level_map: Floats) -> Floats:
        assert match.T_a_s is not None  # a unique answer has a motion
        yaw, x, y = match.T_a_s
        T_local_level = se2_to_se3(yaw, x, y, self._elevation(match.floor) or 0.0)
        T_local_level[:3, 3] -= self.origin
        return inverse(T_local_level @ T_level_map)

    def _agrees(self, match: Match, T_level_map: Floats, T_map_local: Floats | None) -> bool:
        if T_map_local is None:
            return True
        step = inverse(self._place(match, T_level_map)) @ T_map_local
        turn = np.arccos(np.clip((np.trace(step[:3, :3]) - 1) / 2, -1.0, 1.0))
        return bool(np.linalg.norm(step[:2, 3]) < 1.0 and turn < np.radians(5))

    def answer(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> dict[str, Any] | None:
        """The answer in the form of matches.json, by the ids of `scene`: the committed one where there is one."""
        if self.committed is None or (self.committed is self.match and self._matched is scene):
            return None if self.match is None else self.match.to_dict()
        held = self._held(scene, walls, T_map_local)
        confidence = min((c for _, _, c in self.committed.wall_surfaces), default=0.0)
        rooms = {(s.room, a.room) for s, a in held if s.room is not None and a.room is not None}
        return {
            **self.committed.to_dict(),
            "rooms": [[s, a, confidence] for s, a in sorted(rooms)],
            "wall_surfaces": [[s.id, a.id, confidence] for s, a in held],
        }

    def _held(
        self, scene: Scene, walls: WallMap, T_map_local: Floats | None
    ) -> list[tuple[WallSurface, WallSurface]]:
        """The committed pairs that hold still, by the surfaces of `scene`."""
        assert self.committed is not None
        if T_map_local is None:
            T_map_local = self._place(self.committed, walls.T_level_map)
        a_ids: dict[int, list[str]] = {}
        for wall, a_id in sorted(self._pairs):
            a_ids.setdefault(wall, []).append(a_id)
        return [
            (surface, self._a.surface_by_id[a_id])
            for surface in scene.graph.wall_surfaces
            for a_id in a_ids.get(scene.wall_of_surface[surface.id], ())
            if self._holds(surface, self._a.surface_by_id[a_id], walls.T_level_map, T_map_local)
        ]

    def _anchors(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> Anchors:
        assert self.committed is not None
        if T_map_local is None:
            T_map_local = self._place(self.committed, walls.T_level_map)
        T_local_level = inverse(walls.T_level_map @ T_map_local)
        planes: dict[int, dict[str, PlannedWall]] = {}
        by_rooms: dict[tuple[str, str], dict[int, Floats]] = {}
        for surface, planned in self._held(scene, walls, T_map_local):
            wall = scene.wall_of_surface[surface.id]
            plane = self._local_plane(planned)
            middle = np.array([*surface.centroid, np.mean(surface.height or 0.0)])
            planes.setdefault(wall, {})[planned.id] = PlannedWall(plane, transform_points(T_local_level, middle))
            if surface.room is not None and planned.room is not None:
                by_rooms.setdefault((surface.room, planned.room), {})[wall] = plane
        elevation, settings = self._elevation(self.committed.floor), self._config.anchors
        rooms = _room_anchors(scene, by_rooms, elevation or 0.0) if settings.rooms else {}
        walls_anchored = {wall: list(p.values()) for wall, p in planes.items()} if settings.planes else {}
        return Anchors(T_map_local, walls_anchored, rooms, elevation)

    def _holds(self, seen: WallSurface, planned: WallSurface, T_level_map: Floats, T_map_local: Floats) -> bool:
        """Whether a seen surface lies at a planned one, within the gates and beside it."""
        settings = self._config.anchors
        T_local_level = inverse(T_level_map @ T_map_local)
        ends = np.array([[*end, 0.0] for end in seen.ends()])
        placed = transform_points(T_local_level, ends)[:, :2] + self.origin[:2]
        normal = np.array(planned.normal)
        tangent = np.array([-normal[1], normal[0]])
        off = float(abs((placed.mean(axis=0) - planned.centroid) @ normal))
        turn = float((T_local_level[:2, :2] @ seen.normal) @ normal)
        along = np.sort((placed - planned.centroid) @ tangent)
        beside = planned.length is None or (along[0] < planned.length / 2 and along[1] > -planned.length / 2)
        return off < settings.gate_offset and turn > np.cos(settings.gate_angle) and beside

    def _local_plane(self, surface: WallSurface) -> Floats:
        plane = np.array(surface.plane or factors.plane_from_wall(surface.normal, surface.centroid), dtype=float)
        plane[:3] /= np.linalg.norm(plane[:3])
        plane[3] += plane[:3] @ self.origin
        return plane


def _room_anchors(
    scene: Scene, by_rooms: dict[tuple[str, str], dict[int, Floats]], elevation: float
) -> dict[int, Floats]:
    """T_bim_room (4, 4) of each room that has two matched walls of two directions in one planned room."""
    anchors = {}
    for node in scene.rooms:
        choices = [walls for (s_room, _), walls in by_rooms.items() if s_room == scene.room_ids[node.id]]
        if not choices:
            continue
        walls = max(choices, key=len)
        fitted = factors.fit_room(list(walls.values()), [node.walls[wall] for wall in walls])
        if fitted is not None:
            fitted[2, 3] = elevation
            anchors[node.id] = fitted
    return anchors
