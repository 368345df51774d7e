"""Each scan against the walls and the floor that are known already: KISS-ICP drags along its own scan rings indoors
(centimetres a scan) and leans; upright walls and a level floor do not."""

from dataclasses import dataclass, field

import gtsam
import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.virtual_scan import ColumnScan
from sgslam.wall_map import Lines

Floats = NDArray[np.float64]
_BESIDE = 0.2  # m beyond a wall's end at which a point may still be of it
_SAME = 0.97  # of the points; where so many lie within the last gate, it is as if it had been used
_FLOOR_GATE = 0.12  # m; seats and steps are level too, and not much higher than the floor


@dataclass(frozen=True)
class Tracked:
    """`T` (4, 4) of the sensor in the levelled map; `share` of the upright points that lie on walls; `information`
    (3, 3): the normal equations of yaw, x and y in level axes, a point on a wall across a direction counting one."""

    T: Floats
    share: float
    information: Floats = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def held(self) -> float:
        """How many points' worth of walls hold the horizontal direction that is held worst, the turn being free."""
        return _held(self.information)


@dataclass(frozen=True)
class Carried:
    """How the sensor is carried: its height above the floor, and (3,) the vertical in its frame."""

    height: float
    up_in_sensor: Floats

    def followed_by(self, T_level_sensor: Floats, share: float) -> "Carried":
        """The same after one more pose; the vertical follows by `share`."""
        up = (1 - share) * self.up_in_sensor + share * T_level_sensor[2, :3]
        return Carried(self.height, up / np.linalg.norm(up))


def track(
    scan: ColumnScan, walls: Lines, predicted: Floats, carried: Carried, bands: tuple[float, float],
    settings: TrackingSettings,
) -> Tracked:  # fmt: skip
    """Moves a scan (sensor frame) onto the walls and the floor z = 0 of the levelled map, from a predicted pose.

    Point-to-plane Gauss-Newton with Huber weights over all six degrees of freedom. The prediction is a measurement
    too, so that a direction that no wall gives (along a bare corridor) keeps the odometry's word; so is, weakly, how
    the sensor has been `carried` so far. Points between the heights `bands` above the floor stand for walls.
    """
    upright = scan.points[spread(np.flatnonzero(scan.upright), 2 * settings.points)]
    z = upright @ predicted[2, :3] + predicted[2, 3]
    upright = upright[(z > bands[0]) & (z < bands[1])]
    level = scan.points[spread(np.flatnonzero(scan.level), settings.points)]
    walls = walls.visible_from(predicted[:2, 3], settings.reach)
    if not len(walls.ids) or len(upright) < 20:
        return Tracked(predicted, 0.0)
    T, share, information = predicted.copy(), 0.0, np.zeros((3, 3))
    prior = np.diag([1 / settings.sigma_rotation**2] * 3 + [1 / settings.sigma_translation**2] * 3)
    for gate in settings.gates:
        p, q = upright @ T[:3, :3].T, level @ T[:3, :3].T
        of_walls, off_walls, near = to_walls(p, T[:2, 3], walls, gate)
        share = len(off_walls) / len(p)
        if len(off_walls) < 10:
            break
        of_floor, off_floor = _to_floor(q, T[2, 3], min(gate, _FLOOR_GATE))
        J, off = np.concatenate([of_walls, of_floor]), np.concatenate([off_walls, off_floor])
        weight = np.minimum(1.0, settings.huber / np.maximum(np.abs(off), 1e-9)) / settings.sigma_point**2
        weighted = J * weight[:, None]
        H, g = weighted.T @ J, weighted.T @ off
        information = H[2:5, 2:5] * settings.sigma_point**2
        H[5, 5] += 1 / settings.sigma_height**2
        g[5] += (T[2, 3] - carried.height) / settings.sigma_height**2
        lean = T[:3, :3] @ carried.up_in_sensor  # (0, 0, 1) when carried as before; turned by w it moves by (wy, -wx)
        H[[0, 1], [0, 1]] += 1 / settings.sigma_tilt**2
        g[:2] += np.array([-lean[1], lean[0]]) / settings.sigma_tilt**2
        turned = gtsam.Rot3.Logmap(gtsam.Rot3(T[:3, :3] @ predicted[:3, :3].T))
        gone = np.concatenate([turned, T[:3, 3] - predicted[:3, 3]])
        step = -np.linalg.solve(H + prior, g + prior @ gone)
        T[:3, :3] = gtsam.Rot3.Expmap(step[:3]).matrix() @ T[:3, :3]
        T[:3, 3] += step[3:]
        within = np.count_nonzero(np.abs(off_walls) < settings.gates[-1]) / len(off_walls)
        if within > _SAME and np.abs(step).max() < settings.sure_step:
            break  # the next step would be by the same points, from where they want to be
        walls = walls.only(np.unique(near))  # a step is too short to bring others near
    return Tracked(T, share, information)


def spread(places: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """About `count` of the places, evenly over the scan."""
    return places[:: max(1, len(places) // count)]


def to_walls(turned: Floats, place: Floats, walls: Lines, gate: float) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Of points (N, 3) from the sensor at `place` (2,), map axes, those that lie within the gate of the wall nearest to
    them: the distances' derivatives (M, 6) by a turn and a move of the sensor, the distances (M,), and which wall."""
    middle, half = (walls.low + walls.high) / 2, (walls.high - walls.low) / 2
    tangents = np.stack([-walls.normal[:, 1], walls.normal[:, 0], -middle])
    xy1 = np.column_stack([turned[:, :2] + place, np.ones(len(turned))])
    across = xy1 @ np.stack([walls.normal[:, 0], walls.normal[:, 1], walls.offset])
    cost = np.where(np.abs(xy1 @ tangents) > half + _BESIDE, np.inf, np.abs(across))
    nearest = cost.argmin(axis=1)
    near = np.flatnonzero(cost[np.arange(len(cost)), nearest] < gate)
    off = across[near, nearest[near]]
    (nx, ny), (x, y, z) = walls.normal[nearest[near]].T, turned[near].T
    J = np.stack([-z * ny, z * nx, x * ny - y * nx, nx, ny, np.zeros(len(off))], axis=1)
    return J, off, nearest[near]


def _to_floor(turned: Floats, height: float, gate: float) -> tuple[Floats, Floats]:
    """The same of points (N, 3) from the sensor at `height` and the floor z = 0."""
    off = turned[:, 2] + height
    near = np.abs(off) < gate
    J = np.zeros((int(near.sum()), 6))
    J[:, 0], J[:, 1], J[:, 5] = turned[near, 1], -turned[near, 0], 1.0
    return J, off[near]


def _held(H: Floats) -> float:
    """Of normal equations (3, 3) of yaw, x and y, what they tell of the direction that they tell least of."""
    a, b, c = H[1, 1], H[1, 2], H[2, 2]
    if H[0, 0] > 0:  # the turn about the vertical is not known
        a, b, c = a - H[0, 1] ** 2 / H[0, 0], b - H[0, 1] * H[0, 2] / H[0, 0], c - H[0, 2] ** 2 / H[0, 0]
    return float((a + c) / 2 - np.hypot((a - c) / 2, b))
