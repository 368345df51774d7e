"""Drawn rooms as A-graphs: walls on their outlines, doors, passages, and what is no room."""

import json
from pathlib import Path
from typing import Any

import pytest
import shapely
from plans import box
from shapely.geometry import mapping

from data import SceneGraph
from data.plans import read_plans


def read(folder: Path, *rooms: Any, kinds: str = "", merge: bool = True, **elements: Any) -> SceneGraph:
    """Rooms are rings, or polygons; elements are rings."""
    kind = kinds.split() or ["room"] * len(rooms)
    shapes = [r if isinstance(r, shapely.Polygon) else shapely.Polygon(r) for r in rooms]
    parts = {k: [{"polygon": mapping(shapely.Polygon(ring))}] for k, ring in elements.items()}
    drawn = [{"type": k, "polygon": mapping(s)} for k, s in zip(kind, shapes, strict=True)]
    (folder / "plan.json").write_text(json.dumps({"unit": "m", "rooms": drawn, "elements": parts}))
    (only,) = read_plans(folder / "plan.json", merge_collinear=merge)
    return only.graph


def lengths(graph: SceneGraph) -> list[float]:
    return sorted(w.length or 0.0 for w in graph.wall_surfaces)


def test_collinear_edges_are_one_wall_and_slivers_and_rims_are_none(tmp_path: Path) -> None:
    """Corners that stand out by millimetres are merged; a jog of 4 cm keeps both walls, and is none itself."""
    ring = [(0, 0), (2, 0.003), (4, 0), (4, 3), (2, 3), (2, 3.04), (0, 3.04)]
    assert lengths(read(tmp_path, ring)) == pytest.approx([2.0, 2.0, 3.0, 3.04, 4.0], abs=0.005)
    assert len(read(tmp_path, ring, merge=False).wall_surfaces) == len(ring)
    # a room drawn with a rim of 3 cm around the next one
    rim = [(4, -0.03), (7.03, -0.03), (7.03, 3.03), (4, 3.03), (4, 3), (7, 3), (7, 0), (4, 0.001), (4, 3), (0, 3)]
    assert lengths(read(tmp_path, [(0, 0), (4, 0), *rim])) == pytest.approx([3, 3, 4, 4], abs=0.04)


def test_a_door_joins_the_rooms_on_its_sides(tmp_path: Path) -> None:
    """Across its thinner side; an outer door has one room; no wall is lost to either."""
    inner, outer = box(4.0, 1, 0.1, 0.9), box(1, -0.3, 0.9, 0.3)
    graph = read(tmp_path, box(0, 0, 4, 3), box(4.1, 0, 3, 3), door=inner, entrance_door=outer)
    assert [set(d.rooms) for d in graph.doors] == [{"room0", "room1"}, {"room0"}]
    assert [d.width for d in graph.doors] == pytest.approx([0.9, 0.9]) and len(graph.wall_surfaces) == 8


def test_an_open_side_between_rooms_is_a_passage_unless_a_wall_is_drawn(tmp_path: Path) -> None:
    rooms = box(0, 0, 4, 3), box(4, 1, 3, 2)
    graph = read(tmp_path, *rooms)
    assert [set(d.rooms) for d in graph.doors] == [{"room0", "room1"}]
    right = [w for w in graph.wall_surfaces if w.room == "room0" and w.normal[0] < -0.9]
    assert [w.length for w in right] == [pytest.approx(1.0)]
    assert not [w for w in graph.wall_surfaces if w.room == "room1" and w.normal[0] > 0.9]
    walled = read(tmp_path, *rooms, wall=box(3.99, 1, 0.02, 2))
    assert len(walled.wall_surfaces) == 8 and not walled.doors


def test_overlaps_doubles_outside_and_shafts_are_no_rooms(tmp_path: Path) -> None:
    """Of two that overlap the smaller keeps its area. Balconies stay in the published matcher's graphs alone."""
    graph = read(tmp_path, box(0, 0, 8, 5), box(0, 0, 8, 5), box(6, 3, 2, 2))
    assert sorted(shapely.Polygon(r.polygon).area for r in graph.rooms) == pytest.approx([4.0, 36.0])
    shapes, kinds = (box(0, 0, 4, 3), box(0, 4, 4, 2), box(5, 0, 1.5, 1.5)), "bedroom Balcony shaft"
    assert [r.name for r in read(tmp_path, *shapes, kinds=kinds).rooms] == ["bedroom"]
    assert [r.name for r in read(tmp_path, *shapes, kinds=kinds, merge=False).rooms] == ["bedroom", "Balcony"]
