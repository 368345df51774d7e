"""Loop closure: revisited places are proposed, searched, registered, and checked for consistency.

A false closure damages the map, a missed one does not: in doubt none is made. A closure must lie within the possible
drift, and no other place within it may fit nearly as well. The scans of both passes must overlap and constrain all
directions, and neither pass may see through the other's walls. For large corrections, several closures must agree
(pairwise consistency; Mangelson et al., ICRA 2018).
"""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.config.models import LoopSettings
from sgslam.geometry.frames import angle_of, inverse, level_at, transform_points
from sgslam.loops.pass_alignment import INLIER, SeenSpace, Submap, covariance_of, register, search
from sgslam.mapping import Closure, KeyframeClouds, KeyframeNode, WallMap

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
_log = logging.getLogger(__name__)
_SUBMAP, _CLOUDS = 8.0, 10  # m of way on either side of a keyframe that make a pass; keyframes that are registered
_SPACING, _SEARCHES = 2.0, 2  # m between places that are searched for; of these at most at each look
_VIEW = 2.5  # m between two places from which much the same is seen
_DRIFT, _TURN = 0.3, 0.075  # m that a map is off at least; rad of heading for each metre of drift
_AGREEMENT, _DISTINCT = 0.8, 0.12  # least agreement, and its margin over other places
_INLIERS, _HELD = 0.7, 0.02  # least shares of inliers, and of those that constrain the weakest direction
_ALONE, _TOGETHER = (0.3, 0.03), 3  # m and rad that a single closure may correct; closures that may correct more
_AGREE = 0.1, 0.015  # m and rad between two closures that agree, besides the drift between them
_SIGMA = np.array([0.004] * 3 + [0.02] * 3)  # rad and m, of a closure: the map within a pass errs too


@dataclass(frozen=True)
class _Map:
    """The present map: T_level_sensor (K, 4, 4) of all keyframes in the levelled map, places (K, 2), metres driven
    (K,), and whether each is on the present floor (K,)."""

    keyframes: list[KeyframeNode]
    clouds: KeyframeClouds
    T_level_sensor: Floats
    places: Floats
    way: Floats
    on_floor: NDArray[np.bool_]

    def space(self, chosen: Index) -> SeenSpace:
        outlines = [transform_points(self.T_level_sensor[k], self.keyframes[k].outline)[:, :2] for k in chosen]
        return SeenSpace.of(self.places[chosen], outlines)

    def submap(self, chosen: Index, i: int) -> Submap:
        """The clouds of the `chosen` keyframes that are nearest to keyframe i along the way, in its level frame."""
        own = np.sort(chosen[np.argsort(np.abs(self.way[chosen] - self.way[i]), kind="stable")[:_CLOUDS]])
        T = inverse(level_at(self.T_level_sensor[i])) @ self.T_level_sensor[own]
        return Submap.of([self.clouds[k] for k in own.tolist()], T)


class LoopCloser:
    """Finds loop closures; keyframes, walls and estimates are passed each time.

    `closures` is the factor graph's own list: new ones are added to it, contradicted ones removed. The first `looked`
    keyframes are not searched for closures.
    """

    def __init__(self, settings: LoopSettings, closures: list[Closure] | None = None, looked: int = 0) -> None:
        self._settings = settings
        self.closures = [] if closures is None else closures
        self._pending: list[Closure] = []
        self._looked, self._last_way = looked, -np.inf  # keyframes processed; way at the last search

    def look(
        self, keyframes: list[KeyframeNode], storey: int, T_level_map: Floats, clouds: KeyframeClouds
    ) -> list[Closure]:
        """Returns the closures accepted on one floor since the last call; T_level_map (4, 4) levels the map."""
        began, self._looked = self._looked, len(keyframes)
        if not self._settings.enabled or len(keyframes) < 3:
            return []
        T = T_level_map @ np.stack([k.T_map_sensor for k in keyframes])
        here = np.array([k.storey == storey for k in keyframes])
        known = _Map(keyframes, clouds, T, T[:, :2, 3], _way(T), here)
        accepted: list[Closure] = []
        for i in self._places(known, began + np.flatnonzero(here[began:])):
            earlier, drift = self._pass_near(known, i)
            found = self._verified(known, i, earlier, drift) if len(earlier) else None
            if found is not None:
                self._pending.append(found)
                accepted += self._accepted(known)
        return accepted

    def part_walls(self, closures: list[Closure], walls: WallMap, keyframes: list[KeyframeNode]) -> None:
        """Separates walls that were joined across two passes which a closure moves apart.

        While the map was off, observations may have been associated with a neighbouring wall. Walls that coincide
        afterwards are joined again.
        """
        way = _way(np.stack([k.T_map_sensor for k in keyframes]))
        for closure in closures:
            if closure.correction > INLIER:
                before = way[closure.later] - way
                later, earlier = np.flatnonzero(before < _SUBMAP), np.flatnonzero(before > self._settings.gap)
                walls.part(set(later.tolist()), set(earlier.tolist()))

    def contradicted(self, keyframes: list[KeyframeNode]) -> list[Closure]:
        """Removes the closures that the optimum contradicts, and returns them."""
        gone = []
        for closure in self.closures:
            T = inverse(keyframes[closure.earlier].T_map_sensor) @ keyframes[closure.later].T_map_sensor
            off = float(np.linalg.norm((inverse(closure.T_earlier_later) @ T)[:3, 3]))
            if off > _ALONE[0]:
                gone.append(closure)
                _log.info("loop opened: after the optimisation, its residual is %.2f m", off)
        self.closures[:] = [own for own in self.closures if all(own is not other for other in gone)]
        return gone

    def _places(self, known: _Map, new: Index) -> list[int]:
        """The keyframes to search for now: spread over the way, the newest first."""
        chosen: list[int] = []
        ways: list[float] = [self._last_way]
        for i in new[::-1].tolist():
            if len(chosen) < _SEARCHES and min(abs(known.way[i] - w) for w in ways) >= _SPACING:
                chosen.append(i)
                ways.append(float(known.way[i]))
        if chosen:
            self._last_way = max(ways)
        return chosen[::-1]

    def _pass_near(self, known: _Map, i: int) -> tuple[Index, float]:
        """The nearest earlier pass that keyframe i may have come back to, and how far (m) the map may be off there."""
        before = known.way[i] - known.way
        older = np.flatnonzero(known.on_floor & (before > self._settings.gap))
        drift = np.minimum(_DRIFT + self._settings.drift * before[older], self._settings.most_drift)
        off = np.linalg.norm(known.places[older] - known.places[i], axis=1)
        possible = np.flatnonzero(off < drift + _VIEW)
        if not len(possible):
            return older[:0], 0.0
        nearest = int(possible[np.argmin(off[possible])])
        return older[np.abs(known.way[older] - known.way[older[nearest]]) < _SUBMAP], float(drift[nearest])

    def _verified(self, known: _Map, i: int, earlier: Index, drift: float) -> Closure | None:
        """The closure of keyframe i to an earlier pass, None where there is none."""
        later = np.flatnonzero(known.on_floor & (np.abs(known.way - known.way[i]) < _SUBMAP))
        later = later[known.way[later] - known.way[earlier].max() > self._settings.gap / 2]
        # search: one place must fit, within the drift, and no other one nearly as well
        there, here = known.space(earlier), known.space(later)
        fit = search(there, here.points, known.places[i], drift, _TURN * drift)
        if fit is None or fit.agreement < _AGREEMENT or fit.runner_up > fit.agreement - _DISTINCT:
            return None
        # registration, from there
        T_level = fit.T_there_here @ known.T_level_sensor[i]
        j = int(earlier[np.argmin(np.linalg.norm(known.places[earlier] - T_level[:2, 3], axis=1))])
        T_level_i, T_level_j = level_at(known.T_level_sensor[i]), level_at(known.T_level_sensor[j])
        T_frame_sensor = inverse(T_level_i) @ known.T_level_sensor[i]
        guess = inverse(T_level_j) @ fit.T_there_here @ T_level_i
        found = register(known.submap(earlier, j), known.submap(later, i), guess)
        if found is None or found.inliers < _INLIERS or found.held < _HELD:
            return None
        # neither pass may see free space where the other sees walls
        T_level_later = T_level_j @ found.T_target_source @ T_frame_sensor
        motion = T_level_later @ inverse(known.T_level_sensor[i])
        for space, points, T in ((there, here.points, motion), (here, there.points, inverse(motion))):
            if space.agreement(transform_points(T, np.pad(points, ((0, 0), (0, 1))))[:, :2]) < _AGREEMENT:
                return None
        correction = float(np.linalg.norm(T_level_later[:3, 3] - known.T_level_sensor[i][:3, 3]))
        T_earlier_later = inverse(known.T_level_sensor[j]) @ T_level_later
        why = (
            f"keyframe {i} revisits keyframe {j}: {found.inliers:.0%} of its points within {100 * INLIER:.0f} cm, "
            f"agreement {fit.agreement:.2f}, next best {fit.runner_up:.2f}"
        )
        covariance = covariance_of(found, T_frame_sensor, _SIGMA)
        return Closure(j, i, T_earlier_later, covariance, correction, angle_of(motion), why)

    def _accepted(self, known: _Map) -> list[Closure]:
        """The pending closures that can be accepted now."""
        newest = self._pending[-1]
        agreeing = [c for c in self._pending if self._agree(known, c, newest)]
        is_large = newest.correction > _ALONE[0] or newest.turn > _ALONE[1]
        if is_large and len(agreeing) < _TOGETHER:
            return []
        self._pending = [c for c in self._pending if all(c is not a for a in agreeing)]
        self.closures += agreeing
        for closure in agreeing:
            _log.info("loop closed: %s", closure.why)
        return agreeing

    def _agree(self, known: _Map, a: Closure, b: Closure) -> bool:
        """Whether two closures move the later pass by the same motion, within the drift between them."""
        T = known.T_level_sensor
        first, second = (T[c.earlier] @ c.T_earlier_later @ inverse(T[c.later]) for c in (a, b))
        apart = abs(known.way[a.later] - known.way[b.later]) + abs(known.way[a.earlier] - known.way[b.earlier])
        off = transform_points(first, T[b.later][:3, 3]) - transform_points(second, T[b.later][:3, 3])
        drift = self._settings.drift * apart
        turned = angle_of(inverse(first) @ second)
        return bool(np.linalg.norm(off) < _AGREE[0] + drift and turned < _AGREE[1] + _TURN * drift)


def _way(T_map_sensor: Floats) -> Floats:
    """(K,) metres driven up to each of the poses (K, 4, 4), in plan view."""
    steps = np.linalg.norm(np.diff(T_map_sensor[:, :2, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
