"""Generated buildings: valid geometry, varied, the same for the same seed."""

import time

import numpy as np
import pytest
import shapely

from data import SceneGraph
from data.generation.buildings import KINDS, generate_plan

SEEDS = range(4)
THINNEST = 0.1


def rooms_of(graph: SceneGraph, floor: str) -> np.ndarray:
    return np.array([shapely.Polygon(r.polygon) for r in graph.rooms if r.floor == floor], dtype=object)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [k for k in KINDS if k != "campus"])
@pytest.mark.parametrize("seed", SEEDS)
def test_geometry(kind: str, seed: int) -> None:
    """Rooms are valid and a wall apart, surfaces lie on their outlines and face inwards, doors stand in walls."""
    graph = generate_plan(kind, seed).graph
    for floor in graph.floors:
        rooms = rooms_of(graph, floor.id)
        assert all(r.is_valid and r.area > 1.0 for r in rooms)
        near = shapely.STRtree(rooms).query(rooms, predicate="dwithin", distance=THINNEST - 1e-3)
        assert np.array_equal(near[0], near[1])  # each is near itself alone
    outline = {r.id: shapely.Polygon(r.polygon) for r in graph.rooms}
    for surface in graph.wall_surfaces:
        assert surface.room is not None and surface.length is not None and surface.length >= 0.05
        area, middle = outline[surface.room], np.array(surface.centroid)
        ahead = shapely.Point(middle + 0.02 * np.array(surface.normal))
        assert area.contains(ahead)
        on_ring = area.exterior.distance(shapely.LineString(surface.ends())) < 1e-6
        assert on_ring or area.contains(shapely.Point(middle))  # a pillar's
    for door in graph.doors:
        at = shapely.Point(door.centroid)
        assert all(0.01 < outline[r].distance(at) < 0.45 for r in door.rooms)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["apartment", "office", "corridor", "l_shape", "skewed", "tower"])
def test_every_room_can_be_reached(kind: str) -> None:
    """Doors join all rooms of a storey."""
    for seed in SEEDS:
        graph = generate_plan(kind, seed).graph
        group = {r.id: r.id for r in graph.rooms}
        for door in graph.doors:
            if len(door.rooms) == 2:
                a, b = (group[r] for r in door.rooms)
                group = {r: a if g == b else g for r, g in group.items()}
        assert len(set(group.values())) == len(graph.floors)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [k for k in KINDS if k != "campus"])
def test_same_seed_same_plan(kind: str) -> None:
    """And another seed another one."""
    first = generate_plan(kind, 3)
    assert first == generate_plan(kind, 3)
    other = generate_plan(kind, 4)
    assert other.building != first.building and other.graph != first.graph


@pytest.mark.slow
def test_sizes_are_as_promised() -> None:
    """Rooms by kind."""
    rooms = {k: [len(generate_plan(k, s).graph.rooms) for s in SEEDS] for k in ("apartment", "office")}
    assert min(rooms["apartment"]) >= 3 and max(rooms["apartment"]) <= 16
    assert min(rooms["office"]) >= 15 and max(rooms["office"]) <= 100
    for seed in SEEDS:
        storeys = len(generate_plan("tower", seed).graph.floors)
        assert 3 <= storeys <= 8


def test_twins_are_mirror_images() -> None:
    """Each surface of one half has its image in the other, across one axis."""
    graph = generate_plan("mirrored_twins", 1).graph
    half = len(graph.rooms) // 2
    areas = np.array([shapely.Polygon(r.polygon).area for r in graph.rooms])
    a, b = (np.array([r.centroid for r in rooms]) for rooms in (graph.rooms[:half], graph.rooms[half : 2 * half]))
    assert np.allclose(areas[:half], areas[half : 2 * half])
    axis = (b - a)[0] / np.hypot(*(b - a)[0])
    offsets = (a + b) @ axis
    assert np.allclose(offsets, offsets[0]) and np.allclose((b - a) @ [-axis[1], axis[0]], 0, atol=1e-9)


def test_skewed_walls_are_not_at_right_angles() -> None:
    """Normals of one plan modulo 90 degrees are spread."""
    for seed in SEEDS:
        normals = np.array([w.normal for w in generate_plan("skewed", seed).graph.wall_surfaces])
        fourfold = np.exp(4j * np.arctan2(normals[:, 1], normals[:, 0]))
        assert abs(fourfold.mean()) < 0.999


@pytest.mark.slow
def test_campus_is_large_and_quick() -> None:
    """Over a thousand wall surfaces, at most 5,000; its buildings do not overlap."""
    began = time.process_time()
    graph = generate_plan("campus", 0).graph
    assert time.process_time() - began < 30.0  # 3 s on a machine of today
    assert graph == generate_plan("campus", 0).graph
    assert 1000 < len(graph.wall_surfaces) <= 5000
    rooms = rooms_of(graph, "0")
    near = shapely.STRtree(rooms).query(rooms, predicate="dwithin", distance=THINNEST - 1e-3)
    assert np.array_equal(near[0], near[1])


def test_unknown_kind_is_refused() -> None:
    """By its name."""
    with pytest.raises(ValueError, match="castle"):
        generate_plan("castle", 0)
