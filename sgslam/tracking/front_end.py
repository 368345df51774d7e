"""From a scan to where it is, and from a keyframe's scan to the walls and the floor seen in it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.geometry.frames import inverse, levelling, squared_up, transform_planes, transform_points
from sgslam.mapping.wall_map import Lines
from sgslam.perception.column_scan import ColumnScan, contour, sort_into_columns
from sgslam.perception.floor_extraction import FloorObservation, extract_floor
from sgslam.perception.wall_extraction import WallObservation, extract_walls
from sgslam.serialization.state_tree import Stateful
from sgslam.tracking.alignment import Carried, Tracked, track

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]


@dataclass(frozen=True)
class KeyframeScan:
    """What a keyframe's scan shows. Planes (4,) and points (.., 3) in the sensor frame."""

    walls: list[tuple[WallObservation, Floats, Floats]]  # the observation, its plane, its ends (2, 3)
    floor: FloorObservation | None
    contour: Floats32  # (M, 3) nearest upright thing of the high band in each column
    lintels: Floats32  # (L, 3) upright points at the height of lintels


def level_to_sensor(T_map_sensor: Floats, up_in_map: Floats) -> Floats:
    """(3, 3) R_level_sensor: turns the sensor's axes so that z is up, and leaves the heading."""
    return levelling(T_map_sensor[:3, :3].T @ up_in_map)


def align(
    scan: ColumnScan, walls: Lines, T_map_sensor: Floats, T_level_map: Floats, carried: Carried, config: Config
) -> Tracked:
    """Corrects a predicted T_map_sensor by the walls and the floor; `T` of what it returns is T_map_sensor.

    In the levelled map the floor is z = 0.
    """
    surfaces = config.surfaces
    bands = (surfaces.low_band[0], surfaces.high_band[1])
    tracked = track(scan, walls, T_level_map @ T_map_sensor, carried, bands, config.tracking)
    return replace(tracked, T=squared_up(inverse(T_level_map) @ tracked.T))


class FrontEnd(Stateful):
    """Knows the sensor's height above the floor, as far as it has been seen."""

    _STATE = ("sensor_height", "_up_in_sensor")

    def __init__(self, config: Config) -> None:
        self._config = config
        self.sensor_height: float | None = None
        self._up_in_sensor: Floats | None = None

    def carried(self) -> Carried:
        """How the sensor has been carried lately."""
        up = np.array([0.0, 0.0, 1.0]) if self._up_in_sensor is None else self._up_in_sensor
        return Carried(self.height, up)

    def follow(self, T_level_sensor: Floats) -> None:
        """Takes note of how the sensor was carried in the newest scan."""
        share = 1.0 if self._up_in_sensor is None else self._config.tracking.tilt_memory
        self._up_in_sensor = self.carried().followed_by(T_level_sensor, share).up_in_sensor

    def columns(self, points: Floats, whole: bool = False) -> ColumnScan:
        """Sorts a scan (N, 3), sensor frame; of its columns only some are kept, unless it is to be `whole`."""
        every = 1 if whole else self._config.tracking.every_column
        return sort_into_columns(points, self._config.surfaces.columns, every)

    @property
    def height(self) -> float:
        """The sensor's height above the floor; a guess until the floor has been seen."""
        return self.sensor_height if self.sensor_height is not None else self._config.surfaces.guessed_height

    def look(self, points: Floats, R_level_sensor: Floats, height: float | None) -> KeyframeScan:
        """Extracts walls and floor of a keyframe's scan (N, 3); `height` of the sensor above the floor, if known."""
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
