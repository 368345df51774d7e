"""The S-graph that is cut from known walls and free space."""

from itertools import pairwise

import numpy as np
import pytest
from boxes import Array, Box, pose
from wall_pieces import outlines, piece

from sgslam.config import Config
from sgslam.geometry.frames import inverse, transform_points
from sgslam.mapping import KeyframeNode, Scene, WallMap
from sgslam.mapping.level_map import Register
from sgslam.mapping.scene import build_scene

HEIGHT = 0.8
BOXES: list[Box] = [  # two rooms, x 0 to 4.9 and 5.1 to 10, with a door between them; two walls go on beyond
    (-2.2, -0.2, 0, 12.2, 0, 2.6), (-2.2, 5, 0, 12.2, 5.2, 2.6), (-0.2, 0, 0, 0, 5, 2.6), (10, 0, 0, 10.2, 5, 2.6),
    (4.9, 0, 0, 5.1, 2, 2.6), (4.9, 3, 0, 5.1, 5, 2.6),
]  # fmt: skip
PIECES = [  # as seen, for each room's keyframes: normals face the room
    [((-2, 5), (12, 5)), ((-2, 0), (12, 0)), ((0, 0), (0, 5)), ((4.9, 0), (4.9, 2)), ((4.9, 3), (4.9, 5))],
    [((-2, 5), (12, 5)), ((-2, 0), (12, 0)), ((10, 0), (10, 5)), ((5.1, 0), (5.1, 2)), ((5.1, 3), (5.1, 5))],
]
WAY = [(1.0, 1.0), (2.5, 3.5), (3.5, 1.5), (4.6, 2.5), (5.4, 2.5), (7.0, 1.5), (9.0, 3.5), (7.0, 4.0)]


@pytest.fixture(scope="module", params=[0.0, 2.2])
def scene(request: pytest.FixtureRequest) -> tuple[Scene, Array]:
    """The S-graph and T_level_building; the map begins at the first keyframe, turned about."""
    T_map_building, T_level_map = inverse(pose(*WAY[0], HEIGHT, request.param)), pose(0.0, 0.0, HEIGHT)
    way, walls, keyframes = (
        [pose(*at, HEIGHT, 0.3 * i) for i, at in enumerate(WAY)],
        WallMap(Config().surfaces, Register()),
        [],
    )
    walls.T_level_map = T_level_map
    for i, (T, outline) in enumerate(zip(way, outlines(BOXES, way), strict=True)):
        keyframes.append(KeyframeNode(i, i * 10**9, T_map_building @ T, T_map_building @ T, outline))
        walls.add(i, T_map_building @ T, [piece(T, *ends) for ends in PIECES[int(T[0, 3] > 5)]])
    walls.refresh(np.stack([k.T_map_sensor for k in keyframes]), {})
    walls.join_duplicates()
    return build_scene(keyframes, walls, np.array([0, 0, 1.0, HEIGHT]), Config()), T_level_map @ T_map_building


def placed(T_level_building: Array, places: list[tuple[float, float]]) -> Array:
    points = np.column_stack([np.array(places), np.zeros(len(places))])
    return transform_points(inverse(T_level_building), points)[:, :2]


def test_there_are_two_rooms_and_a_door_between_them(scene: tuple[Scene, Array]) -> None:
    graph, T = scene[0].graph, scene[1]
    rooms = sorted(placed(T, [r.centroid for r in graph.rooms]).tolist())
    np.testing.assert_allclose(rooms, [[2.45, 2.5], [7.55, 2.5]], atol=0.15)
    assert [set(d.rooms) for d in graph.doors] == [{r.id for r in graph.rooms}]
    np.testing.assert_allclose(placed(T, [d.centroid for d in graph.doors]), [[5.0, 2.5]], atol=0.25)


def test_a_wall_is_cut_by_the_rooms_that_it_faces(scene: tuple[Scene, Array]) -> None:
    """The north wall runs past both rooms, and two metres further at either end: three surfaces, side by side."""
    graph, T = scene[0].graph, scene[1]
    found = []
    for surface in graph.wall_surfaces:
        ends = placed(T, list(surface.ends()))
        if np.abs(ends[:, 1] - 5).max() < 0.05:
            found.append((*sorted(ends[:, 0].tolist()), surface.room))
    found.sort()
    rooms = sorted(graph.rooms, key=lambda r: placed(T, [r.centroid])[0, 0])
    assert [room for _, _, room in found if room] == [r.id for r in rooms]
    assert [room for _, _, room in found].count(None) == 1
    inside = [(low, high) for low, high, room in found if room]
    np.testing.assert_allclose(inside, [(0.0, 4.9), (5.1, 10.0)], atol=0.2)
    for (_, high, _), (low, _, _) in pairwise(found):
        assert high <= low + 0.05  # nowhere two of them at one place


def test_keyframes_know_their_room_and_what_they_saw(scene: tuple[Scene, Array]) -> None:
    graph, T = scene[0].graph, scene[1]
    assert [k.stamp_ns for k in graph.keyframes] == [i * 10**9 for i in range(len(WAY))]
    for keyframe, (x, _) in zip(graph.keyframes, WAY, strict=True):
        assert keyframe.room is not None
        assert (placed(T, [graph.room_by_id[keyframe.room].centroid])[0, 0] > 5) == (x > 5)
        assert set(keyframe.observes) <= set(graph.surface_by_id) and len(keyframe.observes) >= 4
