"""Walls across keyframes: which observations are of one wall, joined and parted as the estimates move."""

import numpy as np
import pytest
from boxes import Array, pose

from sgslam.config import SurfaceSettings
from sgslam.geometry.frames import inverse, transform_planes, transform_points
from sgslam.mapping import WallMap
from sgslam.perception import WallObservation

SETTINGS = SurfaceSettings()
Piece = tuple[WallObservation, Array, Array]
LEVEL = pose(0.0, 0.0, 0.9)  # the map's origin is the first sensor, 0.9 m above the floor


def piece(T_map_sensor: Array, first: tuple[float, float], last: tuple[float, float], off: float = 0.0) -> Piece:
    """A wall piece between two places of the map as a sensor sees it that errs by `off` m across."""
    ends = np.array([[*first, 0.3], [*last, 0.3]])
    tangent = (ends[1] - ends[0])[:2] / np.hypot(*(ends[1] - ends[0])[:2])
    normal = np.array([-tangent[1], tangent[0], 0.0])
    if normal @ (T_map_sensor[:3, 3] - ends[0]) < 0:
        normal = -normal
    ends += off * normal
    plane = transform_planes(inverse(T_map_sensor), np.array([*normal, -normal @ ends[0]]))
    in_sensor = transform_points(inverse(T_map_sensor), ends)
    return WallObservation(plane, in_sensor[:, :2], (0.2, 2.0), 0.01, 0.01), plane, in_sensor


def walls_of(*seen: tuple[Array, list[Piece]]) -> WallMap:
    walls = WallMap(SETTINGS)
    walls.level_by(LEVEL)
    for keyframe, (T, pieces) in enumerate(seen):
        walls.add(keyframe, T, pieces)
    return walls


def labels(walls: WallMap) -> list[int]:
    return [s.wall for s in walls.seen]


def test_one_wall_seen_from_many_places_is_one() -> None:
    poses = [pose(x, 0.5 * x, 0.0, yaw=2.0 * x) for x in np.linspace(0, 3, 7)]
    offs = np.random.default_rng(0).normal(0, 0.02, 7)
    walls = walls_of(*((T, [piece(T, (i - 1.0, 4.0), (i + 1.0, 4.0), offs[i])]) for i, T in enumerate(poses)))
    assert set(labels(walls)) == {0}
    lines = walls.lines
    np.testing.assert_allclose(lines.normal, [[0, -1]], atol=1e-6)
    np.testing.assert_allclose(lines.offset, 4.0, atol=0.08)
    assert lines.high - lines.low == pytest.approx(8.0, abs=0.01)
    assert lines.count == [7]


def test_a_wall_with_two_doors_is_one_observation_of_a_keyframe() -> None:
    T, ends = pose(0, 0, 0), ((-3.0, -1.5), (-0.6, 0.6), (1.5, 3.0))
    whole, pieces = piece(T, (-3, 3), (3, 3)), [piece(T, (low, 3), (high, 3)) for low, high in ends]
    walls = walls_of((T, [whole]), (T, pieces))
    assert labels(walls) == [0] * 4 and walls.lines.count.tolist() == [2] and walls.counts() == {0: 2}
    walls.refresh(np.stack([T, T]), {}, LEVEL)
    assert walls.lines.count.tolist() == [2] and walls.counts() == {0: 2}


def test_the_sides_of_a_thin_wall_stay_two() -> None:
    south, north = pose(0, -2, 0), pose(0, 2, 0, yaw=1.0)
    walls = walls_of(
        (south, [piece(south, (-1, -0.04), (1, -0.04))]),
        (north, [piece(north, (-1, 0.04), (1, 0.04))]),
        (south, [piece(south, (-1, -0.03), (1, -0.03))]),
    )
    assert labels(walls) == [0, 1, 0]
    walls.refresh(np.stack([south, north, south]), walls.planes_in_map, LEVEL)
    assert walls.join_duplicates() == 0


def test_walls_of_other_directions_or_places_are_others() -> None:
    T = pose(0, 0, 0)
    walls = walls_of(
        (T, [piece(T, (-1, 3), (1, 3))]),
        (T, [piece(T, (-1, 3.3), (1, 3.3))]),  # 30 cm behind
        (T, [piece(T, (3, -1), (3, 1))]),  # around the corner
        (T, [piece(T, (3.0, 3), (5.0, 3))]),  # on its line, two metres further
        (T, [piece(T, (1.5, 3), (2.5, 3))]),  # on its line and near
    )
    assert labels(walls) == [0, 1, 2, 3, 0]


def test_a_piece_that_turns_off_the_line_is_another_wall() -> None:
    """Seven degrees, less than the gate; but its far end stands 37 cm from the line."""
    T = pose(0, 0, 0)
    walls = walls_of((T, [piece(T, (-1, 3), (1, 3))]), (T, [piece(T, (1, 3.0), (4, 3.37))]))
    assert labels(walls) == [0, 1]


def drifted() -> tuple[WallMap, Array]:
    """A wall taken for two because the second keyframe believed to be 20 cm off; and the true poses."""
    truth = np.stack([pose(0, 0, 0), pose(1, 0, 0), pose(2, 0, 0)])
    walls = WallMap(SETTINGS)
    walls.level_by(LEVEL)
    for keyframe, believed in enumerate([pose(0, 0, 0), pose(1, 0.2, 0), pose(2, 0.2, 0)]):
        T = truth[keyframe]
        walls.add(keyframe, believed, [piece(T, (-1, 3), (2, 3)), piece(T, (-1, -2), (2, -2))])
    return walls, truth


def test_duplicates_are_joined_when_the_estimates_bring_them_together() -> None:
    walls, truth = drifted()
    assert labels(walls) == [0, 1, 2, 3, 2, 3]
    walls.refresh(truth, {}, LEVEL)
    assert walls.join_duplicates() == 2
    assert labels(walls) == [2, 3, 2, 3, 2, 3]  # those that more keyframes have seen stay
    assert [walls.current(wall) for wall in range(4)] == [2, 3, 2, 3]
    assert sorted(walls.planes_in_map) == [2, 3]
    assert walls.lines.count.tolist() == [3, 3]
    assert walls.join_duplicates() == 0


def test_a_wall_joined_twice_is_still_found() -> None:
    truth = np.stack([pose(0, 0, 0)] * 6)
    walls = WallMap(SETTINGS)
    walls.level_by(LEVEL)
    for keyframe, y in enumerate([0.0, 0.3, 0.3, 0.6, 0.6, 0.6]):
        walls.add(keyframe, pose(0, y, 0), [piece(truth[keyframe], (-1, 3), (1, 3))])
    assert labels(walls) == [0, 1, 1, 2, 2, 2]
    estimates = {0: 3.0, 1: 3.05, 2: 3.3}
    walls.refresh(truth, {w: np.array([0, -1.0, 0, d]) for w, d in estimates.items()}, LEVEL)
    assert walls.join_duplicates() == 1
    walls.refresh(truth, {1: np.array([0, -1.0, 0, 3.0]), 2: np.array([0, -1.0, 0, 3.02])}, LEVEL)
    assert walls.join_duplicates() == 1
    assert len({walls.current(wall) for wall in range(3)}) == 1
    assert labels(walls) == [walls.current(0)] * 6


def test_end_to_end_walls_are_joined_without_a_step_and_not_with_one() -> None:
    T = pose(0, 0, 0)
    for step, count in ((0.0, 1), (0.07, 0)):
        walls = walls_of((T, [piece(T, (-2.5, 3), (-0.5, 3))]), (T, [piece(T, (1.0, 3 + step), (3.0, 3 + step))]))
        assert labels(walls) == [0, 1]
        seen = [piece(T, (-0.6, 3.0), (0.0, 3.0)), piece(T, (0.0, 3 + step), (1.1, 3 + step))]
        walls.add(2, T, seen[:1])
        walls.add(3, T, seen[1:])
        walls.refresh(np.stack([T] * 4), {}, LEVEL)
        assert walls.join_duplicates() == count


def test_a_wall_with_a_step_is_parted_where_it_steps() -> None:
    """Seven centimetres: within the gate of one keyframe, clear over many."""
    T = pose(0, 0, 0)
    places = np.linspace(-4, 4, 18)
    offs = np.random.default_rng(1).normal(0, 0.004, 18) - 0.07 * (places > 0)
    ends = [np.clip([x - 0.5, x + 0.5], *((-9, 0) if x < 0 else (0, 9))) for x in places]
    seen = [piece(T, (low, 4.0), (high, 4.0), off) for (low, high), off in zip(ends, offs, strict=True)]
    walls = walls_of(*((T, [one]) for one in seen))
    assert set(labels(walls)) == {0}
    walls.refresh(np.stack([T] * 18), {}, LEVEL)
    assert walls.split_steps() == 1
    assert len({wall for wall, x in zip(labels(walls), places, strict=True) if x < 0}) == 1
    assert len({wall for wall, x in zip(labels(walls), places, strict=True) if x > 0}) == 1
    walls.refresh(np.stack([T] * 18), {}, LEVEL)
    assert len(walls.lines.ids) == 2
    assert walls.join_duplicates() == 0 and walls.split_steps() == 0


def test_noise_alone_parts_no_wall() -> None:
    T = pose(0, 0, 0)
    offs = np.random.default_rng(2).normal(0, 0.02, 40)
    walls = walls_of(*((T, [piece(T, (0.1 * i - 2.5, 4.0), (0.1 * i - 1.5, 4.0), off)]) for i, off in enumerate(offs)))
    walls.refresh(np.stack([T] * 40), {}, LEVEL)
    assert walls.split_steps() == 0


def test_coverage_leaves_out_what_nobody_has_seen() -> None:
    T = pose(0, 0, 0)
    walls = walls_of(*((T, [piece(T, (a, 3), (b, 3))]) for a, b in ((-2.0, -1.0), (-0.2, 1.0), (0.5, 1.5))))
    walls.refresh(np.stack([T] * 3), {}, LEVEL)
    assert len(set(labels(walls))) == 1
    places = walls.coverage(0.1)[labels(walls)[0]]
    line = walls.lines
    tangent = np.array([-line.normal[0, 1], line.normal[0, 0]])
    x = np.sort(places * tangent[0])
    gap = int(np.argmax(np.diff(x)))
    np.testing.assert_allclose([x[0], x[gap], x[gap + 1], x[-1]], [-2.0, -1.0, -0.2, 1.5], atol=0.11)
    assert np.diff(x)[[i for i in range(len(x) - 1) if i != gap]].max() == pytest.approx(0.1)


def test_planes_of_the_back_end_move_the_lines_and_a_tilted_map_is_levelled() -> None:
    tilt = pose(0, 0, 0.9, 0.0, np.radians(5), np.radians(-4))  # the first sensor leaned: so does the map
    T_map = inverse(tilt) @ pose(0, 0, 0.9)
    walls = WallMap(SETTINGS)
    walls.level_by(tilt)
    upright = pose(0, 0, 0.9)
    observation, plane, ends = piece(upright, (-1, 3), (1, 3))
    walls.add(0, T_map, [(observation, plane, ends)])
    np.testing.assert_allclose(walls.lines.normal, [[0, -1]], atol=1e-9)
    np.testing.assert_allclose(walls.lines.offset, [3.0], atol=1e-9)
    moved = transform_planes(inverse(tilt), np.array([0, -1.0, 0, 3.5]))
    walls.refresh(T_map[None], {0: moved}, tilt)
    np.testing.assert_allclose(walls.lines.offset, [3.5], atol=1e-9)
    np.testing.assert_allclose([walls.lines.low, walls.lines.high], [[-1], [1]], atol=1e-9)


def test_only_walls_that_turn_to_a_place_are_visible_from_it() -> None:
    south, north = pose(0, -2, 0), pose(0, 2, 0)
    walls = walls_of((south, [piece(south, (-1, 0), (1, 0))]), (north, [piece(north, (-1, 0.1), (1, 0.1))]))
    lines = walls.lines
    assert lines.visible_from(np.array([0.0, -1.0]), 10.0).ids.tolist() == [0]
    assert lines.visible_from(np.array([0.0, 5.0]), 10.0).ids.tolist() == [1]
    assert lines.visible_from(np.array([8.0, 1.0]), 5.0).ids.tolist() == []


def test_a_map_without_walls_answers() -> None:
    walls = WallMap(SETTINGS)
    walls.add(0, pose(0, 0), [])
    walls.refresh(pose(0, 0)[None], {}, LEVEL)
    assert walls.join_duplicates() == 0 and walls.split_steps() == 0
    assert len(walls.lines.ids) == 0 and walls.coverage(0.1) == {} and walls.heights() == {}
