"""Level surfaces over keyframes: which observation is of which surface, and which surface is the floor."""

import numpy as np
import pytest
from boxes import Array, pose

from sgslam.config import LevelSettings
from sgslam.geometry.frames import inverse, transform_planes, transform_points
from sgslam.mapping import LevelMap
from sgslam.mapping.level_map import Register
from sgslam.perception import LevelObservation

Level = tuple[float, bool, float]  # height in the map, whether it is a floor, area


def filled(*keyframes: list[Level], apart: float = 1.0) -> tuple[LevelMap, Array]:
    """A map of keyframes that saw surfaces; and their poses (K, 4, 4)."""
    levels, poses = LevelMap(LevelSettings(), Register()), []
    for k, surfaces in enumerate(keyframes):
        poses.append(pose(apart * k, 0.0, 0.0, 0.3 * k, 0.1, -0.1))
        levels.add(k, poses[-1], [seen(poses[-1], *surface) for surface in surfaces])
    return levels, np.stack(poses)


def seen(T: Array, height: float, is_floor: bool, area: float) -> LevelObservation:
    side = 1.0 if is_floor else -1.0
    plane = transform_planes(inverse(T), np.array([0, 0, side, -side * height]))
    side_m, cell = np.sqrt(area), 0.5  # a square about the sensor's place
    along = np.arange(cell / 2, side_m, cell) - side_m / 2
    x, y = np.meshgrid(T[0, 3] + along, T[1, 3] + along)
    places = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
    return LevelObservation(plane, transform_points(inverse(T), places), is_floor, 0.001, 0.003)


def test_a_floor_goes_on_through_doors_and_a_step_or_another_rooms_ceiling_is_another_level() -> None:
    levels, _ = filled([(-1.0, True, 5.0)], [(-1.05, True, 5.0)], [(-0.7, True, 5.0)])
    assert [s.level for s in levels.seen] == [0, 0, 1]
    levels, _ = filled(*[[(-1.0, True, 10.0), (1.5, False, 10.0)]] * 2, apart=20.0)
    assert [s.level for s in levels.seen] == [0, 1, 0, 2]


@pytest.mark.parametrize(("drift", "known"), [(0.0, False), (0.2, False), (0.4, True)])
def test_after_a_climb_the_floor_is_known_again_despite_its_drift(drift: float, known: bool) -> None:
    levels, (T,) = filled([(-1.0, True, 5.0)])
    levels.drift = drift
    levels.add(1, T, [seen(T, -1.4, True, 10.0)])
    assert (levels.seen[-1].level == 0) == known and levels.drift == 0.0


def test_the_floor_is_the_lowest_large_surface() -> None:
    table, floor, pit = (-0.25, True, 40.0), (-1.0, True, 30.0), (-1.5, True, 1.0)
    levels, _ = filled([table, floor, pit, (1.6, False, 50.0)])
    assert levels.floor() == 1, "not the table, which is larger, nor what is lower and small"
    assert filled([(1.6, False, 50.0)])[0].floor() is None
