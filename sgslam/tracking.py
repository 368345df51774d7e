"""Each scan against the walls and the floor that are known already: KISS-ICP drags along its own scan rings indoors
(centimetres a scan) and leans; upright walls and a level floor do not."""

from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.virtual_scan import ColumnScan
from sgslam.wall_map import Lines

Floats = NDArray[np.float64]
_FLOOR_GATE = 0.12  # m; seats and steps are level too, and not much higher than the floor


@dataclass(frozen=True)
class Tracked:
    """`T` (4, 4) of the sensor in the levelled map; `share` of the upright points that lie on walls; how many points'
    worth of walls hold the horizontal direction that is `held` worst, the turn being free."""

    T: Floats
    share: float
    held: float = 0.0


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
    upright = _spread(scan.points[scan.upright], 2 * settings.points)
    z = upright @ predicted[2, :3] + predicted[2, 3]
    upright = upright[(z > bands[0]) & (z < bands[1])]
    level = _spread(scan.points[scan.level], settings.points)
    walls = walls.visible_from(predicted[:2, 3], settings.reach)
    if not len(walls.ids) or len(upright) < 20:
        return Tracked(predicted, 0.0)
    T, share, held = predicted.copy(), 0.0, 0.0
    prior = np.diag([1 / settings.sigma_rotation**2] * 3 + [1 / settings.sigma_translation**2] * 3)
    for gate in settings.gates:
        p = upright @ T[:3, :3].T
        normal, off = _nearest_walls(p + T[:3, 3], walls)
        near = np.abs(off) < gate
        share = float(near.mean())
        if near.sum() < 10:
            break
        of_walls = _rows(p[near], normal[near], off[near], settings.sigma_point, settings.huber)
        q = level @ T[:3, :3].T
        floor = q[:, 2] + T[2, 3]
        on_floor = np.abs(floor) < min(gate, _FLOOR_GATE)
        up = np.broadcast_to([0.0, 0.0, 1.0], (int(on_floor.sum()), 3))
        of_floor = _rows(q[on_floor], up, floor[on_floor], settings.sigma_point, settings.huber)
        held = _held(of_walls[0]) * settings.sigma_point**2
        H, g = of_walls[0] + of_floor[0], of_walls[1] + of_floor[1]
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
    return Tracked(T, share, held)


def _spread(points: Floats, count: int) -> Floats:
    """About `count` of the points, evenly over the scan."""
    return points[:: max(1, len(points) // count)]


def _nearest_walls(points: Floats, walls: Lines) -> tuple[Floats, Floats]:
    """For points (N, 3) of the levelled map the normal (N, 3) of the nearest wall, and the signed distance from it
    (N,), infinite where the points lie beside all walls."""
    across = walls.across(points[:, :2])
    along = walls.along(points[:, :2])
    cost = np.where((along < walls.low - 0.2) | (along > walls.high + 0.2), np.inf, np.abs(across))
    nearest = np.argmin(cost, axis=1)
    every = np.arange(len(points))
    off = np.where(np.isfinite(cost[every, nearest]), across[every, nearest], np.inf)
    return np.column_stack([walls.normal[nearest], np.zeros(len(points))]), off


def _rows(turned: Floats, normal: Floats, off: Floats, sigma: float, huber: float) -> tuple[Floats, Floats]:
    """Normal equations of point-to-plane residuals; `turned` (N, 3) are the points from the sensor, map axes."""
    x, y, z = turned.T
    nx, ny, nz = normal.T
    J = np.column_stack([y * nz - z * ny, z * nx - x * nz, x * ny - y * nx, nx, ny, nz])
    weighted = J * (np.minimum(1.0, huber / np.maximum(np.abs(off), 1e-9)) / sigma**2)[:, None]
    return weighted.T @ J, weighted.T @ off


def _held(H: Floats) -> float:
    """The information (1/m2) of normal equations (6, 6) about the horizontal direction that is known worst."""
    a, b, c = H[3, 3], H[3, 4], H[4, 4]
    if H[2, 2] > 0:  # the turn about the vertical is not known
        a, b, c = a - H[2, 3] ** 2 / H[2, 2], b - H[2, 3] * H[2, 4] / H[2, 2], c - H[2, 4] ** 2 / H[2, 2]
    return float((a + c) / 2 - np.hypot((a - c) / 2, b))
