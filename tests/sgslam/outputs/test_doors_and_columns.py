"""Verdicts on a door and on a column, from both sides of each limit, by rays cast in two rooms."""

import numpy as np
import pytest
from two_rooms_seen import (
    BOTH,
    FAR,
    FILLED,
    HEIGHT,
    JAMBS,
    LINTEL,
    NEAR,
    NEAR_ROOM,
    SHELL,
    Floats,
    Places,
    box,
    column,
    leaf,
    planned,
    views_of,
    wall_with_door,
)

from data.plans.elements import PlannedElement
from data.scene_graph import SceneGraph
from sgslam.as_built.elements import ElementVerdict, element_verdicts

LEFT = ((-1.5, 1.2), (-2.0, 1.5), (-1.0, 0.8), (-2.0, 1.8), (-1.2, 1.5))  # of the column
SAME = {"as planned"}
UNDECIDED = {"as planned", "uncertain", "not seen"}
WALL = wall_with_door()


def judged(
    name: str, elements: list[PlannedElement], built: tuple[Floats, ...], places: Places, tolerance: float
) -> ElementVerdict:
    found = element_verdicts(elements, views_of(SHELL, *built, places=places), SceneGraph("bim"), tolerance, 0.004)
    return next(own for own in found if own.global_id == name)


def door(
    *built: Floats, places: Places = BOTH, elements: list[PlannedElement] | None = None, tolerance: float = 0.01
) -> ElementVerdict:
    own = [element for element in elements or planned() if element.global_id != "column"]
    return judged("door", own, built, places, tolerance)


def the_column(*built: Floats, places: Places = BOTH, tolerance: float = 0.01) -> ElementVerdict:
    own = [element for element in planned() if element.kind == "solid"]
    return judged("column", own, (WALL, *built), places, tolerance)


@pytest.mark.parametrize(("along", "across"), [(0.1, 0.0), (-0.1, 0.1), (0.3, 0.1)])
def test_a_displaced_door_is_moved_by_so_much_along_its_wall(along: float, across: float) -> None:
    """Also in a wall that is itself off its place."""
    found = door(wall_with_door(along, across))
    assert found.verdict == "moved" and found.conclusive
    assert found.offset_m is not None and found.direction is not None
    assert found.offset_m * found.direction[1] == pytest.approx(along, abs=0.015)


@pytest.mark.parametrize(("shift", "places"), [((0.0, -0.1), BOTH), ((-0.3, 0.1), BOTH), ((0.1, 0.0), LEFT)])
def test_a_displaced_column_is_moved_by_that_vector(shift: tuple[float, float], places: Places) -> None:
    found = the_column(column(*shift), places=places)
    assert found.verdict == "moved" and found.conclusive
    assert found.offset_m is not None and found.direction is not None
    np.testing.assert_allclose(found.offset_m * np.array(found.direction), [*shift, 0.0], atol=0.015)


def test_within_the_tolerance_both_are_as_planned() -> None:
    off = wall_with_door(0.03), column(0.03, 0.0)
    assert door(off[0]).verdict == the_column(off[1]).verdict == "moved"
    for within in (door(off[0], tolerance=0.05), the_column(off[1], tolerance=0.05)):
        assert within.verdict == "as planned" and within.conclusive


def test_a_filled_door_is_absent_if_seen_from_both_sides() -> None:
    found = door(WALL, FILLED)
    assert found.verdict == "absent" and found.conclusive


SHELF = box((NEAR - 0.4, JAMBS[1] + 0.05, 0.0), (NEAR - 0.01, JAMBS[1] + 0.9, 1.8))
PERSON = box((NEAR - 0.8, -0.2, 0.0), (NEAR - 0.4, 0.3, 1.8))
SCREEN = box((NEAR - 0.5, -3.0, 0.0), (NEAR - 0.4, 3.0, HEIGHT))


@pytest.mark.parametrize(
    ("built", "places", "set_back", "expected"),
    [
        # from one side the planned leaf decides whether it is filled
        ((WALL, FILLED), NEAR_ROOM, 0.08, {"absent"}),
        ((WALL, FILLED), NEAR_ROOM, 0.0, {"uncertain"}),
        # a closed leaf is no wall: set back, or flush and seen from behind too; alone from the front it is undecided
        ((WALL, leaf(0.08)), NEAR_ROOM, 0.08, SAME),
        ((WALL, leaf()), BOTH, 0.0, SAME),
        ((WALL, leaf()), NEAR_ROOM, 0.0, {"uncertain"}),
        # what stands before the wall does not move the door; what hides it leaves it undecided
        ((WALL, SHELF, PERSON), BOTH, None, SAME),
        ((WALL, SCREEN), NEAR_ROOM, None, {"not seen"}),
        ((WALL,), NEAR_ROOM[:2], None, {"not seen"}),
        # an open leaf neither moves nor fills it
        *(((WALL, leaf(0.0, a)), p, 0.0, UNDECIDED) for a, p in ((20.0, BOTH), (75.0, NEAR_ROOM))),
    ],
)
def test_what_stands_in_or_before_a_door(
    built: tuple[Floats, ...], places: Places, set_back: float | None, expected: set[str]
) -> None:
    assert door(*built, places=places, elements=planned(set_back)).verdict in expected


def test_a_door_goes_with_its_absent_wall_and_is_not_judged_without_one() -> None:
    found = door()
    assert found.verdict == "absent" and found.offset_m is None
    assert door(WALL, elements=planned()[-1:]).verdict == "not seen"


@pytest.mark.parametrize("along", [0.0, 0.1])
def test_frames_narrow_a_door_but_do_not_displace_it(along: float) -> None:
    """At both jambs alike."""
    starts = [jamb + along for jamb in (JAMBS[0], JAMBS[1] - 0.06)]
    frames = [box((NEAR, start, 0.0), (FAR, start + 0.06, LINTEL)) for start in starts]
    found = door(wall_with_door(along), *frames)
    assert found.verdict in ({"moved", "uncertain"} if along else {"as planned", "uncertain"})
    assert found.offset_m is not None and found.sigma_m is not None
    assert abs(found.offset_m) == pytest.approx(along, abs=2 * found.sigma_m + 0.01)


def test_a_column_that_is_seen_through_is_absent() -> None:
    found = the_column(places=LEFT)
    assert found.verdict == "absent" and found.conclusive


def test_things_before_a_column_do_not_move_it() -> None:
    person = box((0.1, 1.2, 0.0), (0.35, 1.65, 1.8))
    shelf = box((0.1, 0.8, 0.0), (0.35, 2.0, 2.0))
    assert the_column(column(), person).verdict == "as planned"
    assert the_column(column(), shelf, places=LEFT).verdict in UNDECIDED


def test_a_hidden_column_is_not_seen() -> None:
    screen = box((-0.1, -3.0, 0.0), (-0.05, 3.0, HEIGHT))
    assert the_column(column(), screen, places=LEFT).verdict == "not seen"
