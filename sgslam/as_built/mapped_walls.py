"""The mapped wall surfaces of a storey in the plan, and how each lies to others and to planned walls."""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, WallSurface
from sgslam.anchoring import WallAlignment
from sgslam.anchoring.wall_association import WallArrays
from sgslam.as_built.visibility import MIN_KEYFRAMES
from sgslam.mapping import Scene, WallMap

Floats = NDArray[np.float64]
_SCREEN = 1.3  # m above the floor; what is lower is no wall, however thin
_THIN = 0.25  # m between both sides of a wall; furniture is thicker
_LEAST_BACK = 1.0  # m of its other side
_MAX_TURN = 0.1  # rad between both sides of a wall
_PARALLEL = 0.35  # rad; pieces of a niche are seen at an angle
_ALONG = 0.35  # of an extra wall's length that may have planned walls along it
_NEAR_PLANNED = 0.8  # m; before a planned wall this near stand cupboards
_BEFORE = 0.1  # m, by which furniture stands before a wall at least
_AT_END = 0.25  # m between the end of a wall and the wall that it meets
_HIGHER = 0.2  # m by which a wall reaches above the furniture in front of it


@dataclass(frozen=True, eq=False)
class MappedWalls:
    """N mapped surfaces as `arrays` in the local frame, with the planned ones of the storey in the same frame.

    `wall` are the numbers of the mapped walls that the surfaces are of; `bottom` and `highest` (N,) how low and high
    they were seen, `top` (N,) how high by as many keyframes as must agree, metres above the floor; `count` (N,) the
    keyframes that saw them. `aligned` are the ids of the surfaces that stand at a planned wall.
    """

    surfaces: list[WallSurface]
    arrays: WallArrays
    planned: WallArrays
    wall: list[int]
    bottom: Floats
    highest: Floats
    top: Floats
    count: NDArray[np.int64]
    aligned: set[str]

    @staticmethod
    def of(scene: Scene, walls: WallMap, alignment: WallAlignment, floor: SceneGraph, origin: Floats) -> "MappedWalls":
        """The surfaces of a storey of the map; `origin` (2,) is the local frame's origin in the BIM frame."""
        surfaces = list(scene.graph.wall_surfaces)
        of = [scene.wall_of_surface[surface.id] for surface in surfaces]
        heights, counts, tops = walls.heights(), walls.counts(), _tops(walls)
        return MappedWalls(
            surfaces, WallArrays.of(surfaces, {}, np.zeros(2)).moved(alignment.place),
            WallArrays.of(list(floor.wall_surfaces), {}, origin), of, np.array([heights[wall][0] for wall in of]),
            np.array([heights[wall][1] for wall in of]),
            np.array([tops[wall] for wall in of]), np.array([counts[wall] for wall in of], dtype=np.int64),
            {aligned.surface.id for aligned in alignment.walls},
        )  # fmt: skip

    def tangent(self, i: int) -> Floats:
        """(2,) leftward along surface i, looking along its normal."""
        nx, ny = self.arrays.normal[i]
        return np.array([-ny, nx])

    def has_other_side(self, i: int) -> bool:
        """Whether surface i is tall, and another tall one faces away behind it, where a wall's other side is."""
        return has_other_side(self.arrays, i, (self.highest > _SCREEN) & (self.count > MIN_KEYFRAMES))

    def stands_before_another(self, i: int) -> bool:
        """Whether a wall that reaches higher stands behind surface i, as behind a cupboard."""
        s, n = self.arrays, self.arrays.normal[i]
        away = s.centre - s.centre[i]
        behind = -away @ n
        beside = s.half + s.half[i] - np.abs(away @ self.tangent(i))
        back = (s.normal @ n > np.cos(_MAX_TURN)) & (behind > _BEFORE) & (behind < _NEAR_PLANNED)
        return bool(np.any(back & (beside > 0.0) & (self.top > self.top[i] + _HIGHER)))

    def closes_a_room(self, i: int) -> bool:
        """Whether surface i is higher than a screen and both its ends meet walls across, unlike those of furniture."""
        if self.top[i] < _SCREEN:
            return False
        s, t = self.arrays, self.tangent(i)
        ends = (s.centre[i] + k * s.half[i] * t for k in (-1, 1))
        high = self.highest > self.highest[i] - _HIGHER
        return all(_meets(end, t, s, high) or _meets(end, t, self.planned) for end in ends)

    def unplanned_stretches(self, i: int) -> list[tuple[float, float]]:
        """Where along surface i (m from its middle, leftward) no planned wall is; empty if planned walls lie along a
        good part of it, near enough to be the same or to be behind it."""
        s, a = self.arrays, self.planned
        away = a.centre - s.centre[i]
        across = np.abs(np.sum(away * a.normal, axis=1))
        near = (np.abs(a.normal @ s.normal[i]) > np.cos(_PARALLEL)) & (across < _NEAR_PLANNED)
        places = (away @ self.tangent(i))[near]
        low, high = (np.clip(places + k * a.half[near], -s.half[i], s.half[i]) for k in (-1, 1))
        free = _complement(low, high, float(s.half[i]))
        length = sum(end - begin for begin, end in free)
        return free if length > (1 - _ALONG) * 2 * s.half[i] else []


def has_other_side(s: WallArrays, i: int, tall: NDArray[np.bool_]) -> bool:
    """Whether surface i is tall, and another tall one faces away behind it, at the distance of a wall's other side."""
    behind = -np.sum((s.centre - s.centre[i]) * s.normal[i], axis=1)
    t = np.array([-s.normal[i][1], s.normal[i][0]])
    beside = s.half + s.half[i] - np.abs((s.centre - s.centre[i]) @ t)
    back = (s.normal @ s.normal[i] < -np.cos(_MAX_TURN)) & (behind > 0) & (behind < _THIN)
    return bool(tall[i] and np.any(tall & back & (beside > _LEAST_BACK)))


def _meets(end: Floats, tangent: Floats, walls: WallArrays, asked: NDArray[np.bool_] | None = None) -> bool:
    """Whether one of the walls across, of those `asked` (N,), stands at the end (2,) of a surface along `tangent`."""
    away = end - walls.centre
    across = np.abs(np.sum(away * walls.normal, axis=1))
    beside = np.abs(away[:, 1] * walls.normal[:, 0] - away[:, 0] * walls.normal[:, 1]) - walls.half
    near = (np.abs(walls.normal @ tangent) > np.cos(_MAX_TURN)) & (across < _AT_END) & (beside < _AT_END)
    return bool(np.any(near if asked is None else near & asked))


def _complement(low: Floats, high: Floats, half: float) -> list[tuple[float, float]]:
    """The parts of -half to half that no interval (K,) covers."""
    free, at = [], -half
    for k in np.argsort(low).tolist():
        if low[k] > at:
            free.append((at, float(low[k])))
        at = max(at, float(high[k]))
    return [*free, (at, half)] if at < half else free


def _tops(walls: WallMap) -> dict[int, float]:
    """For each wall, how high (m above the floor) as many keyframes saw it as must agree; the least of fewer."""
    highest: dict[int, list[float]] = defaultdict(list)
    for sight in walls.seen:
        highest[sight.wall].append(sight.heights[1])
    return {wall: sorted(tops, reverse=True)[:MIN_KEYFRAMES][-1] for wall, tops in highest.items()}
