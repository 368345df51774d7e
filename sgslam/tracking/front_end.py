"""The front end: extracts walls and floor from the scans of keyframes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.geometry.frames import levelling, transform_planes, transform_points
from sgslam.perception import (
    ColumnScan,
    FloorObservation,
    WallObservation,
    extract_floor,
    extract_walls,
    sort_into_columns,
)
from sgslam.perception.column_scan import contour
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]


@dataclass(frozen=True)
class KeyframeScan:
    """The observations in a keyframe's scan. Planes (4,) and points (.., 3) are in the sensor frame."""

    walls: list[tuple[WallObservation, Floats, Floats]]  # the observation, its plane, its ends (2, 3)
    floor: FloorObservation | None
    contour: Floats32  # (M, 3) one upright point of the high band for each column
    lintels: Floats32  # (L, 3) upright points at the height of lintels


def level_to_sensor(T_map_sensor: Floats, up_in_map: Floats) -> Floats:
    """(3, 3) R_level_sensor, which turns the sensor's z axis up and keeps the heading."""
    return levelling(T_map_sensor[:3, :3].T @ up_in_map)


class FrontEnd(Stateful):
    """Extracts observations, and estimates the sensor's height above the floor."""

    _STATE = ("sensor_height",)

    def __init__(self, config: Config) -> None:
        self._config = config
        self.sensor_height: float | None = None

    @property
    def height(self) -> float:
        """The sensor's height (m) above the floor; a default until the floor has been observed."""
        return self.sensor_height if self.sensor_height is not None else self._config.surfaces.guessed_height

    def look(self, points: Floats, R_level_sensor: Floats, height: float | None) -> KeyframeScan:
        """Extracts walls and floor of a keyframe's scan (N, 3); `height` (m) of the sensor above the floor, or None."""
        settings = self._config.surfaces
        scan = sort_into_columns(points @ R_level_sensor.T, settings.columns)
        T_sensor_level = np.eye(4)
        T_sensor_level[:3, :3] = R_level_sensor.T
        floor = self._floor(scan, T_sensor_level, height)
        if height is None:
            height = self.height
        raised = scan.points + np.array([0.0, 0.0, height])
        above = ColumnScan(raised, scan.column, scan.columns, scan.upright, scan.level)
        T_sensor_above = T_sensor_level.copy()
        T_sensor_above[:3, 3] = -R_level_sensor.T[:, 2] * height
        high_contour = contour(above, settings.high_band)
        walls = _in_frame(T_sensor_above, extract_walls(above, high_contour, settings))
        xy = high_contour[1]
        outline = (np.column_stack([xy, np.zeros(len(xy))]) @ R_level_sensor).astype(np.float32)
        low, high = self._config.rooms.lintel_band
        z = above.points[:, 2]
        lintels = (scan.points[above.upright & (z > low) & (z < high)] @ R_level_sensor).astype(np.float32)
        return KeyframeScan(walls, floor, outline, lintels)

    def _floor(self, scan: ColumnScan, T_sensor_level: Floats, height: float | None) -> FloorObservation | None:
        expected = -height if height is not None else None
        floor = extract_floor(scan.points[scan.level], expected)
        if floor is None:
            return None
        seen = float(floor.plane[3])
        self.sensor_height = seen if self.sensor_height is None else 0.9 * self.sensor_height + 0.1 * seen
        plane = transform_planes(T_sensor_level, floor.plane)
        return FloorObservation(plane, floor.sigma_normal, floor.sigma_offset, floor.points)


def _in_frame(T_a_b: Floats, found: list[WallObservation]) -> list[tuple[WallObservation, Floats, Floats]]:
    """Observations in frame b, each with its plane (4,) and ends (2, 3) in frame a."""
    if not found:
        return []
    planes = transform_planes(T_a_b, np.stack([o.plane for o in found]))
    heights = np.array([o.heights for o in found]).mean(axis=1)
    ends = np.empty((len(found), 2, 3))
    ends[..., :2], ends[..., 2] = [o.ends for o in found], heights[:, None]
    return list(zip(found, planes, transform_points(T_a_b, ends), strict=True))
