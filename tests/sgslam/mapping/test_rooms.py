"""Rooms cut from free space, in plans that are known exactly."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from boxes import Array, Box, pose
from wall_pieces import outlines

from sgslam.config import RoomSettings
from sgslam.mapping.rooms import Segmentation, free_space, segment

Place = tuple[float, float]
OUTER: list[Box] = [
    (-0.2, -0.2, 0, 10.2, 0, 2.6), (-0.2, 5, 0, 10.2, 5.2, 2.6), (-0.2, 0, 0, 0, 5, 2.6), (10, 0, 0, 10.2, 5, 2.6),
]  # fmt: skip
WAY = [(1.0, 1.0), (2.5, 3.5), (3.5, 1.5), (4.6, 2.5), (5.4, 2.5), (7.0, 1.5), (9.0, 3.5), (7.0, 4.0)]


def divided(low: float, high: float) -> list[Box]:
    """Two rooms of 5 m, walled apart at x = 5 but for a door between two places along y."""
    parts: list[Box] = [(4.9, 0, 0, 5.1, low, 2.6), (4.9, high, 0, 5.1, 5, 2.6)]
    return [*OUTER, *(box for box in parts if box[4] > box[1])]


def seen(
    boxes: list[Box],
    places: list[Place],
    lintel: Array | None = None,
    turn: float = 0.0,
    walls: tuple[tuple[Place, Place], ...] = (),
) -> Segmentation:
    """Segments what is seen of boxes from places, beside `walls` where a sensor looks through; `lintel` (L, 2) are
    points over a door, `turn` turns the map."""
    R, sensors = pose(0, 0, yaw=turn)[:2, :2], np.array(places)
    found = outlines(boxes, [pose(x, y, 1.3) for x, y in places], 0.02)
    corners = [[(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)] for x0, y0, _, x1, y1, _ in boxes]
    sides = np.array([*(edge for own in corners for edge in pairwise(own)), *walls])
    lintels = [np.empty((0, 2)) if lintel is None else lintel @ R.T] * len(places)
    in_map = [(own[:, :2] + at) @ R.T for own, at in zip(found, sensors, strict=True)]
    space = free_space(sensors @ R.T, in_map, sides @ R.T, lintels)
    return segment(space, sensors @ R.T, RoomSettings())


def room_at(segmentation: Segmentation, *places: Place) -> list[int]:
    return segmentation.grid.look_up(segmentation.labels, np.array(places)).tolist()


@pytest.mark.parametrize(("width", "turn"), [(0.8, 0.0), (1.0, 0.6), (1.2, 2.2)])
def test_rooms_joined_by_a_door_are_two_with_one_passage(width: float, turn: float) -> None:
    found, R = seen(divided(2.5 - width / 2, 2.5 + width / 2), WAY, turn=turn), pose(0, 0, yaw=turn)[:2, :2]
    left, right = sorted(found.rooms, key=lambda room: float((room.centroid @ R)[0]))
    np.testing.assert_allclose([left.centroid @ R, right.centroid @ R], [[2.45, 2.5], [7.55, 2.5]], atol=0.1)
    np.testing.assert_allclose([left.area, right.area], 24.5, rtol=0.06)
    for room, x0, x1 in ((left, 0.0, 4.9), (right, 5.1, 10.0)):
        outline = room.polygon @ R
        np.testing.assert_allclose([outline.min(axis=0), outline.max(axis=0)], [[x0, 0], [x1, 5]], atol=0.25)
    ((labels, middle),) = found.passages.items()
    assert set(labels) == {left.label, right.label}
    np.testing.assert_allclose(middle @ R, [5.0, 2.5], atol=0.2)


LINTEL = np.array([(x, y) for x in (4.9, 5.1) for y in np.arange(1.5, 3.5, 0.04)])
L_SHAPED = [*OUTER, (4.0, 2.5, 0.0, 10.0, 5.0, 2.6)]  # what is left: 4 m wide, and an arm 2.5 m wide
NOOK = [*OUTER, (8.9, 0, 0, 9.0, 5, 2.6), (9.0, 1.2, 0, 10.0, 1.3, 2.6)]
PANE = ((5.0, 1.5), (5.0, 3.5))


@pytest.mark.parametrize(
    ("boxes", "way", "more", "areas", "passages"),
    [
        (divided(5, 5), WAY, {}, [24.5, 24.5], 0),
        (divided(1.5, 3.5), WAY, {}, [50], 0),  # a wide opening
        (divided(1.0, 4.0), WAY, {}, [50], 0),
        (divided(1.5, 3.5), WAY, {"lintel": LINTEL}, [24.5, 24.5], 1),  # a wide door, as its lintel shows
        (L_SHAPED, [(1.0, 1.0), (2.0, 4.0), (3.0, 1.5), (6.0, 1.2), (9.0, 1.2)], {}, [35], 0),
        (divided(5, 5), WAY[:3], {}, [24.5], 0),  # the other room was not reached,
        (divided(1.5, 3.5), WAY[:3], {"walls": (PANE,)}, [24.5], 0),  # but seen through a pane, across a wall
    ],
)
def test_rooms_are_parted_by_walls_and_lintels(
    boxes: list[Box], way: list[Place], more: dict[str, Any], areas: list[float], passages: int
) -> None:
    found = seen(boxes, way, **more)
    assert [room.area for room in found.rooms] == pytest.approx(areas, rel=0.07)
    assert len(found.passages) == passages


def test_a_corridor_is_a_room_of_its_own_and_small_nooks_are_none() -> None:
    """1.4 m wide, with doors to two offices."""
    walls: list[Box] = [(a, 1.4, 0, b, 1.5, 2.6) for a, b in ((0.0, 2.0), (2.9, 7.0), (7.9, 10.0))]
    way = [(1, 0.7), (2.45, 0.7), (2.45, 1.4), (2.4, 3), (5, 0.7), (7.45, 0.7), (7.45, 1.4), (7.5, 3), (9.0, 0.7)]
    found = seen([*OUTER, *walls, (4.95, 1.5, 0, 5.05, 5, 2.6)], way)
    corridor, left, right = room_at(found, (5, 0.7), (2, 3), (8, 3))
    assert len(found.rooms) == len({corridor, left, right}) == 3
    assert set(map(frozenset, found.passages)) == {frozenset({corridor, left}), frozenset({corridor, right})}
    assert room_at(seen(NOOK, [*WAY[:5], (9.5, 0.6)]), (9.5, 0.6)) == [0]


@pytest.mark.parametrize("outline", [np.empty((0, 2)), np.array([[0.1, 0.0]]), np.array([[0.1, 0.0], [0.0, 0.1]])])
def test_hardly_anything_seen_is_no_room(outline: Array) -> None:
    sensors = np.zeros((1, 2))
    space = free_space(sensors, [outline], np.empty((0, 2, 2)), [np.empty((0, 2))])
    found = segment(space, sensors, RoomSettings())
    assert not found.rooms and not found.passages and not found.labels.any()
