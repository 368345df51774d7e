"""Generated buildings: valid geometry, varied, the same for the same seed."""

import numpy as np
import pytest
import shapely

from data import SceneGraph
from data.generation.buildings import KINDS, generate_plan

SEEDS = range(4)
THINNEST = 0.1


def assert_rooms_are_a_wall_apart(graph: SceneGraph) -> None:
    for floor in graph.floors:
        rooms = np.array([shapely.Polygon(r.polygon) for r in graph.rooms if r.floor == floor.id], dtype=object)
        assert all(r.is_valid and r.area > 1.0 for r in rooms)
        near = shapely.STRtree(rooms).query(rooms, predicate="dwithin", distance=THINNEST - 1e-3)
        assert np.array_equal(near[0], near[1])  # each is near itself alone


def test_outer_walls_that_meet_at_a_sharp_angle_leave_rooms() -> None:
    graph = generate_plan("skewed", 902447).graph
    assert len(graph.rooms) > 5
    assert_rooms_are_a_wall_apart(graph)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_rooms_surfaces_and_doors_fit_and_are_those_of_the_seed(kind: str) -> None:
    """Surfaces lie on the rooms' outlines and face inwards, doors stand in walls."""
    plans = [generate_plan(kind, seed) for seed in SEEDS]
    assert plans[0] == generate_plan(kind, 0)
    assert plans[0].building != plans[1].building and plans[0].graph != plans[1].graph
    for graph in (plan.graph for plan in plans):
        assert_rooms_are_a_wall_apart(graph)
        outline = {r.id: shapely.Polygon(r.polygon) for r in graph.rooms}
        for surface in graph.wall_surfaces:
            assert surface.room is not None and surface.length is not None and surface.length >= 0.05
            area, middle = outline[surface.room], np.array(surface.centroid)
            assert area.contains(shapely.Point(middle + 0.02 * np.array(surface.normal)))
            on_ring = area.exterior.distance(shapely.LineString(surface.ends())) < 1e-6
            assert on_ring or area.contains(shapely.Point(middle))  # a pillar's
        for door in graph.doors:
            assert all(0.01 < outline[r].distance(shapely.Point(door.centroid)) < 0.45 for r in door.rooms)
        if kind in ("apartment", "office", "tower"):  # doors join all rooms of a storey
            group = {r.id: r.id for r in graph.rooms}
            for door in (door for door in graph.doors if len(door.rooms) == 2):
                a, b = (group[r] for r in door.rooms)
                group = {r: a if g == b else g for r, g in group.items()}
            assert len(set(group.values())) == len(graph.floors)
        low, high = {"apartment": (3, 16), "office": (15, 100)}.get(kind, (1, 10_000))
        assert low <= len(graph.rooms) <= high and (3 <= len(graph.floors) <= 8 or kind != "tower")
