"""Floor plans of every source as A-graphs: walls on the rooms' outlines, doors, twins, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.geometry
from plans import SHARED, box

from data import SceneGraph
from data.plans import read_plans

FLOORPLANS = SHARED / "data" / "floorplans"


def drawn(polygons: list, kinds: list[str] | None = None, **elements: list) -> dict:
    """A plan in the JSON form; polygons are rings or (ring, holes)."""
    shapes = [shapely.Polygon(*p) if isinstance(p, tuple) else shapely.Polygon(p) for p in polygons]
    kinds = kinds or ["room"] * len(polygons)
    rooms = [{"type": k, "polygon": shapely.geometry.mapping(s)} for s, k in zip(shapes, kinds, strict=True)]
    parts = {k: [{"polygon": shapely.geometry.mapping(shapely.Polygon(p))} for p in v] for k, v in elements.items()}
    return {"name": "plan", "unit": "m", "rooms": rooms, "elements": parts}


def read(tmp_path: Path, plan: dict, **options: bool) -> SceneGraph:
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(plan))
    (only,) = read_plans(path, **options)
    return only.graph


def assert_walls_fit(graph: SceneGraph) -> None:
    """Every surface with a room lies on its outline or a hole in it, and its normal points into the room."""
    for surface in (w for w in graph.wall_surfaces if w.room is not None):
        (x, y), (nx, ny) = surface.centroid, surface.normal
        ring = graph.room_by_id[surface.room].polygon
        assert ring is not None
        assert shapely.Polygon(ring).buffer(0.011).contains(shapely.LineString(surface.ends()))
        assert shapely.Polygon(ring).buffer(0.011).contains(shapely.Point(x + 0.03 * nx, y + 0.03 * ny))


def test_collinear_edges_are_one_wall_and_slivers_are_none(tmp_path: Path) -> None:
    """Corners that stand out by millimetres are merged; a jog of 4 cm keeps both walls, and is none itself."""
    ring = [(0, 0), (2, 0.003), (4, 0), (4, 3), (2, 3), (2, 3.04), (0, 3.04)]
    graph = read(tmp_path, drawn([ring]))
    lengths = sorted(round(w.length or 0, 2) for w in graph.wall_surfaces)
    assert lengths == [2.0, 2.0, 3.0, 3.04, 4.0]
    assert_walls_fit(graph)
    assert len(read(tmp_path, drawn([ring]), merge_collinear=False).wall_surfaces) == len(ring)


def test_pillar_gives_surfaces_that_face_the_room(tmp_path: Path) -> None:
    """A hole's surfaces point away from it."""
    graph = read(tmp_path, drawn([(box(0, 0, 8, 6), [box(3, 2, 0.5, 0.5)])]))
    around = [w for w in graph.wall_surfaces if w.length == pytest.approx(0.5)]
    assert len(around) == 4
    for surface in around:
        out = np.array(surface.centroid) - [3.25, 2.25]
        assert out @ np.array(surface.normal) == pytest.approx(0.25)


def test_door_joins_the_rooms_on_its_sides(tmp_path: Path) -> None:
    """Across its thinner side; an outer door has one room; no wall is lost to either."""
    rooms = [box(0, 0, 4, 3), box(4.1, 0, 3, 3)]
    inner, outer = box(4.0, 1, 0.1, 0.9), box(1, -0.3, 0.9, 0.3)
    graph = read(tmp_path, drawn(rooms, door=[inner], entrance_door=[outer]))
    assert [set(d.rooms) for d in graph.doors] == [{"room0", "room1"}, {"room0"}]
    assert len(graph.wall_surfaces) == 8


def test_open_side_between_rooms_is_a_passage_not_a_wall(tmp_path: Path) -> None:
    """Where rooms touch, no wall stands, unless one is drawn there."""
    rooms = [box(0, 0, 4, 3), box(4, 1, 3, 2)]
    graph = read(tmp_path, drawn(rooms))
    assert [set(d.rooms) for d in graph.doors] == [{"room0", "room1"}]
    right = [w for w in graph.wall_surfaces if w.room == "room0" and w.normal[0] < -0.9]
    assert [w.length for w in right] == [pytest.approx(1.0)]
    assert not [w for w in graph.wall_surfaces if w.room == "room1" and w.normal[0] > 0.9]
    walled = read(tmp_path, drawn(rooms, wall=[box(3.99, 1, 0.02, 2)]))
    assert len(walled.wall_surfaces) == 8 and not walled.doors


def test_rooms_that_overlap_are_cut_and_doubles_dropped(tmp_path: Path) -> None:
    """The smaller keeps its area."""
    rooms = [box(0, 0, 8, 5), box(0, 0, 8, 5), box(6, 3, 2, 2)]
    graph = read(tmp_path, drawn(rooms))
    areas = sorted(shapely.Polygon(r.polygon).area for r in graph.rooms if r.polygon)
    assert areas == [pytest.approx(4.0), pytest.approx(36.0)]


def test_rim_around_a_neighbour_is_no_room(tmp_path: Path) -> None:
    """A room drawn with a rim of 3 cm around the next one loses the rim."""
    rim = [(0, 0), (4, 0), (4, -0.03), (7.03, -0.03), (7.03, 3.03), (4, 3.03), (4, 3), (7, 3), (7, 0), (4, 0.001),
           (4, 3), (0, 3)]  # fmt: skip
    graph = read(tmp_path, drawn([rim]))
    assert sorted(w.length or 0 for w in graph.wall_surfaces) == pytest.approx([3, 3, 4, 4], abs=0.04)


def test_outside_and_shafts_are_no_rooms(tmp_path: Path) -> None:
    """Balconies stay out, but not of the published matcher's graphs; shafts always do."""
    plan = drawn([box(0, 0, 4, 3), box(0, 4, 4, 2), box(5, 0, 1.5, 1.5)], ["bedroom", "Balcony", "shaft"])
    assert [r.name for r in read(tmp_path, plan).rooms] == ["bedroom"]
    assert [r.name for r in read(tmp_path, plan, merge_collinear=False).rooms] == ["bedroom", "Balcony"]


def test_reading_twice_gives_the_same_ids_and_numbers(tmp_path: Path) -> None:
    """Whatever corner the drawing begins with, each surface is there once."""
    ring = [(0, 0), (5, 0), (5, 2), (3, 2), (3, 4), (0, 4)]
    first, again = read(tmp_path, drawn([ring])), read(tmp_path, drawn([ring]))
    assert first == again
    turned = read(tmp_path, drawn([ring[3:] + ring[:3]]))
    assert {w.centroid for w in turned.wall_surfaces} == {w.centroid for w in first.wall_surfaces}
