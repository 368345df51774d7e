"""Plans without IFC: DXF drawn by ezdxf and GeoJSON, in every way in which a drawing may tell the same two rooms."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, box, mapping

from data.common.errors import UserError
from data.plans import load_bim
from data.plans.dxf import is_wall_layer
from data.scene_graph import SceneGraph

# two rooms, 5.7 x 5.4 m and 3.6 x 5.4 m, between outer walls of 0.3 m and an inner one of 0.1 m with a door of 0.9 m
AREAS = [5.7 * 5.4, 3.6 * 5.4]
WALLS = shapely.difference(
    box(0, 0, 10, 6), shapely.union_all([box(0.3, 0.3, 6.0, 5.7), box(6.1, 0.3, 9.7, 5.7), box(5.9, 2, 6.2, 2.9)])
)  # fmt: skip
RING_LINES = [list(r.coords) for p in shapely.get_parts(WALLS) for r in (p.exterior, *p.interiors)]
CENTRES = [[(0, 0), (10, 0)], [(10, 0), (10, 6)], [(10, 6), (0, 6)], [(0, 6), (0, 0)], [(6, 0), (6, 2)],
           [(6, 2.9), (6, 6)]]  # fmt: skip


def faults(graph: SceneGraph, offset: tuple[float, float] = (0.0, 0.0), tolerance: float = 0.02) -> list[str]:
    """What differs from the two rooms, moved by an offset (m): areas by a share, sides by half as many metres."""
    areas = sorted((shapely.Polygon(r.polygon).area for r in graph.rooms), reverse=True)
    if len(areas) != len(AREAS) or not np.allclose(areas, AREAS, rtol=tolerance, atol=0):
        return [f"areas {areas}"]
    doors = [len(door.rooms) for door in graph.doors]
    off = _off_sides(graph, offset)
    wrong = [f"side {normal}: {metres} m off" for normal, metres in off.items() if not metres <= tolerance / 2 + 1e-6]
    return wrong if doors == [2] else [*wrong, f"doors between {doors} rooms"]


def _off_sides(graph: SceneGraph, offset: tuple[float, float]) -> dict[tuple[int, int], float]:
    """How far (m) each side of the left room, by its normal, lies from its place."""
    left = next(r for r in graph.rooms if abs(r.centroid[0] - offset[0] - 3.15) < 0.1)
    sides = {(round(w.normal[0]), round(w.normal[1])): w for w in graph.surfaces_of_room[left.id]}
    expected = {(1, 0): 0.3, (-1, 0): 6.0, (0, 1): 0.3, (0, -1): 5.7}
    axes = {normal: 0 if normal[0] else 1 for normal in expected}
    return {n: abs(sides[n].centroid[axes[n]] - offset[axes[n]] - place) for n, place in expected.items()}


def draw(path: Path, scale: float = 1.0, units: int | None = 6, metric: int = 1, layer: str = "A-WALL") -> Any:
    drawing = ezdxf.new("R2010")
    drawing.header["$MEASUREMENT"] = metric
    drawing.header["$INSUNITS"] = 0 if units is None else units
    drawing.layers.add(layer)
    return drawing


def scaled(points: Any, scale: float) -> list[tuple[float, float]]:
    return [(float(x * scale), float(y * scale)) for x, y in points]


@pytest.mark.parametrize("layer", ["A-WALL-FULL", "Aussenwände", "plan$0$MUR", "MAUER 24"])
def test_outlines_of_walls_on_a_layer_with_such_a_name(layer: str, tmp_path: Path) -> None:
    drawing = draw(tmp_path, layer=layer)
    for ring in RING_LINES:
        drawing.modelspace().add_lwpolyline(ring[:-1], close=True, dxfattribs={"layer": layer})
    drawing.modelspace().add_lwpolyline([(1, 1), (2, 1), (2, 2)], close=True, dxfattribs={"layer": "FURNITURE"})
    drawing.saveas(tmp_path / "plan.dxf")
    bim = load_bim(tmp_path / "plan.dxf")
    assert faults(bim.graph) == []
    assert any(layer in notice for notice in bim.notices) and bim.graph.floors[0].elevation == 0.0
    assert all(w.height is None for w in bim.graph.wall_surfaces)


@pytest.mark.parametrize(
    ("unit", "units", "metric"),
    [(0.001, 4, 1), (0.01, 5, 1), (0.0254, 1, 0), (0.3048, 2, 0),  # told
     (0.001, None, 1), (0.01, None, 1), (1.0, None, 1), (0.0254, None, 0), (0.3048, None, 0),  # guessed
     (0.001, 6, 1)],  # told wrongly: ten kilometres
)  # fmt: skip
def test_units_given_and_guessed(unit: float, units: int | None, metric: int, tmp_path: Path) -> None:
    drawing = draw(tmp_path, units=units, metric=metric)
    for ring in RING_LINES:
        for a, b in pairwise(ring):
            drawing.modelspace().add_line(*scaled([a, b], 1 / unit), dxfattribs={"layer": "A-WALL"})
    drawing.saveas(tmp_path / "plan.dxf")
    bim = load_bim(tmp_path / "plan.dxf")
    assert faults(bim.graph) == []
    assert any("taken to be in" in n for n in bim.notices) == (units is None or (units == 6 and unit != 1.0))


def test_blocks_hatches_and_polylines_make_the_same_walls(tmp_path: Path) -> None:
    drawing = draw(tmp_path)
    block = drawing.blocks.new("HOUSE")
    inner = drawing.blocks.new("INNER")  # one block within the other, turned back
    hatch = inner.add_hatch(dxfattribs={"layer": "0"})
    for ring in RING_LINES:
        hatch.paths.add_polyline_path(ring[:-1], is_closed=True)
    block.add_blockref("INNER", (0, 0), dxfattribs={"rotation": -30, "layer": "0"})
    attributes = {"rotation": 30, "layer": "A-WALL"}
    drawing.modelspace().add_blockref("HOUSE", (4_000_000.0, 5_500_000.0), dxfattribs=attributes)
    drawing.saveas(tmp_path / "plan.dxf")
    assert faults(load_bim(tmp_path / "plan.dxf").graph, (4_000_000.0, 5_500_000.0)) == []


def test_single_lines_and_open_ends(tmp_path: Path) -> None:
    drawing = draw(tmp_path)
    for a, b in CENTRES:
        drawing.modelspace().add_line(a, b, dxfattribs={"layer": "A-WALL"})
    drawing.saveas(tmp_path / "centre.dxf")
    bim = load_bim(tmp_path / "centre.dxf")
    areas = sorted((shapely.Polygon(r.polygon).area for r in bim.graph.rooms), reverse=True)
    np.testing.assert_allclose(areas, [5.9 * 5.9, 3.9 * 5.9], rtol=0.02)
    assert any("single lines" in n for n in bim.notices) and len(bim.graph.doors) == 1

    drawing = draw(tmp_path)
    for x in (6.0, 6.1):  # the inner wall's sides, not closed at the door
        drawing.modelspace().add_line((x, 0.3), (x, 2.0), dxfattribs={"layer": "A-WALL"})
        drawing.modelspace().add_line((x, 2.9), (x, 5.7), dxfattribs={"layer": "A-WALL"})
    for bounds in ((0, 0, 10, 6), (0.3, 0.3, 9.7, 5.7)):
        ring = list(box(*bounds).exterior.coords)
        drawing.modelspace().add_lwpolyline(ring[:-1], close=True, dxfattribs={"layer": "A-WALL"})
    drawing.saveas(tmp_path / "open.dxf")
    assert faults(load_bim(tmp_path / "open.dxf").graph) == []


def test_layers_are_named_where_no_name_tells(tmp_path: Path) -> None:
    drawing = draw(tmp_path)
    for ring in RING_LINES:
        drawing.modelspace().add_lwpolyline(ring[:-1], close=True, dxfattribs={"layer": "X-1"})
    drawing.modelspace().add_line((0, 0), (5, 5), dxfattribs={"layer": "X-2"})
    drawing.saveas(tmp_path / "plan.dxf")
    with pytest.raises(UserError, match=r"--layer; there are: X-1 \(\d+\), X-2 \(1\)"):
        load_bim(tmp_path / "plan.dxf")
    with pytest.raises(UserError, match="--layer x-3: no such layer"):
        load_bim(tmp_path / "plan.dxf", layers=["x-3"])
    assert faults(load_bim(tmp_path / "plan.dxf", layers=["x-1"]).graph) == []


def test_names_of_layers() -> None:
    told = ["WALL", "A-WALL-EXTR", "I-WALL", "Wand_tragend", "INNENWÄNDE", "MUR-01", "muros", "A-GLAZ", "x$0$S-COLUMN"]
    assert all(map(is_wall_layer, told))
    assert not any(map(is_wall_layer, ["A-DOOR", "FURNITURE", "A-WALL-DIMS", "TEXT", "0", "murmur2", "Decke"]))


def test_broken_drawings_are_one_line(tmp_path: Path) -> None:
    for name, content in {"a.dxf": b"no drawing", "b.dxf": b"", "c.dxf": b"AC1027\x00\x00"}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(UserError, match="DXF") as told:
            load_bim(tmp_path / name)
        assert "\n" not in str(told.value)
    drawing = draw(tmp_path)
    block = drawing.blocks.new("SELF")
    block.add_blockref("SELF", (1, 1), dxfattribs={"row_count": 9999, "column_count": 9999, "row_spacing": 1})
    block.add_line((0, 0), (1, 0))
    drawing.modelspace().add_blockref("SELF", (0, 0), dxfattribs={"layer": "WALL"})
    drawing.saveas(tmp_path / "bomb.dxf")
    with pytest.raises(UserError, match="over 2,000,000 lines or 50,000 blocks"):
        load_bim(tmp_path / "bomb.dxf")


def feature(shape: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": mapping(shape), "properties": properties}


def save(path: Path, features: list[dict[str, Any]]) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


ROOMS = [box(0.3, 0.3, 6.0, 5.7), box(6.1, 0.3, 9.7, 5.7)]


def test_geojson_with_rooms_walls_and_doors(tmp_path: Path) -> None:
    told = {"storey": "2", "elevation": 7.5, "height": 3.0}
    features = [feature(r, type="room", name=f"R{k}", **told) for k, r in enumerate(ROOMS)]
    features += [feature(WALLS, type="wall", **told), feature(box(6.0, 2.0, 6.1, 2.9), type="door", **told)]
    bim = load_bim(save(tmp_path / "plan.geojson", features))
    assert faults(bim.graph) == []
    assert [(f.name, f.elevation) for f in bim.graph.floors] == [("2", 7.5)]
    assert {r.name for r in bim.graph.rooms} == {"R0", "R1"} and bim.graph.wall_surfaces[0].height == (7.5, 10.5)


def test_geojson_with_walls_alone(tmp_path: Path) -> None:
    assert faults(load_bim(save(tmp_path / "areas.json", [feature(WALLS, kind="Wall")])).graph) == []
    lines = [feature(LineString(ring), element="wall") for ring in RING_LINES]
    assert faults(load_bim(save(tmp_path / "lines.geojson", lines)).graph) == []
    thick = [feature(LineString(c), layer="walls", thickness=0.1) for c in CENTRES]
    assert len(load_bim(save(tmp_path / "thick.geojson", thick)).graph.rooms) == 2


def test_geojson_in_degrees(tmp_path: Path) -> None:
    """As an indoor map gives it: longitude and latitude, rooms that touch."""
    metres = np.array([np.cos(np.radians(47.37)), 1.0]) * np.radians(1) * 6_378_137.0
    rooms = [box(0, 0, 6, 6), box(6, 0, 10, 6)]
    features = [
        feature(shapely.transform(r, lambda xy: xy / metres + [8.54, 47.37]), indoor="room", level="0") for r in rooms
    ]
    bim = load_bim(save(tmp_path / "map.geojson", features))
    areas = sorted((shapely.Polygon(r.polygon).area for r in bim.graph.rooms), reverse=True)
    np.testing.assert_allclose(areas, [36, 24], rtol=0.02)
    assert len(bim.graph.wall_surfaces) == 8  # also where they touch
    assert any("longitude" in n for n in bim.notices)


def test_geojson_of_several_storeys(tmp_path: Path) -> None:
    features = [feature(r, storey=s, elevation=z) for s, z in (("upper", 3.0), ("ground", 0.0)) for r in ROOMS]
    graph = load_bim(save(tmp_path / "two.geojson", features)).graph
    assert [(f.name, f.elevation) for f in graph.floors] == [("ground", 0.0), ("upper", 3.0)]
    assert len(graph.on_floor(graph.floors[1].id).rooms) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "not JSON"),
        ("{}", "not GeoJSON"),
        ('{"type": "FeatureCollection", "features": []}', "no features"),
        ('{"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [1]]]}}', "broken geometry"),
        ('{"type": "Feature", "geometry": {"type": "LineString", "coordinates": [[0,0],[1e999,0],[1,1]]}}', "finite"),
        ('{"type": "Feature", "geometry": {"type": "LineString", "coordinates": [[0,0],[90000,0]]}}', "extends"),
        ('{"type": "Feature", "geometry": {"type": "Point", "coordinates": [0,0]}}', "not a building's size"),
    ],
)
def test_geojson_that_is_none(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.geojson").write_text(text)
    with pytest.raises(UserError, match=message) as told:
        load_bim(tmp_path / "a.geojson")
    assert "\n" not in str(told.value)


def test_a_floor_plan_in_json_is_a_building_too(tmp_path: Path) -> None:
    rooms = [{"name": f"r{k}", "polygon": mapping(r)} for k, r in enumerate(ROOMS)]
    (tmp_path / "plan.json").write_text(json.dumps({"name": "p", "rooms": rooms}))
    assert len(load_bim(tmp_path / "plan.json").graph.rooms) == 2
