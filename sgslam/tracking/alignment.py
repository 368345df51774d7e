"""Aligns each scan with the mapped walls and floor, by point-to-plane Gauss-Newton.

Indoors KISS-ICP drags along its own scan rings, by centimetres a scan, and tilts. Upright walls and a level floor
prevent both.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.config import TrackingSettings
from sgslam.geometry.normal_equations import add_row, solved
from sgslam.mapping import Lines
from sgslam.perception import ColumnScan

Floats = NDArray[np.float64]
_BESIDE = 0.2  # m beyond a wall's end at which a point may still belong to it
_SAME = 0.97  # share of the points within the last gate, from which on another step with it adds nothing
_FLOOR_GATE = 0.12  # m; seats and steps are level too, and only a little higher than the floor


@dataclass(frozen=True)
class Tracked:
    """The pose `T` (4, 4) of the sensor in the levelled map, and the `share` of upright points that lie on walls.

    `information` (3, 3) is that of yaw, x and y in level axes; a point counts one across its wall.
    """

    T: Floats
    share: float
    information: Floats = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def held(self) -> float:
        """The number of points that constrain the weakest horizontal direction, yaw marginalised."""
        return _held(self.information)


@dataclass(frozen=True)
class Carried:
    """How the sensor is carried: its height above the floor, and (3,) the vertical in its frame."""

    height: float
    up_in_sensor: Floats

    def followed_by(self, T_level_sensor: Floats, share: float) -> "Carried":
        """Updated by one more pose: the vertical moves by `share` towards that of the pose."""
        up = (1 - share) * self.up_in_sensor + share * T_level_sensor[2, :3]
        return Carried(self.height, up / np.linalg.norm(up))


def track(
    scan: ColumnScan, walls: Lines, predicted: Floats, carried: Carried, bands: tuple[float, float],
    settings: TrackingSettings,
) -> Tracked:  # fmt: skip
    """Aligns a scan (sensor frame) with the walls and the floor z = 0 of the levelled map, from a pose (4, 4).

    Point-to-plane Gauss-Newton with Huber weights over all six degrees of freedom. The prediction is a measurement too,
    so that it decides in directions without walls, such as along a bare corridor. So is, weakly, how the sensor is
    `carried`. Points between the heights `bands` (m) above the floor are used for walls.
    """
    upright = scan.points.take(chosen(scan.upright, 2 * settings.points), axis=0)
    z = upright @ predicted[2, :3] + predicted[2, 3]
    upright = upright[(z > bands[0]) & (z < bands[1])]
    walls = walls.visible_from(predicted[:2, 3], settings.reach)
    if not len(walls.ids) or len(upright) < 20:
        return Tracked(predicted, 0.0)
    level = scan.points.take(chosen(scan.level, settings.points), axis=0)
    weights = _Weights(*(getattr(settings, name) for name in _Weights._fields))
    T, share, information = _tracked(
        upright, level, predicted, carried.height, carried.up_in_sensor,
        walls.normal, walls.offset, walls.low, walls.high, np.array(settings.gates), weights,
    )  # fmt: skip
    return Tracked(T, share, information)


class _Weights(NamedTuple):
    """The part of `TrackingSettings` that a Gauss-Newton step needs."""

    sigma_point: float
    huber: float
    sigma_height: float
    sigma_tilt: float
    sigma_translation: float
    sigma_rotation: float
    sure_step: float


@compiled
def _tracked(
    upright: Floats, level: Floats, predicted: Floats, height: float, up_in_sensor: Floats,
    normal: Floats, offset: Floats, low: Floats, high: Floats, gates: Floats, weights: _Weights,
) -> tuple[Floats, float, Floats]:  # fmt: skip
    T, share, information = predicted.copy(), 0.0, np.zeros((3, 3))
    for gate in gates:
        H, g, found, close, used = _to_walls(upright, T, normal, offset, low, high, gate, gates[-1], weights.huber)
        share = found / len(upright)
        if found < 10:
            break
        information = H[2:5, 2:5].copy()
        _to_floor(level, T, min(gate, _FLOOR_GATE), weights.huber, H, g)
        for i in range(6):
            g[i] /= weights.sigma_point**2
            for j in range(6):
                H[i, j] /= weights.sigma_point**2
        H[5, 5] += 1 / weights.sigma_height**2
        g[5] += (T[2, 3] - height) / weights.sigma_height**2
        # (0, 0, 1) when carried as before; a rotation w changes it by (wy, -wx)
        lean_x, lean_y, _ = _turned(up_in_sensor, T)
        H[0, 0] += 1 / weights.sigma_tilt**2
        H[1, 1] += 1 / weights.sigma_tilt**2
        g[0] -= lean_y / weights.sigma_tilt**2
        g[1] += lean_x / weights.sigma_tilt**2
        step = moved_by(T, predicted, H, g, weights.sigma_rotation, weights.sigma_translation)
        furthest = 0.0
        for part in step:
            furthest = max(furthest, abs(part))
        if close > _SAME * found and furthest < weights.sure_step:
            break  # the next step would use the same points and be zero
        normal, offset, low, high = normal[used], offset[used], low[used], high[used]  # no step brings others near
    return T, share, information


@compiled
def moved_by(
    T: Floats, predicted: Floats, H: Floats, g: Floats, sigma_rotation: float, sigma_translation: float
) -> Floats:
    """Moves T (4, 4) in place by the solution of normal equations H (6, 6), g (6,); returns the step (6,).

    The prediction is first added to the equations, in place, with its sigmas (rad, m). Rotation first, map axes.
    """
    D, gone = np.empty((3, 3)), np.empty(6)  # rotation since the prediction; rotation vector and translation
    for i in range(3):
        for j in range(3):
            D[i, j] = T[i, 0] * predicted[j, 0] + T[i, 1] * predicted[j, 1] + T[i, 2] * predicted[j, 2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        gone[i], gone[3 + i] = (D[k, j] - D[j, k]) / 2, T[i, 3] - predicted[i, 3]
    sine = math.sqrt(gone[0] ** 2 + gone[1] ** 2 + gone[2] ** 2)
    scale = math.atan2(sine, (D[0, 0] + D[1, 1] + D[2, 2] - 1) / 2) / sine if sine > 1e-9 else 1.0
    for i in range(6):
        gone[i] *= scale if i < 3 else 1.0
        precision = 1 / (sigma_rotation if i < 3 else sigma_translation) ** 2
        H[i, i] += precision
        g[i] += precision * gone[i]
    step = solved(H, g)
    for i in range(6):
        step[i] = -step[i]
    # Rodrigues' formula: each column c of the rotation becomes c cos + (w x c) sin + w (w . c) (1 - cos)
    angle = max(math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2), 1e-12)
    wx, wy, wz = step[0] / angle, step[1] / angle, step[2] / angle
    c, s = math.cos(angle), math.sin(angle)
    for j in range(3):
        x, y, z = T[0, j], T[1, j], T[2, j]
        along = (wx * x + wy * y + wz * z) * (1 - c)
        T[0, j] = x * c + (wy * z - wz * y) * s + wx * along
        T[1, j] = y * c + (wz * x - wx * z) * s + wy * along
        T[2, j] = z * c + (wx * y - wy * x) * s + wz * along
        T[j, 3] += step[3 + j]
    return np.asarray(step)


@compiled
def chosen(flags: NDArray[np.bool_], count: int) -> NDArray[np.int64]:
    """The indices of about `count` of the flags that are set, evenly spread over the scan."""
    places = np.flatnonzero(flags)
    return places[:: max(1, len(places) // count)].copy()


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations H (6, 6), g (6,) of a rotation and a translation of the sensor in map axes.

    Each point counts one times its Huber weight. `found` points lie on a wall, `close` of them within the last gate.
    """

    H: Floats
    g: Floats
    found: int
    close: int


def to_walls(points: Floats, T: Floats, walls: Lines, gate: float, settings: TrackingSettings) -> NormalEquations:
    """Normal equations of points (N, 3) of a sensor at T (4, 4) against their nearest walls within `gate` (m).

    Points are in the sensor frame; close ones are within the last gate of the settings.
    """
    lines = walls.normal, walls.offset, walls.low, walls.high
    return NormalEquations(*_to_walls(points, T, *lines, gate, settings.gates[-1], settings.huber)[:4])


@compiled
def _turned(point: Floats, T: Floats) -> tuple[float, float, float]:
    """A point (3,) rotated by T (4, 4)."""
    x, y, z = point
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z,
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z,
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z,
    )


@compiled
def _to_walls(
    points: Floats, T: Floats, normal: Floats, offset: Floats, low: Floats, high: Floats,
    gate: float, last_gate: float, huber: float,
) -> tuple[Floats, Floats, int, int, NDArray[np.bool_]]:  # fmt: skip
    """The fields of `NormalEquations`, and flags (M,) of the walls with points."""
    H, g, J = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    found, close, used = 0, 0, np.zeros(len(offset), np.bool_)
    for i in range(len(points)):
        x, y, z = _turned(points[i], T)
        wall, off = -1, gate
        for w in range(len(offset)):
            nx, ny = normal[w, 0], normal[w, 1]
            across = nx * (x + T[0, 3]) + ny * (y + T[1, 3]) + offset[w]
            along = nx * (y + T[1, 3]) - ny * (x + T[0, 3])
            if abs(across) < abs(off) and low[w] - _BESIDE <= along <= high[w] + _BESIDE:
                wall, off = w, across
        if wall < 0:
            continue
        found, used[wall] = found + 1, True
        close += abs(off) < last_gate
        nx, ny = normal[wall, 0], normal[wall, 1]
        J[0], J[1], J[2], J[3], J[4] = -z * ny, z * nx, x * ny - y * nx, nx, ny
        add_row(H, g, J, off, min(1.0, huber / max(abs(off), 1e-9)))
    return H, g, found, close, used


@compiled
def _to_floor(points: Floats, T: Floats, gate: float, huber: float, H: Floats, g: Floats) -> None:
    """Adds level points on the floor z = 0 to normal equations H (6, 6), g (6,)."""
    J = np.zeros(6)
    for i in range(len(points)):
        x, y, z = _turned(points[i], T)
        off = z + T[2, 3]
        if abs(off) < gate:
            J[0], J[1], J[5] = y, -x, 1.0
            add_row(H, g, J, off, min(1.0, huber / max(abs(off), 1e-9)))


def _held(H: Floats) -> float:
    """The information of the weakest horizontal direction in normal equations (3, 3) of yaw, x and y."""
    a, b, c = H[1, 1], H[1, 2], H[2, 2]
    if H[0, 0] > 0:  # marginalises yaw
        a, b, c = a - H[0, 1] ** 2 / H[0, 0], b - H[0, 1] * H[0, 2] / H[0, 0], c - H[0, 2] ** 2 / H[0, 0]
    return float((a + c) / 2 - np.hypot((a - c) / 2, b))
