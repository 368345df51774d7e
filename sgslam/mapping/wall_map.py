"""The wall map: associates wall observations across keyframes, and joins and splits walls.

A wall here is an upright plane with a side. The S-graph's wall surfaces are its parts, one for each room it faces.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sgslam.config import SurfaceSettings
from sgslam.config.sensor import BUILDING
from sgslam.geometry.frames import transform_planes, transform_points
from sgslam.mapping.level_map import Register
from sgslam.perception import WallObservation

Floats = NDArray[np.float64]
_GAP = 1.0  # m along, between a piece and the wall that it is of
_JOIN_OFFSET = 0.1  # m between two walls that are one
_STEP = 0.05  # m across, between the parts of a wall that are two


@dataclass
class SeenWall(WallObservation):
    """One wall observation of one keyframe, in the sensor frame; `wall` is relabelled when walls are joined."""

    keyframe: int
    wall: int


@dataclass(frozen=True)
class Lines:
    """M upright planes in plan view of the levelled map: n.p + d = 0, from `low` to `high` (m) along the tangent."""

    ids: NDArray[np.int64]
    normal: Floats  # (M, 2)
    offset: Floats  # (M,)
    low: Floats
    high: Floats
    count: NDArray[np.int64]  # keyframes that saw it

    def along(self, points: Floats) -> Floats:
        """(K, M) the positions (m) of points (K, 2) along each line's tangent."""
        return points @ np.column_stack([-self.normal[:, 1], self.normal[:, 0]]).T

    def across(self, points: Floats) -> Floats:
        """(K, M) the signed distances (m) of points (K, 2) from each line."""
        return points @ self.normal.T + self.offset


class WallMap:
    """The wall observations of one floor and the walls that they belong to.

    `register` is shared by all floors. `T_level_map` (4, 4) levels the map: z up, the floor at z = 0. `planes_in_map`
    are the back end's planes (4,) by wall number.
    """

    def __init__(self, settings: SurfaceSettings, register: Register) -> None:
        self._settings, self._register = settings, register
        self.seen: list[SeenWall] = []
        self.planes_in_map: dict[int, Floats] = {}
        self.T_level_map: Floats = np.eye(4)
        self._extent: dict[int, tuple[float, float, set[int]]] = {}  # low, high, keyframes
        self._intervals: list[tuple[int, float, float]] = []  # wall, low, high of each observation
        self._across, self._along = np.empty(0), np.empty(0)  # m, each observation's centre relative to its wall
        self._joined_into: dict[int, int] = {}

    def add(self, keyframe: int, T_map_sensor: Floats, pieces: list[WallObservation]) -> None:
        """Adds the observations of a keyframe, in the sensor frame."""
        if not pieces:
            return
        planes_in_map = transform_planes(T_map_sensor, np.stack([piece.plane for piece in pieces]))
        ends_in_level = transform_points(self.T_level_map @ T_map_sensor, np.stack([piece.ends for piece in pieces]))
        walls = self._associate(planes_in_map, ends_in_level[..., :2])
        for piece, plane_in_map, wall in zip(pieces, planes_in_map, walls, strict=True):
            self.seen.append(SeenWall(**vars(piece), keyframe=keyframe, wall=wall))
            self.planes_in_map.setdefault(wall, plane_in_map)
        normals, _ = self._as_lines(np.stack([self.planes_in_map[wall] for wall in walls]))
        self._widen(np.array(walls), normals, ends_in_level[..., :2], [keyframe] * len(walls))

    def absorb(self, other: "WallMap", keyframes: int, wall_of: dict[int, int]) -> None:
        """Adds the observations of another map; `refresh` must follow.

        Its keyframes are numbered from `keyframes` on here; `wall_of` maps its wall numbers to those here.
        """
        for s in other.seen:
            self.seen.append(replace(s, keyframe=s.keyframe + keyframes, wall=wall_of[s.wall]))

    def refresh(self, poses: Floats, planes_in_map: dict[int, Floats]) -> None:
        """Updates the walls from the back end: `poses` (K, 4, 4), T_map_sensor of all keyframes, and planes (4,)."""
        observed = {s.wall for s in self.seen}
        self.planes_in_map = {wall: plane for wall, plane in planes_in_map.items() if wall in observed}
        self._extent, self._intervals = {}, []
        if not self.seen:
            return
        T = poses[[s.keyframe for s in self.seen]]
        for s, pose in zip(self.seen, T, strict=True):
            if s.wall not in self.planes_in_map:  # seen once so far
                self.planes_in_map[s.wall] = transform_planes(pose, s.plane)
        ids = np.array(list(self.planes_in_map))
        normal, offset = self._as_lines(np.stack(list(self.planes_in_map.values())))
        row = np.empty(int(ids.max()) + 1, dtype=np.int64)
        row[ids] = np.arange(len(ids))
        ends = transform_points((self.T_level_map @ T)[:, None], np.stack([s.ends for s in self.seen]))
        owner = row[[s.wall for s in self.seen]]
        middle = ends[..., :2].mean(axis=1)
        self._across = np.sum(middle * normal[owner], axis=1) + offset[owner]
        self._along = middle[:, 1] * normal[owner, 0] - middle[:, 0] * normal[owner, 1]
        self._widen(ids[owner], normal[owner], ends[..., :2], [s.keyframe for s in self.seen])

    def current(self, wall: int) -> int:
        """The number of the wall that this one was joined into; its own if it was not."""
        while wall in self._joined_into:
            wall = self._joined_into[wall]
        return wall

    @property
    def lines(self) -> Lines:
        """The walls as lines in the levelled map, by the present estimates."""
        ids = np.array(sorted(self.planes_in_map), dtype=np.int64)
        normal, offset = self._as_lines(np.array([self.planes_in_map[i] for i in ids]).reshape(-1, 4))
        low, high = np.array([self._extent[i][:2] for i in ids.tolist()]).reshape(-1, 2).T
        count = np.array([len(self._extent[i][2]) for i in ids.tolist()], dtype=np.int64)
        return Lines(ids, normal, offset, low, high, count)

    def coverage(self, step: float) -> dict[int, Floats]:
        """For each wall, the positions (m) along its tangent, `step` apart, at which it was seen."""
        cells: dict[int, set[int]] = {wall: set() for wall in self.planes_in_map}
        for wall, low, high in self._intervals:
            cells[wall].update(range(int(np.floor(low / step + 0.5)), int(np.ceil(high / step - 0.5)) + 1))
        return {wall: np.array(sorted(found), dtype=float) * step for wall, found in cells.items()}

    def normal_in_level(self, wall: int) -> Floats:
        """(2,) a wall's normal in the levelled map, from the present estimates."""
        return self._as_lines(self.planes_in_map[wall][None])[0][0]

    def heights(self) -> dict[int, tuple[float, float]]:
        """For each wall, the lowest and the highest point seen (m above the floor)."""
        result: dict[int, tuple[float, float]] = {}
        for s in self.seen:
            low, high = result.get(s.wall, s.heights)
            result[s.wall] = (min(low, s.heights[0]), max(high, s.heights[1]))
        return result

    def join_duplicates(self) -> int:
        """Joins walls that coincide; returns the number of walls that were dropped."""
        joined = 0
        while True:
            lines = self.lines
            pair = _closest_duplicate(lines, self._settings)
            if pair is None:
                return joined
            kept, gone = pair if lines.count[pair[0]] >= lines.count[pair[1]] else pair[::-1]
            self._relabel(int(lines.ids[gone]), int(lines.ids[kept]))
            joined += 1

    def split_steps(self) -> int:
        """Splits walls that turn out to be two, end to end and centimetres apart across; returns the number of splits.

        The observations of such a wall have one offset up to some place along it and another one beyond.
        """
        by_wall: dict[int, list[int]] = {}
        for i, s in enumerate(self.seen):
            by_wall.setdefault(s.wall, []).append(i)
        parted = 0
        for own in by_wall.values():
            if len(own) < 2 * self._settings.min_observations:
                continue
            beyond = _beyond_step(self._along[own], self._across[own], self._settings)
            if beyond is None:
                continue
            number = self._register.number()
            for i in np.asarray(own)[beyond]:
                self.seen[i].wall = number
            parted += 1
        return parted

    def part(self, later: set[int], earlier: set[int]) -> None:
        """Moves the `later` keyframes' observations of walls that `earlier` keyframes saw too to new walls."""
        old = {s.wall for s in self.seen if s.keyframe in earlier}
        names: dict[int, int] = {}
        for s in self.seen:
            if s.keyframe in later and s.wall in old:
                s.wall = names[s.wall] if s.wall in names else names.setdefault(s.wall, self._register.number())

    def _relabel(self, gone: int, kept: int) -> None:
        self._joined_into[gone] = kept
        for s in self.seen:
            if s.wall == gone:
                s.wall = kept
        low, high, keyframes = self._extent.pop(gone)
        mine = self._extent[kept]
        self._extent[kept] = (min(mine[0], low), max(mine[1], high), mine[2] | keyframes)
        self._intervals = [(kept if wall == gone else wall, a, b) for wall, a, b in self._intervals]
        del self.planes_in_map[gone]

    def _as_lines(self, planes: Floats) -> tuple[Floats, Floats]:
        level = transform_planes(self.T_level_map, planes)
        scale = np.hypot(level[:, 0], level[:, 1])
        return level[:, :2] / scale[:, None], level[:, 3] / scale

    def _associate(self, planes_in_map: Floats, ends: Floats) -> list[int]:
        """For each piece (N, 4), with ends (N, 2, 2) in the levelled map, the number of its wall or a new one.

        Of the walls that face the same way and are near along, the nearest across is taken.
        """
        lines = self.lines
        nearest, fits = np.zeros(len(ends), dtype=np.int64), np.zeros(len(ends), dtype=bool)
        if len(lines.ids):
            normals, _ = self._as_lines(planes_in_map)
            facing = normals @ lines.normal.T > np.cos(self._settings.associate_angle)
            # the distance of the far end is more informative than the angle of a short piece
            ends_across = lines.across(ends.reshape(-1, 2)).reshape(len(ends), 2, -1)
            across = np.abs(ends_across.mean(axis=1))
            along = np.sort(lines.along(ends.reshape(-1, 2)).reshape(len(ends), 2, -1), axis=1)
            gap = np.maximum(along[:, 0] - lines.high, lines.low - along[:, 1])
            near = facing & (across < self._settings.associate_offset) & (gap < _GAP)
            near &= np.abs(ends_across).max(axis=1) < 2 * self._settings.associate_offset
            nearest = np.argmin(np.where(near, across + 0.1 * np.maximum(gap, 0.0), np.inf), axis=1)
            fits = near.any(axis=1)
        own = zip(nearest.tolist(), fits.tolist(), strict=True)
        return [int(lines.ids[row]) if known else self._register.number() for row, known in own]

    def _widen(self, walls: NDArray[np.int64], normals: Floats, ends: Floats, keyframes: list[int]) -> None:
        """Extends walls (N,) with normals (N, 2) by pieces that end at `ends` (N, 2, 2), seen by `keyframes` (N,)."""
        along = ends[..., 1] * normals[:, None, 0] - ends[..., 0] * normals[:, None, 1]
        reach = zip(walls.tolist(), along.min(axis=1).tolist(), along.max(axis=1).tolist(), keyframes, strict=True)
        for wall, low, high, keyframe in reach:
            old = self._extent.get(wall, (np.inf, -np.inf, set()))
            old[2].add(keyframe)
            self._extent[wall] = (min(old[0], low), max(old[1], high), old[2])
            self._intervals.append((wall, low, high))


def _beyond_step(along: Floats, across: Floats, settings: SurfaceSettings) -> NDArray[np.int64] | None:
    """The indices of the observations beyond a step in the offset; None where there is no step.

    `along`, `across` (N,) are the observations' centres (m). The step must be clear against the scatter on either side.
    """
    order = np.argsort(along, kind="stable")
    values = across[order]
    least = settings.min_observations
    cuts = np.arange(least, len(values) - least + 1)
    total, squares = np.cumsum(values), np.cumsum(values**2)
    before = squares[cuts - 1] - total[cuts - 1] ** 2 / cuts
    beyond = squares[-1] - squares[cuts - 1] - (total[-1] - total[cuts - 1]) ** 2 / (len(values) - cuts)
    best = int(np.argmin(before + beyond))
    where = int(cuts[best])
    scatter = np.sqrt(max((before + beyond)[best], 0.0) / len(values))
    step = abs(np.median(values[:where]) - np.median(values[where:]))
    if step < _STEP or step < 4 * scatter:
        return None
    return order[where:]


def _closest_duplicate(lines: Lines, settings: SurfaceSettings) -> tuple[int, int] | None:
    """The indices of the closest two walls that face the same way and coincide; None where there are none."""
    if len(lines.ids) < 2:
        return None
    tangent = np.column_stack([-lines.normal[:, 1], lines.normal[:, 0]])
    centre = (lines.low + lines.high)[:, None] / 2 * tangent - lines.offset[:, None] * lines.normal
    half = (lines.high - lines.low) / 2
    place = lines.along(centre).T  # (i, j): of j's centre along i
    low, high = np.maximum(lines.low[:, None], place - half), np.minimum(lines.high[:, None], place + half)
    overlap = high - low
    # the distance of j from i where both are, not at the centre of a long wall
    common = (low + high)[..., None] / 2 * tangent[:, None] - (lines.offset[:, None] * lines.normal)[:, None]
    across = np.abs(np.einsum("ijk,jk->ij", common, lines.normal) + lines.offset)
    across = np.maximum(across, across.T)
    parallel = lines.normal @ lines.normal.T > np.cos(BUILDING.one_wall)
    # end to end, two walls are one only without a step; side by side, there is no room for both
    allowed = np.where(overlap > settings.min_length, _JOIN_OFFSET, 0.5 * _STEP)
    cost = np.where(parallel & (across < allowed) & (overlap > -0.2), across, np.inf)
    np.fill_diagonal(cost, np.inf)
    first, second = np.unravel_index(int(np.argmin(cost)), cost.shape)
    return (int(first), int(second)) if np.isfinite(cost[first, second]) else None
