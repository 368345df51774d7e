"""Verdicts on a door, from both sides of each limit, by rays cast in two rooms with the door between them."""

import numpy as np
import pytest

from data.plans.elements import PlannedElement
from sgslam.as_built.elements import ElementVerdict, element_verdicts
from tests.helpers.two_rooms_seen import (
    BOTH,
    FAR,
    FAR_ROOM,
    FILLED,
    HEIGHT,
    JAMBS,
    LINTEL,
    NEAR,
    NEAR_ROOM,
    PLAN,
    SHARED,
    SHELL,
    TOLERANCE,
    Floats,
    Places,
    box,
    leaf,
    planned,
    views_of,
    wall_with_door,
)


def _door(
    *built: Floats, places: Places = BOTH, elements: list[PlannedElement] | None = None, tolerance: float = TOLERANCE
) -> ElementVerdict:
    own = [element for element in elements or planned() if element.global_id != "column"]
    found = element_verdicts(own, views_of(SHELL, *built, places=places), PLAN, tolerance, SHARED)
    return next(v for v in found if v.global_id == "door")


@pytest.mark.parametrize("across", [0.0, 0.1])
@pytest.mark.parametrize("along", [0.1, -0.1, 0.3])
def test_a_door_that_is_displaced_is_moved_by_so_much_along_its_wall(along: float, across: float) -> None:
    """Also in a wall that is itself off its place."""
    found = _door(wall_with_door(along, across))
    assert found.verdict == "moved" and found.conclusive
    assert found.offset_m is not None and found.direction is not None
    assert found.offset_m * found.direction[1] == pytest.approx(along, abs=0.015)


def test_within_the_tolerance_it_is_as_planned() -> None:
    assert _door(wall_with_door()).verdict == "as planned"
    assert _door(wall_with_door(0.03)).verdict == "moved"
    within = _door(wall_with_door(0.03), tolerance=0.05)
    assert within.verdict == "as planned" and within.conclusive


def test_a_filled_door_is_absent_if_seen_from_both_sides() -> None:
    found = _door(wall_with_door(), FILLED)
    assert found.verdict == "absent" and found.conclusive
    assert _door(wall_with_door(0.0, 0.1), np.add(FILLED, [0.1, 0.0, 0.0])).verdict == "absent"


@pytest.mark.parametrize(("set_back", "told"), [(0.08, "absent"), (0.0, "uncertain"), (None, "uncertain")])
def test_from_one_side_the_planned_leaf_decides_whether_it_is_filled(set_back: float | None, told: str) -> None:
    found = _door(wall_with_door(), FILLED, places=NEAR_ROOM, elements=planned(set_back))
    assert found.verdict == told


def test_a_closed_leaf_is_no_wall() -> None:
    """Set back from the face, or flush with it and seen from behind too; alone from the front it is undecided."""
    assert _door(wall_with_door(), leaf(0.08), places=NEAR_ROOM, elements=planned(0.08)).verdict == "as planned"
    assert _door(wall_with_door(), leaf(), elements=planned(0.0)).verdict == "as planned"
    assert _door(wall_with_door(), leaf(), places=FAR_ROOM, elements=planned(0.0)).verdict == "as planned"
    assert _door(wall_with_door(), leaf(), places=NEAR_ROOM, elements=planned(0.0)).verdict == "uncertain"


def test_a_displaced_door_with_a_closed_leaf_is_moved() -> None:
    found = _door(wall_with_door(0.1), np.add(leaf(0.08), [0.0, 0.1, 0.0]), elements=planned(0.08))
    assert found.verdict == "moved" and found.offset_m is not None
    assert abs(found.offset_m) == pytest.approx(0.1, abs=0.015)


@pytest.mark.parametrize("places", [BOTH, NEAR_ROOM, FAR_ROOM])
@pytest.mark.parametrize("degrees", [20.0, 45.0, 75.0])
def test_a_leaf_that_stands_open_neither_moves_nor_fills_it(degrees: float, places: Places) -> None:
    found = _door(wall_with_door(), leaf(0.0, degrees), places=places, elements=planned(0.0))
    assert found.verdict in ("as planned", "uncertain")


def test_things_before_the_wall_do_not_move_it() -> None:
    shelf = box((NEAR - 0.4, JAMBS[1] + 0.05, 0.0), (NEAR - 0.01, JAMBS[1] + 0.9, 1.8))
    person = box((NEAR - 0.8, -0.2, 0.0), (NEAR - 0.4, 0.3, 1.8))
    assert _door(wall_with_door(), shelf, person).verdict == "as planned"


def test_what_hides_it_or_its_wall_leaves_it_undecided() -> None:
    screen = box((NEAR - 0.5, -3.0, 0.0), (NEAR - 0.4, 3.0, HEIGHT))
    assert _door(wall_with_door(), screen, places=NEAR_ROOM).verdict == "not seen"
    assert _door(wall_with_door(), places=NEAR_ROOM[:2]).verdict == "not seen"


def test_a_door_goes_with_its_absent_wall() -> None:
    found = _door()
    assert found.verdict == "absent" and found.offset_m is None


def test_without_its_wall_in_the_plan_it_is_not_judged() -> None:
    door = planned()[-1]
    assert _door(wall_with_door(), elements=[door]).verdict == "not seen"


@pytest.mark.parametrize("along", [0.0, 0.1])
def test_frames_narrow_a_door_but_do_not_displace_it(along: float) -> None:
    """At both jambs alike, or at one."""
    starts = [jamb + along for jamb in (JAMBS[0], JAMBS[1] - 0.06)]
    frames = [box((NEAR, start, 0.0), (FAR, start + 0.06, LINTEL)) for start in starts]
    both, one = (_door(wall_with_door(along), *own) for own in (frames, frames[:1]))
    assert {both.verdict, one.verdict} <= ({"moved", "uncertain"} if along else {"as planned", "uncertain"})
    for found in (both, one):
        assert found.offset_m is not None and found.sigma_m is not None
        assert abs(found.offset_m) == pytest.approx(along, abs=2 * found.sigma_m + 0.01)
