"""Floor transitions: detects that the robot leaves a floor over stairs, ramps or steps, and that it arrives at one.

Upright walls do not constrain the height. On a floor, the alignment keeps the sensor at its height above it. Where that
no longer holds, the sensor seems to lean, and level surfaces seen before (floor, treads) seem to sink or rise. Then the
scan is aligned a second time, with these surfaces and the walls only. If the height differs, the floor was left, and
scans are aligned this way until the ground has been level for some way.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data.common.compiled import compiled
from sgslam.config import TrackingSettings
from sgslam.geometry.frames import inverse, levelling, transform_points
from sgslam.mapping import FloorMap, Floors, Lines
from sgslam.perception import ColumnScan
from sgslam.serialization import Stateful
from sgslam.tracking.alignment import Carried, Tracked, chosen, moved_by, to_walls

Floats = NDArray[np.float64]
_REACH = 6.0  # m to the level surfaces that are used
_WALLS_REACH = 8.0  # m to the walls that are used on a stair; those of another storey may differ
_SPACING, _PATIENCE = 0.15, 0.75  # m between the scans whose level surfaces are stored; the latter in doubt
_KEPT = 24  # scans in that window
_BESIDE = 0.08  # m in plan between two points of one level surface
_NEAR = (0.2, 0.1, 0.1)  # m between corresponding points on a stair, for each iteration
_RISE = 0.07  # m of height between them on a stair, less than half a riser
_ON_SURFACE = 0.03  # m from a known level surface
_LEAST = 12  # points that a decision needs
_DOUBTFUL = 0.02, 0.05, 0.04  # rad of lean, m of height, m of rise of level surfaces: then the scan is aligned twice
_ALIKE = 0.05, 0.5  # m, and the share of the points that must agree on the rise of level surfaces
_MOST = 0.6  # m, the largest rise that is considered
_LEFT = 0.07, 2  # m of height between both alignments, and consecutive scans, after which the floor was left
_FLAT = 0.05  # m by which the height changes on level ground
_LEVEL_WAY, _HOME_WAY = 2.0, 1.2  # m of level way that a landing does not have; the same at the height of a known floor
_HOME = 0.12  # m from a known floor at which the robot is on it; more after a climb:
_DRIFT = 0.1, 0.6  # m for each metre climbed beyond so many metres, as heights drift on a stair
_STOREY = 1.9  # least m between two floors; less is a landing, a mezzanine, a ramp or a step
_STEEPEST, _SWAY = 1.0, 0.02  # m of height for each metre of way, and a constant
_TILT = 0.15  # rad, sigma of the sensor's lean on a stair


@dataclass(frozen=True)
class Arrival:
    """Arrival on level ground at `height` (m) above `floor`; None where a new floor begins there.

    `drift` (m) is the error in height of the climb where the floor was known before.
    """

    floor: FloorMap | None
    height: float
    drift: float = 0.0


class FloorTransition(Stateful):
    """Detects that the robot leaves its floor, and aligns scans between two floors.

    `active`: between two floors. `ground` (m): height of the ground under the robot above its floor, on steps or ramps.
    """

    _STATE = ("active", "ground", "_window", "_mapped", "_suspected", "_idle", "_way")

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        self.active = False
        self.ground = 0.0
        self._window: list[Floats] = []  # (N, 3) level points of each stored scan, map frame
        self._mapped = np.full(3, np.inf)  # position of the newest stored scan
        self._suspected = 0  # consecutive scans that show that the floor was left
        self._idle = False  # skips every other scan
        self._way: list[Floats] = []  # x, y and height of the ground since the floor was left, level frame
        self._known: Floats | None = None  # (N, 3) the points of the window, level frame

    def moved(self, T_new_old: Floats) -> None:
        """Follows a correction T_new_old (4, 4) of the map at the robot."""
        if np.abs(T_new_old - np.eye(4)).max() > 1e-9:
            self._window = [transform_points(T_new_old, points) for points in self._window]
            self._known = None

    @property
    def suspected(self) -> bool:
        """Whether the robot may be leaving its floor."""
        return self._suspected > 0

    def watch(
        self, scan: ColumnScan, walls: Lines, T_map_sensor: Floats, T_level_map: Floats, carried: Carried
    ) -> Floats | None:
        """Checks a scan aligned on its floor; returns T_map_sensor (4, 4) by level surfaces if the floor was left."""
        T_level_sensor = T_level_map @ T_map_sensor
        self._idle = not self._idle
        if self._idle and not self._suspected:
            return None
        points = _level_points(scan, T_level_sensor)
        other, doubtful = None, self._doubtful(points, T_level_sensor, T_level_map, carried)
        if doubtful:
            self.begin(T_level_map)
            staying = _carried_so(T_level_sensor, carried)
            other = self.align(scan, walls, staying).T
            staying[2, 3] = carried.height
            differs = abs(other[2, 3] - carried.height) > _LEFT[0]
            if not (differs and self._explains_more(scan, other, staying)):
                other = None
        if other is None:
            self._suspected = 0
            # surfaces first seen while the floor seems to sink would be stored too low
            if np.linalg.norm(T_map_sensor[:3, 3] - self._mapped) >= (_PATIENCE if doubtful else _SPACING):
                self._grow(self._unknown(points, T_level_map), T_map_sensor, T_level_map)
            return None
        self._suspected += 1
        if self._suspected < _LEFT[1]:
            return None
        self.active, self._suspected, self._way, self._known = True, 0, [], None
        return np.asarray(inverse(T_level_map) @ other)

    def _explains_more(self, scan: ColumnScan, pose: Floats, than: Floats) -> bool:
        """Whether more of a scan's level points lie on known surfaces at one T_level_sensor (4, 4) than at another."""
        tree, known = self._space
        counts = []
        for T in (pose, than):
            points = _level_points(scan, T)
            distance, nearest = tree.query(points, distance_upper_bound=_NEAR[0])
            found = np.isfinite(distance)
            counts.append(int(np.sum(np.abs(points[found, 2] - known[nearest[found], 2]) < _ON_SURFACE)))
        return counts[0] >= max(_LEAST, counts[1] + 1)

    def _doubtful(self, points: Floats, T_level_sensor: Floats, T_level_map: Floats, carried: Carried) -> bool:
        lean = T_level_sensor[:3, :3] @ carried.up_in_sensor
        if np.hypot(lean[0], lean[1]) > _DOUBTFUL[0] or abs(T_level_sensor[2, 3] - carried.height) > _DOUBTFUL[1]:
            return True
        sunk = self._sunk(points, T_level_map)
        return sunk is not None and abs(sunk) > _DOUBTFUL[2]

    def _sunk(self, points: Floats, T_level_map: Floats) -> float | None:
        """Rise (m) of level points (N, 3), level frame, over those stored; None for too few or inconsistent ones."""
        if not self._window or len(points) < _LEAST:
            return None
        known = self._plan(T_level_map)
        nearest = nearest_in_plan(points, known, _BESIDE)
        found = np.flatnonzero(nearest >= 0)
        off = points[found, 2] - known[nearest[found], 2]
        off = off[np.abs(off) < _MOST]
        if len(off) < _LEAST:
            return None
        sunk = float(np.median(off))
        return sunk if np.mean(np.abs(off - sunk) < _ALIKE[0]) > _ALIKE[1] else None

    def _unknown(self, points: Floats, T_level_map: Floats) -> Floats:
        """The points without a stored one beside them: first heights are kept, so that a slow rise adds up."""
        if not self._window or not len(points):
            return points
        return points[nearest_in_plan(points, self._plan(T_level_map), _BESIDE) < 0]

    def _plan(self, T_level_map: Floats) -> Floats:
        if self._known is None:
            self._known = transform_points(T_level_map, np.concatenate(self._window))
        return self._known

    def _grow(self, points: Floats, T_map_sensor: Floats, T_level_map: Floats) -> None:
        if np.linalg.norm(T_map_sensor[:3, 3] - self._mapped) < _SPACING or not len(points):
            return
        self._window = [*self._window, transform_points(inverse(T_level_map), points)][-_KEPT:]
        self._mapped, self._known = T_map_sensor[:3, 3].copy(), None

    def align(self, scan: ColumnScan, walls: Lines, predicted: Floats) -> Tracked:
        """Aligns a scan with the walls, extended upward, and the stored level surfaces.

        `predicted` (4, 4) is T_level_sensor. Gauss-Newton as in `alignment.track`.
        """
        settings = self._settings
        upright = scan.points.take(chosen(scan.upright, 3 * settings.points), axis=0)
        walls = walls.visible_from(predicted[:2, 3], min(settings.reach, _WALLS_REACH))
        level = scan.points[scan.level]
        level = level[np.linalg.norm(level, axis=1) < _REACH]
        tree, known = self._space
        T, share, information = predicted.copy(), 0.0, np.zeros((3, 3))
        for gate, near in zip((*settings.gates, settings.gates[-1]), _NEAR, strict=True):
            H, g = np.zeros((6, 6)), np.zeros(6)
            if len(walls.ids) and len(upright):
                pull = to_walls(upright, T, walls, gate, settings)
                H, g, share = pull.H, pull.g, pull.found / len(upright)
            J, off = _to_level(level @ T[:3, :3].T, T[:3, 3], tree, known, near, _RISE if self.active else near)
            weighted = J * np.minimum(1.0, settings.huber / np.maximum(np.abs(off), 1e-9))[:, None]
            H, g = (H + weighted.T @ J) / settings.sigma_point**2, (g + weighted.T @ off) / settings.sigma_point**2
            information = H[2:5, 2:5] * settings.sigma_point**2
            H[[0, 1], [0, 1]] += 1 / _TILT**2
            g[:2] += np.array([-T[1, 2], T[0, 2]]) / _TILT**2
            moved_by(T, predicted, H, g, settings.sigma_rotation, settings.sigma_translation)
        return Tracked(T, share, information)

    @staticmethod
    def possible(T_map_sensor: Floats, last_map: Floats, up_in_map: Floats) -> Floats:
        """T_map_sensor (4, 4) with its rise or fall since `last_map` (4, 4) limited to the slope of a stair."""
        way = T_map_sensor[:3, 3] - last_map[:3, 3]
        rise = float(up_in_map @ way)
        most = _STEEPEST * float(np.linalg.norm(way - rise * up_in_map)) + _SWAY
        result = T_map_sensor.copy()
        result[:3, 3] += (np.clip(rise, -most, most) - rise) * up_in_map
        return result

    def begin(self, T_level_map: Floats) -> None:
        """Prepares the search structure for `align`."""
        known = transform_points(T_level_map, np.concatenate([np.empty((0, 3)), *self._window]))
        self._space = cKDTree(known), known

    def follow(
        self, scan: ColumnScan, T_map_sensor: Floats, T_level_map: Floats, height: float, floors: Floors
    ) -> Arrival | None:
        """Records an aligned scan between two floors; returns the arrival, if any.

        `height` (m) is the sensor's above the ground.
        """
        T_level_sensor = T_level_map @ T_map_sensor
        self._grow(_level_points(scan, T_level_sensor), T_map_sensor, T_level_map)
        here = np.array([*T_level_sensor[:2, 3], T_level_sensor[2, 3] - height])
        self._way.append(here)
        way = np.stack(self._way)
        uneven = np.flatnonzero(np.abs(way[:, 2] - here[2]) > _FLAT)
        since = way[uneven[-1] + 1 :] if len(uneven) else way
        gone = float(np.linalg.norm(since[:, :2] - here[:2], axis=1).max())
        if gone < _HOME_WAY:
            return None
        ground = float(np.median(since[:, 2]))
        known = {floor.number: _height_of(floor, T_level_map) for floor in floors.maps}
        nearest = min(known, key=lambda number: abs(known[number] - ground))
        above = ground - known[nearest]
        if abs(above) < _HOME + _DRIFT[0] * max(0.0, float(np.ptp(way[:, 2])) - _DRIFT[1]):
            return Arrival(floors.maps[nearest], 0.0, above)
        if gone < _LEVEL_WAY:
            return None
        return Arrival(None, ground) if abs(above) > _STOREY else Arrival(floors.maps[nearest], above)

    def end(self, arrival: Arrival) -> None:
        """Ends the transition: the robot is on level ground again."""
        self.active, self.ground, self._way = False, 0.0 if arrival.floor is None else arrival.height, []
        if arrival.drift:  # the level surfaces seen on the stair have drifted too
            self._window, self._mapped, self._known = [], np.full(3, np.inf), None


@compiled
def nearest_in_plan(points: Floats, known: Floats, reach: float) -> NDArray[np.int64]:
    """(N,) the index of the known point (M, 3) nearest in plan to each point (N, 3), N >= 1; -1 for none within reach.

    Uses a grid of cells of that size.
    """
    x0, y0 = points[:, 0].min() - reach, points[:, 1].min() - reach
    columns, rows = int((points[:, 0].max() - x0) / reach) + 2, int((points[:, 1].max() - y0) / reach) + 2
    newest, before = np.full((columns, rows), -1), np.full(len(known), -1)  # of each cell; in the cell
    for k in range(len(known)):
        i, j = math.floor((known[k, 0] - x0) / reach), math.floor((known[k, 1] - y0) / reach)
        if 0 <= i < columns and 0 <= j < rows:
            before[k], newest[i, j] = newest[i, j], k
    nearest = np.full(len(points), -1)
    for n in range(len(points)):
        i, j = int((points[n, 0] - x0) / reach), int((points[n, 1] - y0) / reach)
        least = reach**2
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                k = newest[a, b]
                while k >= 0:
                    squared = (points[n, 0] - known[k, 0]) ** 2 + (points[n, 1] - known[k, 1]) ** 2
                    if squared < least:
                        least, nearest[n] = squared, k
                    k = before[k]
    return nearest


def _height_of(floor: FloorMap, T_level_map: Floats) -> float:
    """Height (m) of a floor above that of `T_level_map` (4, 4); all floors are parallel."""
    return float(T_level_map[2, 3] - floor.walls.T_level_map[2, 3])


def _level_points(scan: ColumnScan, T_level_sensor: Floats) -> Floats:
    """(N, 3) the points of a scan on level surfaces below the sensor, level frame."""
    points = scan.points[scan.level]
    points = points[(points[:, 2] < 0.0) & (np.linalg.norm(points, axis=1) < _REACH)]
    return transform_points(T_level_sensor, points)


def _carried_so(T_level_sensor: Floats, carried: Carried) -> Floats:
    """The pose (4, 4) with the recent lean of the sensor instead of its own."""
    T = T_level_sensor.copy()
    T[:3, :3] = levelling(T[:3, :3] @ carried.up_in_sensor) @ T[:3, :3]
    return T


def _to_level(
    turned: Floats, place: Floats, tree: cKDTree, known: Floats, near: float, rise: float
) -> tuple[Floats, Floats]:
    """Jacobian (M, 6) and heights (M,) over a known point, of the level points (N, 3) that are near one.

    Points are relative to the sensor at `place` (3,), in level axes; the Jacobian is by its rotation and translation.
    """
    if not len(known) or not len(turned):
        return np.empty((0, 6)), np.empty(0)
    distance, nearest = tree.query(turned + place, distance_upper_bound=near)
    found = np.flatnonzero(np.isfinite(distance))
    off = turned[found, 2] + place[2] - known[nearest[found], 2]
    found, off = found[np.abs(off) < rise], off[np.abs(off) < rise]
    J = np.zeros((len(found), 6))
    J[:, 0], J[:, 1], J[:, 5] = turned[found, 1], -turned[found, 0], 1.0
    return J, off
