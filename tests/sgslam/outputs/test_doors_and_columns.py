"""Verdicts on a door and on a column, from both sides of each limit, by rays cast in two rooms."""

import numpy as np
import pytest
import two_rooms_seen as rooms
from two_rooms_seen import BOTH, FAR, JAMBS, NEAR, NEAR_ROOM, WALL, Floats, Places, box, column, leaf, wall_with_door

from sgslam.as_built.elements import ElementVerdict

LEFT = ((-1.5, 1.2), (-2.0, 1.5), (-1.0, 0.8), (-2.0, 1.8), (-1.2, 1.5))  # of the column
UNDECIDED = {"as planned", "uncertain", "not seen"}
FILLED = box((NEAR, JAMBS[0], 0.0), (FAR, JAMBS[1], rooms.LINTEL))
SHELF = box((NEAR - 0.4, JAMBS[1] + 0.05, 0.0), (NEAR - 0.01, JAMBS[1] + 0.9, 1.8))
SCREEN = box((NEAR - 0.5, -3.0, 0.0), (NEAR - 0.4, 3.0, rooms.HEIGHT))
PERSON = box((0.1, 1.2, 0.0), (0.35, 1.65, 1.8))
FRAMES = tuple(box((NEAR, y, 0.0), (FAR, y + 0.06, rooms.LINTEL)) for y in (JAMBS[0], JAMBS[1] - 0.06))
SLIDE = np.array([0.0, 0.1, 0.0])


def judged(
    name: str, built: tuple[Floats, ...], places: Places = BOTH, set_back: float | None = None, tolerance: float = 0.01
) -> ElementVerdict:
    """The verdict on one of the elements; wall and shell are known."""
    elements = [own for own in rooms.planned(set_back) if own.global_id in (name, "wall", "shell")]
    views = rooms.views_of(rooms.SHELL, *built, places=places)
    return next(own for own in rooms.assessed(elements, views, tolerance).elements if own.global_id == name)


@pytest.mark.parametrize(
    ("name", "built", "shift", "places"),
    [
        ("door", (wall_with_door(0.1),), (0.0, 0.1), BOTH),
        ("door", (wall_with_door(-0.3, across=0.1),), (0.0, -0.3), BOTH),
        ("column", (WALL, column(0.0, -0.1)), (0.0, -0.1), BOTH),
        ("column", (WALL, column(-0.3, 0.1)), (-0.3, 0.1), BOTH),
        ("column", (WALL, column(0.1, 0.0)), (0.1, 0.0), LEFT),
    ],
)
def test_what_is_displaced_is_moved_by_that_vector(
    name: str, built: tuple[Floats, ...], shift: tuple[float, float], places: Places
) -> None:
    """A door only along its wall, which may itself be off its place."""
    found = judged(name, built, places)
    assert found.verdict == "moved" and found.conclusive
    assert found.offset_m is not None and found.direction is not None
    np.testing.assert_allclose(found.offset_m * np.array(found.direction), [*shift, 0.0], atol=0.015)


@pytest.mark.parametrize(("name", "built"), [("door", (wall_with_door(0.03),)), ("column", (WALL, column(0.03)))])
def test_within_the_tolerance_it_is_as_planned(name: str, built: tuple[Floats, ...]) -> None:
    assert [judged(name, built, tolerance=limit).verdict for limit in (0.01, 0.05)] == ["moved", "as planned"]


@pytest.mark.parametrize(
    ("name", "built", "places", "set_back", "expected"),
    [
        ("door", (), BOTH, None, {"absent"}),  # with its wall
        ("door", (WALL, FILLED), BOTH, None, {"absent"}),
        # from one side the planned leaf decides whether it is filled
        ("door", (WALL, FILLED), NEAR_ROOM, 0.08, {"absent"}),
        ("door", (WALL, FILLED), NEAR_ROOM, 0.0, {"uncertain"}),
        # a closed leaf is no wall: set back, or flush and seen from behind too; alone from the front it is undecided
        ("door", (WALL, leaf(0.08)), NEAR_ROOM, 0.08, {"as planned"}),
        ("door", (wall_with_door(0.1), leaf(0.08) + SLIDE), BOTH, 0.08, {"moved"}),
        ("door", (WALL, leaf()), BOTH, 0.0, {"as planned"}),
        ("door", (WALL, leaf()), NEAR_ROOM, 0.0, {"uncertain"}),
        # an open leaf neither moves nor fills it, and frames do not displace it
        *(("door", (WALL, leaf(0.0, a)), p, 0.0, UNDECIDED) for a, p in ((20.0, BOTH), (75.0, NEAR_ROOM))),
        ("door", (WALL, *FRAMES), BOTH, None, UNDECIDED),
        # what stands before the wall does not move the door; what hides it leaves it undecided
        ("door", (WALL, SHELF), BOTH, None, {"as planned"}),
        ("door", (WALL, SCREEN), NEAR_ROOM, None, {"not seen"}),
        ("door", (WALL,), NEAR_ROOM[:2], None, {"not seen"}),
        ("column", (WALL,), LEFT, None, {"absent"}),
        ("column", (WALL, column(), PERSON), BOTH, None, {"as planned"}),
        ("column", (WALL, column(), PERSON), LEFT, None, UNDECIDED),
        ("column", (WALL, column(), SCREEN - [3.0, 0.0, 0.0]), ((-1.5, 1.2),) * 5, None, {"not seen"}),
    ],
)
def test_what_stands_there_or_before_it(
    name: str, built: tuple[Floats, ...], places: Places, set_back: float | None, expected: set[str]
) -> None:
    assert judged(name, built, places, set_back).verdict in expected


def test_a_door_is_not_judged_without_its_wall() -> None:
    *_, door = rooms.planned()
    assert rooms.assessed([door], rooms.views_of(rooms.SHELL, WALL)).elements[0].verdict == "not seen"
