"""What is seen from a keyframe: walls of its scan, and level surfaces of the scans since the keyframe before."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.geometry.frames import levelling, transform_planes, transform_points
from sgslam.perception.column_scan import ColumnScan, contour, sort_into_columns
from sgslam.perception.gravity import refined_up
from sgslam.perception.level_extraction import INLIER, LevelObservation, extract_levels
from sgslam.perception.wall_extraction import WallObservation, extract_walls

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Surfels = tuple[Floats, Floats, Floats]  # means (N, 3), normals (N, 3) and numbers of points (N,)
_TRACKED = np.radians(1.0)  # rad, standard deviation of the tracked vertical: among people a hand-held one tilts by 3


@dataclass(frozen=True)
class KeyframeScan:
    """What is seen from a keyframe, in the sensor frame: planes (4,), points (.., 3), and the vertical `up` (3,) with a
    standard deviation `sigma_up` (rad), infinite where the surfaces do not show it."""

    walls: list[WallObservation]
    levels: list[LevelObservation]
    contour: Floats32  # (M, 3) one upright point of the high band for each column
    lintels: Floats32  # (L, 3) upright points at the height of lintels
    up: Floats
    sigma_up: float


def keyframe_scan(
    points: Floats, surfels: Surfels, T_odom_sensor: Floats, up: Floats, height: float, config: Config
) -> KeyframeScan:
    """Extracts walls from a keyframe's scan (N, 3), and level surfaces from the `surfels`, in `odom`, of all scans
    since the last keyframe.

    `up` (3,) is the tracked vertical in the sensor frame, which the surfaces correct, and `height` (m) the sensor's
    above the ground.
    """
    seen_up, sigma_up = up, np.inf
    if (found := refined_up(T_odom_sensor[:3, :3] @ up, *surfels[1:])) is not None:
        seen_up, sigma_up = T_odom_sensor[:3, :3].T @ found[0], found[1]
    mean = up / _TRACKED**2 + seen_up / sigma_up**2
    R_level_sensor = levelling(mean / np.linalg.norm(mean))
    levels = _levels(surfels, T_odom_sensor, R_level_sensor)
    settings = config.surfaces
    scan = sort_into_columns(points @ R_level_sensor.T, settings.columns)
    T_sensor_above = np.eye(4)
    T_sensor_above[:3, :3] = R_level_sensor.T
    T_sensor_above[:3, 3] = -R_level_sensor.T[:, 2] * height
    above = ColumnScan(scan.points + np.array([0.0, 0.0, height]), scan.column, scan.columns, scan.upright)
    high_contour = contour(above, settings.high_band)
    walls = _in_frame(T_sensor_above, extract_walls(above, high_contour, settings))
    xy = high_contour[1]
    outline = (np.column_stack([xy, np.zeros(len(xy))]) @ R_level_sensor).astype(np.float32)
    low, high = config.rooms.lintel_band
    z = above.points[:, 2]
    lintels = _off_levels(scan.points[above.upright & (z > low) & (z < high)] @ R_level_sensor, levels)
    return KeyframeScan(walls, levels, outline, lintels.astype(np.float32), seen_up, sigma_up)


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
    return points[(np.abs(points @ planes[:, :3].T + planes[:, 3]) > 2 * INLIER).all(axis=1)]


def _in_frame(T_a_b: Floats, found: list[WallObservation]) -> list[WallObservation]:
    """Observations in the levelled frame b, in frame a."""
    if not found:
        return []
    planes = transform_planes(T_a_b, np.stack([o.plane for o in found]))
    heights = np.array([o.heights for o in found]).mean(axis=1)
    ends = np.empty((len(found), 2, 3))
    ends[..., :2], ends[..., 2] = [o.ends for o in found], heights[:, None]
    moved = zip(found, planes, transform_points(T_a_b, ends), strict=True)
    return [replace(own, plane=plane, ends=ends) for own, plane, ends in moved]
