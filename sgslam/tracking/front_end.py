"""The front end: extracts walls from the scans of keyframes, and level surfaces from the scans between them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.geometry.frames import levelling, transform_planes, transform_points
from sgslam.perception import (
    ColumnScan,
    LevelObservation,
    WallObservation,
    extract_levels,
    extract_walls,
    sort_into_columns,
)
from sgslam.perception.column_scan import contour
from sgslam.serialization import Stateful
from sgslam.surfels import SurfelMap
from sgslam.tracking.gravity import refined_up
from sgslam.tracking.level_frame import add_scan

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Surfels = tuple[Floats, Floats, Floats]  # means (N, 3), normals (N, 3) and numbers of points (N,)
_TRACKED = np.radians(1.0)  # rad, standard deviation of the tracked vertical: among people a hand-held one tilts by 3
_THICK = 0.1  # m, three standard deviations of the noise of points beside a level surface that they lie on
_SPACING = 0.15  # m between the points of a scan in which level surfaces are looked for


@dataclass(frozen=True)
class KeyframeScan:
    """What is seen from a keyframe, in the sensor frame: planes (4,), points (.., 3), and the vertical `up` (3,) with a
    standard deviation `sigma_up` (rad), infinite where the surfaces do not show it."""

    walls: list[tuple[WallObservation, Floats, Floats]]  # the observation, its plane, its ends (2, 3)
    levels: list[LevelObservation]
    contour: Floats32  # (M, 3) one upright point of the high band for each column
    lintels: Floats32  # (L, 3) upright points at the height of lintels
    up: Floats
    sigma_up: float


def level_to_sensor(T_map_sensor: Floats, up_in_map: Floats) -> Floats:
    """(3, 3) R_level_sensor, which turns the sensor's z axis up and keeps the heading."""
    return levelling(T_map_sensor[:3, :3].T @ up_in_map)


class FrontEnd(Stateful):
    """Extracts observations. `height` (m) is the sensor's above the floor; a guess until that was seen."""

    _STATE = ("height",)

    def __init__(self, config: Config) -> None:
        self._config = config
        self.height = config.surfaces.guessed_height
        self._surfels = SurfelMap()  # of the scans since the last keyframe, in `odom`

    def add(self, points: Floats, T_odom_sensor: Floats) -> None:
        """Adds a scan with points (N, 3) as at its pose (4, 4), for the next keyframe."""
        add_scan(self._surfels, points, T_odom_sensor, _SPACING, self._config.tracking)

    def forget(self) -> None:
        """Forgets the scans since the last keyframe: they show no floor, but stairs."""
        self._surfels.clear()

    def look(self, points: Floats, T_odom_sensor: Floats, R_level_sensor: Floats, height: float) -> KeyframeScan:
        """Extracts walls from a keyframe's scan (N, 3), and level surfaces from all scans since the last keyframe.

        `R_level_sensor` (3, 3) is the tracked attitude, which the surfaces correct, and `height` (m) the sensor's above
        the ground.
        """
        surfels = self._surfels.surfels()
        self._surfels.clear()
        up, sigma_up = self._upright(surfels, T_odom_sensor, R_level_sensor)
        R_level_sensor = levelling(_mean(R_level_sensor[2], _TRACKED, up, sigma_up))
        levels = _levels(surfels, T_odom_sensor, R_level_sensor)
        settings = self._config.surfaces
        scan = sort_into_columns(points @ R_level_sensor.T, settings.columns)
        T_sensor_level = np.eye(4)
        T_sensor_level[:3, :3] = R_level_sensor.T
        raised = scan.points + np.array([0.0, 0.0, height])
        above = ColumnScan(raised, scan.column, scan.columns, scan.upright)
        T_sensor_above = T_sensor_level.copy()
        T_sensor_above[:3, 3] = -R_level_sensor.T[:, 2] * height
        high_contour = contour(above, settings.high_band)
        walls = _in_frame(T_sensor_above, extract_walls(above, high_contour, settings))
        xy = high_contour[1]
        outline = (np.column_stack([xy, np.zeros(len(xy))]) @ R_level_sensor).astype(np.float32)
        low, high = self._config.rooms.lintel_band
        z = above.points[:, 2]
        lintels = _off_levels(scan.points[above.upright & (z > low) & (z < high)] @ R_level_sensor, levels)
        return KeyframeScan(walls, levels, outline, lintels.astype(np.float32), up, sigma_up)

    @staticmethod
    def _upright(surfels: Surfels, T_odom_sensor: Floats, R_level_sensor: Floats) -> tuple[Floats, float]:
        """The vertical (3,) in the sensor frame and its standard deviation (rad), as the surfels show them."""
        R_odom_sensor, tracked = T_odom_sensor[:3, :3], R_level_sensor[2]
        found = refined_up(R_odom_sensor @ tracked, *surfels[1:])
        return (tracked, np.inf) if found is None else (R_odom_sensor.T @ found[0], found[1])

    def state(self) -> dict[str, Any]:
        """See `Stateful`; with the surfaces since the last keyframe."""
        return {**super().state(), "surfels": self._surfels.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self._surfels.restore(state["surfels"])


def _levels(surfels: Surfels, T_odom_sensor: Floats, R_level_sensor: Floats) -> list[LevelObservation]:
    """The level surfaces among surfels in `odom`, in the sensor frame."""
    means, normals, counts = surfels
    T_level_odom = np.eye(4)
    T_level_odom[:3, :3] = R_level_sensor @ T_odom_sensor[:3, :3].T
    R = T_level_odom[:3, :3]
    return extract_levels(means @ R.T, normals @ R.T, counts, T_level_odom @ T_odom_sensor)


def _off_levels(points: Floats, levels: list[LevelObservation]) -> Floats:
    """Those of the points (N, 3) that lie on no level surface. Noise makes some of a ceiling's points look upright."""
    if not levels:
        return points
    planes = np.stack([level.plane for level in levels])
    return points[(np.abs(points @ planes[:, :3].T + planes[:, 3]) > _THICK).all(axis=1)]


def _mean(a: Floats, sigma_a: float, b: Floats, sigma_b: float) -> Floats:
    """(3,) the mean of two unit vectors with standard deviations (rad), a unit vector."""
    mean = a / sigma_a**2 + b / sigma_b**2
    return np.asarray(mean / np.linalg.norm(mean))


def _in_frame(T_a_b: Floats, found: list[WallObservation]) -> list[tuple[WallObservation, Floats, Floats]]:
    """Observations in frame b, each with its plane (4,) and ends (2, 3) in frame a."""
    if not found:
        return []
    planes = transform_planes(T_a_b, np.stack([o.plane for o in found]))
    heights = np.array([o.heights for o in found]).mean(axis=1)
    ends = np.empty((len(found), 2, 3))
    ends[..., :2], ends[..., 2] = [o.ends for o in found], heights[:, None]
    return list(zip(found, planes, transform_points(T_a_b, ends), strict=True))
