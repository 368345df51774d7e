"""The height of a map in the plan, from floors and ceilings, where some are hidden, raised, or not as planned."""

import numpy as np
import pytest

from data import WallSurface
from sgslam.anchoring.height_alignment import HeightAlignment, align_heights, distinct_heights, height_sigma
from sgslam.anchoring.wall_alignment import AlignedWall
from sgslam.config import AnchorSettings
from sgslam.mapping.level_map import Levels

SETTINGS = AnchorSettings()
FLOOR, CEILING = True, False
Level = tuple[float, float, bool]  # height in the levelled map, area, side


def aligned(found: list[Level], tops: tuple[float, ...] = (2.7,), sensor: float = 1.4) -> HeightAlignment | None:
    """The alignment in a storey whose floor is at 3 m, with walls of the given heights above it."""
    height, area, side = (np.array(values) for values in zip(*found, strict=True))
    levels = Levels(np.arange(len(found)), height.astype(float), np.zeros((len(found), 2)), area.astype(float), side)
    walls = []
    for k, top in enumerate(tops):
        planned = WallSurface(f"a{k}", None, (0.0, 0.0), (1.0, 0.0), 4.0, height=(3.0, 3.0 + top))
        walls.append(AlignedWall(WallSurface(f"s{k}", None, (0.0, 0.0), (1.0, 0.0), 4.0), planned, 0.0, True))
    return align_heights(levels, walls, 3.0, 0.0, sensor, SETTINGS)


def test_the_floor_tells_the_height() -> None:
    found = aligned([(0.0, 500, FLOOR), (2.7, 300, CEILING)])
    assert found is not None and found.planned == {0: 3.0}
    assert found.raised == pytest.approx(3.0) and found.sigma == 0.0


def test_without_a_floor_the_ceiling_tells_it() -> None:
    found = aligned([(2.4, 300, CEILING), (1.1, 3, CEILING)], sensor=1.1)  # the map's zero was a guess
    assert found is not None and found.planned == {0: 5.7}
    assert found.raised == pytest.approx(3.3)


@pytest.mark.parametrize("share", [0.02, 0.2])
def test_a_platform_that_is_seen_most_is_not_the_floor(share: float) -> None:
    """A little of the floor is seen below it, and the ceiling is as planned above the floor."""
    found = aligned([(0.0, 3000, FLOOR), (-0.3, 3000 * share, FLOOR), (2.4, 2000, CEILING)])
    assert found is not None and found.planned == {1: 3.0}
    assert found.raised == pytest.approx(3.3)


def test_a_suspended_ceiling_is_none_of_the_plan() -> None:
    found = aligned([(0.0, 800, FLOOR), (2.4, 2000, CEILING)], tops=(3.2,))
    assert found is not None and found.planned == {0: 3.0} and found.raised == pytest.approx(3.0)


def test_a_table_is_not_the_floor_that_is_hidden() -> None:
    found = aligned([(-0.25, 4, FLOOR), (1.7, 400, CEILING)], sensor=0.4)
    assert found is not None and found.planned == {1: 5.7} and found.raised == pytest.approx(4.0)


def test_where_two_heights_are_as_likely_the_doubt_is_told() -> None:
    """Only two ceilings, 0.5 m apart, and walls of both heights."""
    found = aligned([(2.2, 100, CEILING)], tops=(2.5, 3.0), sensor=1.2)
    assert found is not None and found.sigma > 0.1
    assert aligned([(2.2, 100, CEILING)], tops=(2.5,), sensor=1.2).sigma == 0.0  # type: ignore[union-attr]


def test_nothing_seen_tells_nothing() -> None:
    nothing = Levels(np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 2)), np.empty(0), np.empty(0, dtype=bool))
    assert align_heights(nothing, [], 3.0, 0.0, 1.4, SETTINGS) is None
    assert aligned([(2.4, 300, CEILING)], tops=()) is None


@pytest.mark.parametrize(
    ("apart", "probability", "expected"),
    [
        ([0.3], [0.049], 0.0), ([0.3], [0.051], 0.3 / 1.96),  # one in twenty may be elsewhere
        ([0.6, 0.3], [0.04, 0.1], 0.3 / 1.96), ([0.3, 0.6], [0.1, 0.06], 0.6 / 1.96),
        ([0.6, 0.6], [0.03, 0.03], 0.6 / 1.96),
        ([0.3], [0.45], 0.3 * 0.45**0.5),  # the second moment, where that is larger
        ([1.5, 0.3], [0.04, 0.3], (0.04 * 1.5**2 + 0.3 * 0.3**2) ** 0.5),
        ([], [], 0.0),
    ],
)  # fmt: skip
def test_a_region_of_95_percent_holds_95_percent_of_the_likely_heights(
    apart: list[float], probability: list[float], expected: float
) -> None:
    assert height_sigma(np.array(apart), np.array(probability)) == pytest.approx(expected)


@pytest.mark.parametrize(("third", "expected"), [(0.32, [1, 0]), (0.34, [1, 2, 0])])
def test_heights_within_the_tolerance_of_one_another_count_once(third: float, expected: list[int]) -> None:
    candidates, odds = np.array([0.0, 0.3, third]), np.array([-2.0, 0.0, -1.0])
    assert distinct_heights(candidates, odds, tolerance=0.03) == expected
