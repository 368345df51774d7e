"""Rooms cut from free space, in plans that are known exactly."""

from itertools import pairwise

import numpy as np
import pytest
from boxes import Array, Box, scene_of
from numpy.typing import NDArray

from sgslam.config import RoomSettings
from sgslam.mapping.free_space import Grid, free_space
from sgslam.mapping.rooms import Segmentation, segment

SETTINGS = RoomSettings()
OUTER: list[Box] = [
    (-0.2, -0.2, 0, 10.2, 0, 2.6), (-0.2, 5, 0, 10.2, 5.2, 2.6), (-0.2, 0, 0, 0, 5, 2.6), (10, 0, 0, 10.2, 5, 2.6),
]  # fmt: skip
WAY = [(1.0, 1.0), (2.5, 3.5), (3.5, 1.5), (4.6, 2.5), (5.4, 2.5), (7.0, 1.5), (9.0, 3.5), (7.0, 4.0)]


def divided(door: tuple[float, float] | None) -> list[Box]:
    """Two rooms of 5 m, walled apart at x = 5 but for a door between two places along y."""
    low, high = door or (5.0, 5.0)
    parts: list[Box] = [(4.9, 0, 0, 5.1, low, 2.6), (4.9, high, 0, 5.1, 5, 2.6)]
    return [*OUTER, *(box for box in parts if box[4] > box[1])]


def seen(
    boxes: list[Box], places: list[tuple[float, float]], lintel: Array | None = None, turn: float = 0.0
) -> Segmentation:
    """Segments what is seen of boxes from places; `lintel` (L, 2) are points over a door, `turn` turns the map."""
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    sensors = np.array(places)
    scene = scene_of(boxes)
    azimuth = np.linspace(-np.pi, np.pi, 900, endpoint=False)
    beams = np.column_stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth])
    outlines, noise = [], np.random.default_rng(0)
    for x, y in places:
        ranges = scene.distances(np.array([x, y, 1.3]), beams)
        ranges = np.minimum(ranges, 50.0) + noise.normal(0, 0.02, len(beams))
        outlines.append((beams[:, :2] * ranges[:, None] + [x, y]) @ R.T)
    sides = np.array([edge for box in boxes for edge in _edges(box)])
    lintels = [np.empty((0, 2)) if lintel is None else lintel @ R.T] * len(places)
    space = free_space(sensors @ R.T, outlines, sides @ R.T, lintels, SETTINGS)
    return segment(space, sensors @ R.T, SETTINGS)


def _edges(box: Box) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    x0, y0, _, x1, y1, _ = box
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
    return list(pairwise(corners))


def room_at(segmentation: Segmentation, *places: tuple[float, float]) -> list[int]:
    return segmentation.grid.look_up(segmentation.labels, np.array(places)).tolist()


@pytest.mark.parametrize("turn", [0.0, 0.6, 2.2])
@pytest.mark.parametrize("width", [0.8, 1.0, 1.2])
def test_rooms_joined_by_a_door_are_two_with_one_passage(width: float, turn: float) -> None:
    found = seen(divided((2.5 - width / 2, 2.5 + width / 2)), WAY, turn=turn)
    assert len(found.rooms) == 2
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    centroids = sorted((room.centroid @ R).tolist() for room in found.rooms)
    np.testing.assert_allclose(centroids, [[2.45, 2.5], [7.55, 2.5]], atol=0.1)
    np.testing.assert_allclose([room.area for room in found.rooms], 24.5, rtol=0.06)
    assert len(found.passages) == 1
    assert set(found.passages[0].rooms) == {room.label for room in found.rooms}
    np.testing.assert_allclose(found.passages[0].middle @ R, [5.0, 2.5], atol=0.2)


def test_rooms_without_a_door_have_no_passage() -> None:
    found = seen(divided(None), WAY)
    assert len(found.rooms) == 2 and found.passages == []
    assert len(set(room_at(found, (2, 2), (8, 2)))) == 2


def test_an_outline_is_the_rooms_own() -> None:
    found = seen(divided((2.0, 3.0)), WAY)
    for room in found.rooms:
        low, high = room.polygon.min(axis=0), room.polygon.max(axis=0)
        x0, x1 = (0.0, 4.9) if room.centroid[0] < 5 else (5.1, 10.0)
        np.testing.assert_allclose([low[1], high[1]], [0, 5], atol=0.12)
        assert x0 - 0.15 < low[0] < x0 + 0.15 and x1 - 0.15 < high[0] < x1 + 0.15


@pytest.mark.parametrize("opening", [(1.5, 3.5), (1.0, 4.0)])
def test_a_wide_opening_joins(opening: tuple[float, float]) -> None:
    found = seen(divided(opening), WAY)
    assert len(found.rooms) == 1 and found.passages == []
    assert found.rooms[0].area == pytest.approx(50, rel=0.06)


def test_a_wide_door_parts_where_its_lintel_is_seen() -> None:
    y = np.arange(1.5, 3.5, 0.04)
    lintel = np.concatenate([np.column_stack([np.full(len(y), x), y]) for x in (4.9, 5.1)])
    found = seen(divided((1.5, 3.5)), WAY, lintel)
    assert len(found.rooms) == 2
    assert len(found.passages) == 1
    np.testing.assert_allclose(found.passages[0].middle, [5.0, 2.5], atol=0.2)


def test_an_l_shaped_room_stays_one() -> None:
    boxes = [*OUTER, (4.0, 2.5, 0.0, 10.0, 5.0, 2.6)]  # what is left: 4 m wide, and an arm 2.5 m wide
    found = seen(boxes, [(1.0, 1.0), (2.0, 4.0), (3.0, 1.5), (6.0, 1.2), (9.0, 1.2)])
    assert len(found.rooms) == 1 and found.passages == []
    assert found.rooms[0].area == pytest.approx(35, rel=0.06)


def test_a_corridor_is_a_room_of_its_own() -> None:
    """1.4 m wide, with doors to two offices."""
    walls: list[Box] = []
    for a, b in ((0.0, 2.0), (2.9, 7.0), (7.9, 10.0)):
        walls.append((a, 1.4, 0, b, 1.5, 2.6))
    boxes = [*OUTER, *walls, (4.95, 1.5, 0, 5.05, 5, 2.6)]
    way = [(1, 0.7), (2.45, 0.7), (2.45, 1.4), (2.4, 3), (5, 0.7), (7.45, 0.7), (7.45, 1.4), (7.5, 3), (9.0, 0.7)]
    found = seen(boxes, way)
    assert len(found.rooms) == 3
    corridor, left, right = room_at(found, (5, 0.7), (2, 3), (8, 3))
    assert len({corridor, left, right}) == 3
    assert {frozenset(p.rooms) for p in found.passages} == {frozenset({corridor, left}), frozenset({corridor, right})}


def test_free_space_that_was_not_reached_is_left_out() -> None:
    """Seen through a slit 5 cm wide that no wall piece fills; and seen through a pane, across a wall."""
    boxes = divided(None)
    found = seen(boxes, WAY[:3])
    assert len(found.rooms) == 1 and found.rooms[0].centroid[0] < 5
    pane = [*OUTER, (4.9, 0, 0, 5.1, 1.5, 2.6), (4.9, 3.5, 0, 5.1, 5, 2.6)]  # the sensor looks through it,
    walls = np.array([edge for box in pane for edge in _edges(box)] + [((5.0, 1.5), (5.0, 3.5))])  # a wall stands
    scene, sensors = scene_of(pane), np.array(WAY[:3])
    azimuth = np.linspace(-np.pi, np.pi, 900, endpoint=False)
    beams = np.column_stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth])
    outlines = [beams[:, :2] * scene.distances(np.array([*s, 1.3]), beams)[:, None] + s for s in sensors]
    found = segment(free_space(sensors, outlines, walls, [np.empty((0, 2))] * 3, SETTINGS), sensors, SETTINGS)
    assert len(found.rooms) == 1
    assert room_at(found, (8.0, 2.5)) == [0]


def test_small_nooks_are_no_rooms() -> None:
    boxes = [*OUTER, (8.9, 0, 0, 9.0, 5, 2.6), (9.0, 1.2, 0, 10.0, 1.3, 2.6)]
    found = seen(boxes, [*WAY[:5], (9.5, 0.6)])
    assert all(room.area >= SETTINGS.min_area for room in found.rooms)
    assert room_at(found, (9.5, 0.6)) == [0]


@pytest.mark.parametrize("outline", [np.empty((0, 2)), np.array([[0.1, 0.0]]), np.array([[0.1, 0.0], [0.0, 0.1]])])
def test_hardly_anything_seen_is_no_room(outline: NDArray[np.float64]) -> None:
    sensors = np.zeros((1, 2))
    space = free_space(sensors, [outline], np.empty((0, 2, 2)), [np.empty((0, 2))], SETTINGS)
    found = segment(space, sensors, SETTINGS)
    assert found.rooms == [] and found.passages == [] and not found.labels.any()


def test_cells_and_places_go_both_ways() -> None:
    grid = Grid.around(np.array([[-3.0, 2.0], [4.0, 9.0]]), 0.05)
    cells = np.array([[0, 0], [17, 3], [grid.shape[1] - 1, grid.shape[0] - 1]], dtype=np.int32)
    np.testing.assert_array_equal(grid.to_cells(grid.to_points(cells)), cells)
    image = np.arange(grid.shape[0] * grid.shape[1], dtype=np.int32).reshape(grid.shape)
    assert grid.look_up(image, grid.to_points(cells))[1] == 3 * grid.shape[1] + 17
    assert grid.look_up(image, np.array([[1e3, 1e3]])) == image[-1, -1]  # clipped
