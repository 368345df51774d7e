"""What a sensor sees of walls and rooms whose places are known."""

from collections.abc import Sequence

import numpy as np
from boxes import Array, Box, scene_of

from sgslam.geometry.frames import inverse, transform_planes, transform_points
from sgslam.perception import WallObservation


def piece(
    T_map_sensor: Array, first: tuple[float, float], last: tuple[float, float], off: float = 0.0
) -> WallObservation:
    """A wall piece between two places of the map as a sensor sees it that errs by `off` m across."""
    ends = np.array([[*first, 0.3], [*last, 0.3]])
    tangent = (ends[1] - ends[0])[:2] / np.hypot(*(ends[1] - ends[0])[:2])
    normal = np.array([-tangent[1], tangent[0], 0.0])
    if normal @ (T_map_sensor[:3, 3] - ends[0]) < 0:
        normal = -normal
    ends += off * normal
    plane = transform_planes(inverse(T_map_sensor), np.array([*normal, -normal @ ends[0]]))
    return WallObservation(plane, transform_points(inverse(T_map_sensor), ends), (0.2, 2.0), 0.01, 0.01)


def outlines(boxes: Sequence[Box], poses: Sequence[Array], noise: float = 0.0) -> list[Array]:
    """(900, 3) what level beams meet, in the sensor's frame, up to 50 m."""
    scene, rng, azimuth = scene_of(boxes), np.random.default_rng(0), np.linspace(-np.pi, np.pi, 900, endpoint=False)
    beams = np.column_stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth])
    seen = []
    for T in poses:
        ranges = np.minimum(scene.distances(T[:3, 3], beams @ T[:3, :3].T), 50.0)
        seen.append(beams * (ranges + rng.normal(0, noise, len(beams)))[:, None])
    return seen
