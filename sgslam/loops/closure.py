"""Loop closure: revisited places are proposed, searched, registered, and checked for consistency.

A false closure damages the map, a missed one does not: in doubt none is made. A closure must lie within the possible
drift (`candidates`). No other place may fit nearly as well (`search`). The scans of both passes must overlap and
constrain all directions (`registration`), and neither pass may see through the other's walls. For large corrections,
several closures must agree (pairwise consistency; Mangelson et al., ICRA 2018).
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sgslam.config.loop_settings import LoopSettings
from sgslam.geometry.frames import inverse, se2_to_se3, transform_points
from sgslam.loops.candidates import Pass, Ties, passes_near, tied_by_walls, way_driven
from sgslam.loops.likeness import Widths, similar, similar_rooms
from sgslam.loops.registration import Submap, register
from sgslam.loops.search import SeenSpace, agreement, search
from sgslam.mapping import Closure, KeyframeNode, Scene, WallMap

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
Similar = Mapping[str, Index]  # similar keyframes, by the criterion
_log = logging.getLogger(__name__)
_PASSES = 3  # earlier passes that are tried for a keyframe
_CLOUDS = 10  # keyframes of a registered submap at most


class Clouds(Protocol):
    """Points (N, 3) of keyframes by number, each in its sensor frame."""

    def __getitem__(self, keyframe: int) -> NDArray[np.float32]: ...


@dataclass(frozen=True)
class _Map:
    """The present map: poses (K, 4, 4) of all keyframes in the levelled map, places (K, 2), way driven (K,), and
    whether each is on the present floor (K,)."""

    keyframes: list[KeyframeNode]
    clouds: Clouds
    T_level_sensor: Floats
    places: Floats
    way: Floats
    on_floor: NDArray[np.bool_]

    def T_level_frame(self, i: int) -> Floats:  # noqa: N802
        """(4, 4) a level frame at the place of keyframe i, with its heading."""
        T = self.T_level_sensor[i]
        return se2_to_se3(float(np.arctan2(T[1, 0], T[0, 0])), *T[:3, 3].tolist())

    def space(self, chosen: Index) -> SeenSpace:
        outlines = [transform_points(self.T_level_sensor[k], self.keyframes[k].outline)[:, :2] for k in chosen]
        return SeenSpace.of(self.places[chosen], outlines)


class LoopCloser:
    """Finds loop closures; keyframes, walls and estimates are passed each time.

    `closures` is the factor graph's own list: new ones are added to it, contradicted ones removed. The first `looked`
    keyframes are not searched for closures.
    """

    def __init__(self, settings: LoopSettings, closures: list[Closure] | None = None, looked: int = 0) -> None:
        self._settings = settings
        self.closures = [] if closures is None else closures
        self.withdrawn: list[tuple[Closure, str]] = []  # closures that were removed, and why
        self._pending: list[Closure] = []
        self._tied = np.empty((0, 2), dtype=np.int64)
        self._widths: dict[int, Widths] = {}  # by keyframe, computed once
        self._looked, self._last_way = looked, -np.inf  # keyframes processed; way at the last search

    def look(
        self, keyframes: list[KeyframeNode], storey: int, walls: WallMap, clouds: Clouds, scene: Scene | None = None
    ) -> list[Closure]:
        """Returns the closures accepted on one floor since the last call; `scene` is that of the floor."""
        settings, began = self._settings, self._looked
        self._looked = len(keyframes)
        if not settings.enabled or len(keyframes) < 3:
            return []
        T = walls.T_level_map @ np.stack([k.T_map_sensor for k in keyframes])
        here = np.array([k.storey == storey for k in keyframes])
        known = _Map(keyframes, clouds, T, T[:, :2, 3], way_driven(T[:, :2, 3]), here)
        if known.way[-1] < settings.gap:
            return []
        new = began + np.flatnonzero(here[began:])
        tied = tied_by_walls(new, known.places, known.way, *_incidence(walls, len(keyframes)), settings.gap)
        self._tied = np.concatenate([self._tied, tied[_spread(known.way[tied[:, 0]], settings.spacing)]])
        accepted: list[Closure] = []
        chosen = self._places(known, new, set(tied[:, 0].tolist()))
        likeness = self._similar(known, chosen, walls, scene)
        for i in chosen:
            found = self._close(known, i, likeness[i])
            if found is not None:
                self._pending.append(found)
                accepted += self._accepted(known)
        return accepted

    def part_walls(self, closures: list[Closure], walls: WallMap, keyframes: list[KeyframeNode]) -> None:
        """Separates walls that were joined across two passes which a closure moves far apart.

        While the map was off, observations may have been associated with a neighbouring wall. Walls that coincide
        afterwards are joined again.
        """
        way = way_driven(np.stack([k.T_map_sensor[:2, 3] for k in keyframes]))
        for closure in closures:
            if closure.correction > self._settings.rejoin:
                before = way[closure.later] - way
                later, earlier = np.flatnonzero(before < self._settings.submap), before > self._settings.gap
                walls.part(set(later.tolist()), set(np.flatnonzero(earlier).tolist()))

    def contradicted(self, keyframes: list[KeyframeNode]) -> list[tuple[Closure, str]]:
        """Removes the closures that the optimum contradicts; returns each with the reason."""
        gone = []
        for closure in self.closures:
            T = inverse(keyframes[closure.earlier].T_map_sensor) @ keyframes[closure.later].T_map_sensor
            left = inverse(closure.T_earlier_later) @ T
            off = float(np.linalg.norm(left[:3, 3]))
            if off > self._settings.contradicted:
                gone.append((closure, f"after the optimisation, its residual is {off:.2f} m"))
        lost = {id(closure) for closure, _ in gone}
        self.closures[:] = [closure for closure in self.closures if id(closure) not in lost]
        self.withdrawn += gone
        return gone

    def state(self) -> dict[str, Any]:
        """Returns the state without `closures`, as a tree (see `state_tree`)."""
        return {
            "withdrawn": list(self.withdrawn), "pending": list(self._pending), "tied": self._tied,
            "looked": self._looked, "last_way": self._last_way,
        }  # fmt: skip

    def restore(self, state: dict[str, Any]) -> None:
        """Restores what `state` returned."""
        self._pending, self._tied = state["pending"], state["tied"]
        self._looked, self._last_way, self.withdrawn = state["looked"], state["last_way"], state["withdrawn"]

    def _similar(self, known: _Map, chosen: list[int], walls: WallMap, scene: Scene | None) -> dict[int, Similar]:
        """For each chosen keyframe, those with similar wall distances, and those in similar rooms."""
        if not chosen:
            return {}
        planes: dict[int, list[Floats]] = {}
        for s in walls.seen:
            if s.keyframe not in self._widths:
                planes.setdefault(s.keyframe, []).append(s.plane)
        self._widths |= {k: Widths.of(k, np.stack(own)) for k, own in planes.items()}
        widths = Widths.together([w for k, w in self._widths.items() if known.on_floor[k]]).turned(known.T_level_sensor)
        rooms = {} if scene is None else similar_rooms(scene)
        return {
            i: {"walls": similar(widths.by(i), widths), "room": np.array(rooms.get(i, []), dtype=np.int64)}
            for i in chosen
        }

    def _ties(self) -> Ties:
        own = np.array([(c.later, c.earlier) for c in self.closures], dtype=np.int64).reshape(-1, 2)
        return Ties(np.concatenate([self._tied, own]))

    def _places(self, known: _Map, new: Index, held: set[int]) -> list[int]:
        """The keyframes to search for now: spread over the way, the newest first."""
        chosen: list[int] = []
        ways: list[float] = [self._last_way]
        for i in new[::-1].tolist():
            if i in held or len(chosen) >= self._settings.searches:
                continue
            if min(abs(known.way[i] - w) for w in ways) >= self._settings.spacing:
                chosen.append(i)
                ways.append(float(known.way[i]))
        if chosen:
            self._last_way = max(ways)
        return chosen[::-1]

    def _close(self, known: _Map, i: int, likeness: Similar) -> Closure | None:
        """The verified closure of keyframe i to an earlier pass; None where there is none."""
        at = known.places, known.way, known.on_floor
        for earlier in passes_near(i, *at, self._ties(), self._settings, likeness)[:_PASSES]:
            closure = self._verified(known, i, earlier)
            if closure is not None:
                return closure
        return None

    def _verified(self, known: _Map, i: int, earlier: Pass) -> Closure | None:
        settings = self._settings
        later = np.flatnonzero(known.on_floor & (np.abs(known.way - known.way[i]) < settings.submap))
        later = later[known.way[later] - known.way[earlier.keyframes].max() > settings.gap / 2]
        there, here = known.space(earlier.keyframes), known.space(later)
        if len(here.points) < 50:
            return None
        fit = search(there, here.points, known.places[i], earlier.drift, earlier.turn, settings)
        if fit.overlap < settings.overlap or fit.agreement < settings.agreement:
            return self._refused(i, f"agreement {fit.agreement:.2f}, overlap {fit.overlap:.2f}")
        if fit.runner_up > fit.agreement - settings.distinct:
            return self._refused(i, f"another place fits as well ({fit.runner_up:.2f} and {fit.agreement:.2f})")
        T_level = se2_to_se3(*fit.motion.tolist()) @ known.T_level_sensor[i]
        j = int(earlier.keyframes[np.argmin(np.linalg.norm(known.places[earlier.keyframes] - T_level[:2, 3], axis=1))])
        target, source = (
            Submap.of([known.clouds[k] for k in own.tolist()], known.T_level_sensor[own], known.T_level_frame(at))
            for own, at in ((_nearest(known, earlier.keyframes, j), j), (_nearest(known, later, i), i))
        )
        T_frame_sensor = inverse(known.T_level_frame(i)) @ known.T_level_sensor[i]
        guess = inverse(known.T_level_frame(j)) @ T_level @ inverse(T_frame_sensor)
        found = register(target, source, guess, settings)
        if found is None:
            return self._refused(i, "no registration")
        moved = inverse(guess) @ found.T_target_source
        if np.linalg.norm(moved[:3, 3]) > settings.moved or _angle(moved) > settings.turned:
            return self._refused(i, "the registration moves away from the place that was found")
        if found.inliers < settings.inliers or found.error > settings.inlier_error or found.held < settings.held:
            return self._refused(i, f"inliers {found.inliers:.2f}, error {found.error:.3f} m, held {found.held:.3f}")
        T_level_later = known.T_level_frame(j) @ found.T_target_source @ T_frame_sensor
        motion = T_level_later @ inverse(known.T_level_sensor[i])
        shares = [
            agreement(space, transform_points(T, _upright(points))[:, :2])
            for space, points, T in ((there, here.points, motion), (here, there.points, inverse(motion)))
        ]
        if min(agreed for _, agreed in shares) < settings.agreement:
            return self._refused(i, "one pass sees free space where the other sees surfaces")
        correction, turn = float(np.linalg.norm(T_level_later[:3, 3] - known.T_level_sensor[i][:3, 3])), _angle(motion)
        why = (
            f"keyframe {i} revisits keyframe {j}: {found.inliers:.0%} of its points within "
            f"{100 * settings.inlier_distance:.0f} cm, agreement {fit.agreement:.2f}, next best {fit.runner_up:.2f}"
        )
        T_earlier_later = inverse(known.T_level_sensor[j]) @ T_level_later
        turned = np.kron(np.eye(2), T_frame_sensor[:3, :3].T)
        covariance = turned @ found.covariance @ turned.T
        return Closure(j, i, T_earlier_later, (covariance + covariance.T) / 2, correction, turn, earlier.by, why)

    def _refused(self, i: int, why: str) -> Closure | None:
        _log.debug("keyframe %d closes no loop: %s", i, why)
        return None

    def _accepted(self, known: _Map) -> list[Closure]:
        """The pending closures that can be accepted now."""
        settings, newest = self._settings, self._pending[-1]
        agreeing = [c for c in self._pending if self._agree(known, c, newest)]
        if newest.correction > settings.alone or newest.turn > settings.alone_turn:
            ways = known.way[[c.later for c in agreeing]]
            if len(agreeing) < settings.together or np.ptp(ways) < settings.apart:
                return []
        self._pending = [c for c in self._pending if all(c is not a for a in agreeing)]
        self.closures += agreeing
        for closure in agreeing:
            _log.info("loop closed by %s: %s", closure.by, closure.why)
        return agreeing

    def _agree(self, known: _Map, a: Closure, b: Closure) -> bool:
        """Whether two closures move the later pass by the same motion, within the drift between them."""
        T = known.T_level_sensor
        first, second = (T[c.earlier] @ c.T_earlier_later @ inverse(T[c.later]) for c in (a, b))
        apart = abs(known.way[a.later] - known.way[b.later]) + abs(known.way[a.earlier] - known.way[b.earlier])
        off = transform_points(first, T[b.later][:3, 3]) - transform_points(second, T[b.later][:3, 3])
        turned = _angle(inverse(first) @ second)
        return bool(
            np.linalg.norm(off) < 0.1 + self._settings.drift * apart and turned < 0.015 + self._settings.turn * apart
        )


def _incidence(walls: WallMap, keyframes: int) -> tuple[NDArray[np.float32], Floats]:
    """(K, W) incidence, 1 where a keyframe saw a wall, and the walls' normals (W, 2)."""
    lines = walls.lines
    saw = np.zeros((keyframes, len(lines.ids)), dtype=np.float32)
    column = {wall: k for k, wall in enumerate(lines.ids.tolist())}
    pairs = np.array([(s.keyframe, column[s.wall]) for s in walls.seen if s.wall in column], dtype=np.int64)
    if len(pairs):
        saw[pairs[:, 0], pairs[:, 1]] = 1.0
    return saw, lines.normal


def _nearest(known: _Map, own: Index, i: int) -> Index:
    """The keyframes of a pass nearest to keyframe i along the way, in their order."""
    return np.sort(own[np.argsort(np.abs(known.way[own] - known.way[i]), kind="stable")[:_CLOUDS]])


def _spread(way: Floats, spacing: float) -> Index:
    """The indices of elements of `way` (N,) that are `spacing` apart."""
    _, first = np.unique(np.floor(way / spacing), return_index=True)
    return np.sort(first)


def _upright(points: Floats) -> Floats:
    return np.column_stack([points, np.zeros(len(points))])


def _angle(T: Floats) -> float:
    return float(np.arccos(np.clip((np.trace(T[:3, :3]) - 1) / 2, -1.0, 1.0)))
