"""Walls across keyframes: which observations are of one wall, joined and parted as the estimates move."""

from collections.abc import Iterable

import numpy as np
import pytest
from boxes import Array, pose
from wall_pieces import piece

from sgslam.config import SurfaceSettings
from sgslam.mapping import SeenWall, WallMap
from sgslam.mapping.level_map import Register
from sgslam.perception import WallObservation

LEVEL = pose(0.0, 0.0, 0.9)  # the map's origin is the first sensor, 0.9 m above the floor
HERE, SOUTH, NORTH = pose(0, 0, 0), pose(0, -2, 0), pose(0, 2, 0, yaw=1.0)
End = tuple[float, float]


def walls_of(*seen: tuple[Array, Iterable[WallObservation]], level: Array = LEVEL) -> WallMap:
    walls = WallMap(SurfaceSettings(), Register())
    walls.T_level_map = level
    for keyframe, (T, pieces) in enumerate(seen):
        walls.add(keyframe, T, list(pieces))
    return walls


def seen_from(T: Array, *ends: tuple[End, End]) -> WallMap:
    """Of pieces that one keyframe after the other saw at the same place."""
    return walls_of(*((T, [piece(T, *own)]) for own in ends))


def labels(walls: WallMap) -> list[int]:
    return [s.wall for s in walls.seen]


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        ([(HERE, (-1, 3), (1, 3)), (HERE, (-1, 3.3), (1, 3.3))], [0, 1]),  # 30 cm behind
        ([(HERE, (-1, 3), (1, 3)), (HERE, (3, -1), (3, 1))], [0, 1]),  # around the corner
        ([(HERE, (-1, 3), (1, 3)), (HERE, (3, 3), (5, 3)), (HERE, (1.5, 3), (2.5, 3))], [0, 1, 0]),  # far, near
        # seven degrees, less than the gate; but the far end stands 37 cm from the line
        ([(HERE, (-1, 3), (1, 3)), (HERE, (1, 3), (4, 3.37))], [0, 1]),
        # the sides of a thin wall
        ([(SOUTH, (-1, -0.04), (1, -0.04)), (NORTH, (-1, 0.04), (1, 0.04)), (SOUTH, (-1, -0.03), (1, -0.03))],
         [0, 1, 0]),
    ],
)  # fmt: skip
def test_walls_of_other_directions_places_or_sides_are_others(
    seen: list[tuple[Array, End, End]], expected: list[int]
) -> None:
    walls = walls_of(*((T, [piece(T, *ends)]) for T, *ends in seen))
    assert labels(walls) == expected
    walls.refresh(np.stack([T for T, *_ in seen]), walls.planes_in_map)
    assert walls.join_duplicates() == 0 and labels(walls) == expected


def test_one_wall_seen_from_many_places_is_one() -> None:
    poses = [pose(x, 0.5 * x, 0.0, yaw=2.0 * x) for x in np.linspace(0, 3, 7)]
    offs = np.random.default_rng(0).normal(0, 0.02, 7)
    walls = walls_of(*((T, [piece(T, (i - 1.0, 4.0), (i + 1.0, 4.0), offs[i])]) for i, T in enumerate(poses)))
    assert set(labels(walls)) == {0}
    lines = walls.lines
    np.testing.assert_allclose(lines.normal, [[0, -1]], atol=1e-6)
    np.testing.assert_allclose(lines.offset, 4.0, atol=0.08)
    assert lines.high - lines.low == pytest.approx(8.0, abs=0.01) and lines.count == [7]


def test_a_wall_with_two_doors_is_one_observation_of_a_keyframe() -> None:
    pieces = [piece(HERE, (low, 3), (high, 3)) for low, high in ((-3.0, -1.5), (-0.6, 0.6), (1.5, 3.0))]
    walls = walls_of((HERE, [piece(HERE, (-3, 3), (3, 3))]), (HERE, pieces))
    for _ in range(2):
        assert labels(walls) == [0] * 4 and walls.lines.count.tolist() == [2]
        walls.refresh(np.stack([HERE, HERE]), {})


def test_duplicates_are_joined_when_the_estimates_bring_them_together() -> None:
    """Two walls taken for four because two keyframes believed to be 20 cm off."""
    truth = np.stack([pose(x, 0, 0) for x in range(3)])
    believed = [pose(x, 0.2 * (x > 0), 0) for x in range(3)]
    both = ([piece(T, (-1, y), (2, y)) for y in (3, -2)] for T in truth)
    walls = walls_of(*zip(believed, both, strict=True))
    assert labels(walls) == [0, 1, 2, 3, 2, 3]
    walls.refresh(truth, {})
    assert walls.join_duplicates() == 2
    assert labels(walls) == [2, 3, 2, 3, 2, 3]  # those that more keyframes have seen stay
    assert [walls.current(wall) for wall in range(4)] == [2, 3, 2, 3]
    assert sorted(walls.planes_in_map) == [2, 3] and walls.lines.count.tolist() == [3, 3]
    assert walls.join_duplicates() == 0


@pytest.mark.parametrize(("step", "joined"), [(0.0, 1), (0.07, 0)])
def test_end_to_end_walls_are_joined_without_a_step_and_not_with_one(step: float, joined: int) -> None:
    y = 3 + step
    walls = seen_from(HERE, ((-2.5, 3), (-0.5, 3)), ((1.0, y), (3.0, y)), ((-0.6, 3), (0.0, 3)), ((0.0, y), (1.1, y)))
    assert labels(walls)[:2] == [0, 1]
    walls.refresh(np.stack([HERE] * 4), {})
    assert walls.join_duplicates() == joined


@pytest.mark.parametrize(("step", "noise", "parted"), [(0.07, 0.004, 1), (0.0, 0.02, 0)])
def test_a_wall_is_parted_where_it_steps_and_by_noise_alone_nowhere(step: float, noise: float, parted: int) -> None:
    """Seven centimetres: within the gate of one keyframe, clear over many."""
    places = np.linspace(-4, 4, 18)
    offs = np.random.default_rng(1).normal(0, noise, 18) - step * (places > 0)
    ends = [np.clip([x - 0.5, x + 0.5], *((-9, 0) if x < 0 else (0, 9))) for x in places]
    seen = ((HERE, [piece(HERE, (low, 4.0), (high, 4.0), off)]) for (low, high), off in zip(ends, offs, strict=True))
    walls, poses = walls_of(*seen), np.stack([HERE] * 18)
    assert set(labels(walls)) == {0}
    walls.refresh(poses, {})
    assert walls.split_steps() == parted
    for half in (places < 0, places > 0):
        assert len(set(np.array(labels(walls))[half].tolist())) == 1
    walls.refresh(poses, {})
    assert len(walls.lines.ids) == 1 + parted
    assert walls.join_duplicates() == 0 and walls.split_steps() == 0


def test_walls_are_parted_across_two_passes_only() -> None:
    walls = WallMap(SurfaceSettings(), Register())
    for keyframe, wall in ((0, 7), (1, 8), (9, 7), (9, 9)):
        walls.seen.append(SeenWall(np.array([1.0, 0, 0, 0]), np.zeros((2, 3)), (0.0, 2.0), 0.01, 0.01, keyframe, wall))
    walls.part({9}, {0, 1})
    first, second, again, alone = labels(walls)
    assert (first, second, alone) == (7, 8, 9) and again not in (7, 8, 9)
