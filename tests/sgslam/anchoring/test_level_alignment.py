"""The height of a map in the plan, from floors and ceilings, where some are hidden, raised, or not as planned."""

from dataclasses import replace

import numpy as np
import pytest

from data import WallSurface
from sgslam.anchoring.height_alignment import HeightAlignment, align_heights, distinct_heights, height_sigma
from sgslam.anchoring.wall_alignment import AlignedWall
from sgslam.config import AnchorSettings
from sgslam.mapping.level_map import Levels

FLOOR, CEILING = True, False
Level = tuple[float, float, bool]  # height in the levelled map, area, side


def aligned(found: list[Level], tops: tuple[float, ...], sensor: float) -> HeightAlignment | None:
    """The alignment in a storey whose floor is at 3 m, with walls of the given heights above it."""
    height, area, side = np.array(found, dtype=float).reshape(-1, 3).T
    levels = Levels(np.arange(len(found)), height, np.zeros((len(found), 2)), area, side > 0)
    surface = WallSurface("w", None, (0.0, 0.0), (1.0, 0.0), 4.0)
    planned = [replace(surface, id=f"a{k}", height=(3.0, 3.0 + top)) for k, top in enumerate(tops)]
    walls = [AlignedWall(surface, own, 0.0, True) for own in planned]
    return align_heights(levels, walls, 3.0, 0.0, sensor, AnchorSettings())


@pytest.mark.parametrize(
    ("found", "tops", "sensor", "planned", "raised"),
    [
        ([(0.0, 500, FLOOR), (2.7, 300, CEILING)], (2.7,), 1.4, {0: 3.0}, 3.0),
        ([(2.4, 300, CEILING), (1.1, 3, CEILING)], (2.7,), 1.1, {0: 5.7}, 3.3),  # no floor: the map's zero was a guess
        # a platform that is seen most; a little of the floor is below it, and the ceiling is as planned above that
        ([(0.0, 3000, FLOOR), (-0.3, 60, FLOOR), (2.4, 2000, CEILING)], (2.7,), 1.4, {1: 3.0}, 3.3),
        ([(0.0, 3000, FLOOR), (-0.3, 600, FLOOR), (2.4, 2000, CEILING)], (2.7,), 1.4, {1: 3.0}, 3.3),
        ([(0.0, 800, FLOOR), (2.4, 2000, CEILING)], (3.2,), 1.4, {0: 3.0}, 3.0),  # a suspended ceiling
        ([(-0.25, 4, FLOOR), (1.7, 400, CEILING)], (2.7,), 0.4, {1: 5.7}, 4.0),  # a table, the floor is hidden
        ([(2.2, 100, CEILING)], (2.5,), 1.2, {0: 5.5}, 3.3),
    ],
)
def test_the_height_follows_from_the_levels_that_are_as_planned(
    found: list[Level], tops: tuple[float, ...], sensor: float, planned: dict[int, float], raised: float
) -> None:
    heights = aligned(found, tops, sensor)
    assert heights is not None and heights.planned == planned
    assert heights.raised == pytest.approx(raised)


def test_where_two_heights_are_as_likely_the_doubt_is_given_and_nothing_seen_gives_none() -> None:
    for tops, least, most in (((2.5,), 0.0, 0.0), ((2.5, 3.0), 0.1, 1.0)):  # of one ceiling, below walls of two heights
        heights = aligned([(2.2, 100, CEILING)], tops, 1.2)
        assert heights is not None and least <= heights.sigma <= most
    assert aligned([], (), 1.4) is None and aligned([(2.4, 300, CEILING)], (), 1.4) is None


@pytest.mark.parametrize(
    ("apart", "probability", "expected"),
    [
        ([0.3], [0.049], 0.0), ([0.3], [0.051], 0.3 / 1.96),  # one in twenty may be elsewhere
        ([0.6, 0.3], [0.04, 0.1], 0.3 / 1.96),
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
