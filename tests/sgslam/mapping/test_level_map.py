"""Level surfaces over keyframes: which observation is of which surface, and which surface is the floor."""

from time import process_time

import numpy as np
from boxes import Array, pose

from sgslam.config import LevelSettings
from sgslam.geometry.frames import inverse, transform_planes, transform_points
from sgslam.mapping import LevelMap
from sgslam.mapping.level_map import LevelRegister
from sgslam.perception import LevelObservation

SETTINGS = LevelSettings()


def seen(T: Array, height: float, is_floor: bool = True, area: float = 10.0, off: float = 0.0) -> LevelObservation:
    """A level surface at a height in the map, as seen at a pose (4, 4), `off` metres ahead of it."""
    side = 1.0 if is_floor else -1.0
    plane = transform_planes(inverse(T), np.array([0, 0, side, -side * height]))
    centre = transform_points(inverse(T), np.array([T[0, 3] + off, T[1, 3], height]))
    return LevelObservation(plane, centre, area, is_floor, 0.001, 0.003)


def filled(*keyframes: list[tuple[float, bool, float]]) -> tuple[LevelMap, Array]:
    """A map of keyframes, a metre apart, that saw surfaces (height, side, area); and their poses (K, 4, 4)."""
    levels, poses = LevelMap(SETTINGS, LevelRegister()), []
    for k, surfaces in enumerate(keyframes):
        poses.append(pose(float(k), 0.0, 0.0, 0.3 * k, 0.1, -0.1))
        levels.add(k, poses[-1], [seen(poses[-1], *surface) for surface in surfaces])
    return levels, np.stack(poses)


def test_observations_of_one_floor_are_one_level_and_a_step_is_another() -> None:
    levels, _ = filled([(-1.0, True, 5.0)], [(-1.05, True, 5.0)], [(-0.7, True, 5.0)])
    assert [s.level for s in levels.seen] == [0, 0, 1]


def test_a_floor_goes_on_through_doors_and_a_ceiling_does_not() -> None:
    near, far = pose(0, 0, 0), pose(20, 0, 0)
    levels = LevelMap(SETTINGS, LevelRegister())
    levels.add(0, near, [seen(near, -1.0), seen(near, 1.5, is_floor=False)])
    levels.add(1, far, [seen(far, -1.0), seen(far, 1.5, is_floor=False)])
    assert [s.level for s in levels.seen] == [0, 1, 0, 2]


def test_after_a_climb_the_floor_is_known_again_despite_its_drift() -> None:
    back = pose(0, 0, 0)
    for drift, known in ((0.0, False), (0.2, False), (0.4, True)):
        levels, _ = filled([(-1.0, True, 5.0)])
        levels.drift = drift
        levels.add(1, back, [seen(back, -1.4)])
        assert (levels.seen[-1].level == 0) == known and levels.drift == 0.0


def test_the_floor_is_the_lowest_large_surface() -> None:
    table, floor, pit = (-0.25, True, 40.0), (-1.0, True, 30.0), (-1.5, True, 1.0)
    levels, _ = filled([table, floor, pit, (1.6, False, 50.0)])
    assert levels.floor() == 1, "not the table, which is larger, nor what is lower and small"
    assert filled([(1.6, False, 50.0)])[0].floor() is None


def test_levels_that_turn_out_to_be_one_are_joined() -> None:
    levels, poses = filled([(-1.0, True, 9.0)], [(-0.8, True, 5.0)])
    assert len({s.level for s in levels.seen}) == 2
    poses[1, 2, 3] -= 0.19  # the second keyframe was too high
    planes = {s.level: transform_planes(T, s.plane) for s, T in zip(levels.seen, poses, strict=True)}
    levels.refresh(planes, poses)
    assert {s.level for s in levels.seen} == {0} and set(levels.planes_in_map) == {0}
    found = levels.levels(np.eye(4))
    assert found.area.tolist() == [14.0] and abs(found.height[0] + 1.0) < 0.02


def test_the_thousandth_keyframe_costs_as_much_as_the_first_ones() -> None:
    levels, times = LevelMap(SETTINGS, LevelRegister()), []
    for k in range(1500):
        T = pose(3 * np.sin(k / 50), 3 * np.cos(k / 50), 0.0)
        found = [seen(T, -1.0), seen(T, 1.5, is_floor=False)]
        began = process_time()
        levels.add(k, T, found)
        assert levels.floor() == 0
        times.append(process_time() - began)
    assert {s.level for s in levels.seen} == {0, 1} and len(levels.seen) == 3000
    assert np.median(times[-300:]) < 2 * np.median(times[300:600])


def test_levels_are_the_weighted_means_of_all_their_observations() -> None:
    """Also after two of them were joined: of ceilings, only those near by."""
    levels, poses = filled([(-1.0, True, 9.0), (1.5, False, 4.0)], [(-0.8, True, 3.0), (1.51, False, 12.0)])
    found = levels.levels(np.eye(4))
    np.testing.assert_allclose([found.height.tolist(), found.area.tolist()], [[-1.0, 1.5075, -0.8], [9.0, 16.0, 3.0]])
    np.testing.assert_allclose(found.centre[1], [0.75, 0.0], atol=1e-9)
    poses[1, 2, 3] -= 0.19
    levels.refresh({}, poses)
    found = levels.levels(pose(0.0, 0.0, 2.0))
    np.testing.assert_allclose([found.height[0], found.area[0]], [1.0025, 12.0])
