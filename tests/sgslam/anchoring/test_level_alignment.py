"""The height of a map in the plan, from floors and ceilings, where some are hidden, raised, or not as planned."""

import numpy as np
import pytest

from data import LevelSurface
from sgslam.anchoring.level_alignment import LevelAlignment, align_levels, height_sigma
from sgslam.config import AnchorSettings
from sgslam.geometry.frames import se2_to_se3
from sgslam.mapping.level_map import Levels

FLOOR, CEILING = True, False
Level = tuple[float, float, bool]  # height in the levelled map, area, side
Planned = tuple[float, bool, float, float]  # height above the storey's floor, side, from x to x
ROOM: tuple[Planned, ...] = ((0.0, FLOOR, 0.0, 60.0), (2.7, CEILING, 0.0, 60.0))
PLACE = se2_to_se3(0.3, 40.0, -7.0)


def aligned(found: list[Level], planned: tuple[Planned, ...], begin: float = 0.0) -> LevelAlignment | None:
    """The alignment in a storey whose floor is at 3 m, 10 m deep: each surface begins at x = `begin` in the plan."""
    places = []
    for height, area, _ in found:
        xy = np.array([(begin + 0.25 + 0.5 * (k // 20), 0.25 + 0.5 * (k % 20)) for k in range(round(4 * area))])
        at = np.linalg.inv(PLACE) @ np.vstack([xy.T, np.zeros(len(xy)), np.ones(len(xy))])
        places.append(np.column_stack([at[:2].T, np.full(len(xy), height)]))
    height, area, side = np.array(found, dtype=float).reshape(-1, 3).T
    levels = Levels(np.arange(len(found)), tuple(places), height, area, side > 0)
    surfaces = []
    for k, (z, is_floor, x0, x1) in enumerate(planned):
        sign, corners = 1.0 if is_floor else -1.0, ((x0, 0.0), (x1, 0.0), (x1, 10.0), (x0, 10.0))
        surfaces.append(LevelSurface(f"l{k}", (0.0, 0.0, sign, -sign * (103.0 + z)), corners))
    return align_levels(levels, surfaces, PLACE, 100.0, AnchorSettings())


@pytest.mark.parametrize(
    ("found", "planned", "as_planned", "raised"),
    [
        ([(0.0, 200, FLOOR), (2.7, 150, CEILING)], ROOM, {0: 3.0, 1: 5.7}, 3.0),
        # a platform that is seen most; some of the floor is below it, and the ceiling is as planned above that
        ([(0.0, 300, FLOOR), (-0.3, 60, FLOOR), (2.4, 300, CEILING)], ROOM, {1: 3.0, 2: 5.7}, 3.3),
        ([(0.0, 150, FLOOR), (2.4, 150, CEILING)], ROOM, {0: 3.0}, 3.0),  # a suspended ceiling that is not planned
        # what is planned in one half of the building counts there alone
        ([(0.0, 300, FLOOR), (2.4, 150, CEILING)], (*ROOM[:1], (2.4, CEILING, 0, 30), (2.7, CEILING, 30, 60)),
         {0: 3.0, 1: 5.4}, 3.0),
        ([(0.0, 200, FLOOR)], ((0.0, FLOOR, 30.0, 60.0), (0.2, FLOOR, 0.0, 30.0)), {0: 3.2}, 3.2),  # a planned platform
    ],
)  # fmt: skip
def test_the_height_follows_from_the_levels_that_are_as_planned(
    found: list[Level], planned: tuple[Planned, ...], as_planned: dict[int, float], raised: float
) -> None:
    heights = aligned(found, planned)
    assert heights is not None and {level: z for level, (z, _) in heights.planned.items()} == pytest.approx(as_planned)
    assert heights.raised == pytest.approx(raised, abs=0.004) and heights.sigma < 0.05


def test_a_floor_is_right_where_the_planned_ceiling_is_not_however_many_patches_that_has() -> None:
    for patches in (1, 2, 4):
        heights = aligned(
            [(0.0, 200, FLOOR), *[(2.73 + 0.004 * k, 100 / patches, CEILING) for k in range(patches)]], ROOM
        )
        assert heights is not None and heights.raised == pytest.approx(3.0, abs=0.006)
        information = {
            side: sum(s**-2 for level, (_, s) in heights.planned.items() if (level > 0) == side) for side in (0, 1)
        }
        assert information[0] == pytest.approx(9 * information[1], rel=0.01)  # sigmas of 1 and 3 cm


@pytest.mark.parametrize(
    ("found", "planned", "least"),
    [
        ([(2.4, 150, CEILING), (1.1, 2, CEILING)], ROOM, 0.1),  # no floor: the ceiling may be a suspended one
        ([(-0.25, 2, FLOOR), (1.7, 150, CEILING)], ROOM, 0.1),  # likewise; what is below the sensor is a table
        ([(2.4, 100, CEILING)], ((2.5, CEILING, 0.0, 60.0), (3.0, CEILING, 0.0, 60.0)), 0.2),
        ([(0.0, 300, FLOOR), (-0.3, 60, FLOOR)], ROOM, 0.1),  # a platform and the floor, or the floor and a pit
    ],
)
def test_where_other_heights_are_likely_the_doubt_is_given(
    found: list[Level], planned: tuple[Planned, ...], least: float
) -> None:
    heights = aligned(found, planned)
    assert heights is not None and least < heights.sigma < 0.7
    assert heights.planned and all(s > heights.sigma for _, s in heights.planned.values())


def test_what_lies_at_no_planned_level_gives_no_height() -> None:
    assert aligned([], ROOM) is None and aligned([(2.4, 100, CEILING)], ROOM, begin=100.0) is None


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
