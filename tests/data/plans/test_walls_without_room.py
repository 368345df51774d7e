"""Walls and columns have surfaces wherever one can stand before them, whether or not they bound a room."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.geometry

from data.generation.halls import KINDS, generate_hall, write_hall
from data.generation.plan_mesh import extruded
from data.geometry.areas import difference, united
from data.ifc.graph import read_ifc
from data.ifc.writer import IfcWriter, Prism, box
from data.plans.bim import load_bim
from data.plans.mesh_plan import read_mesh
from data.scene_graph import SceneGraph

X, Y, T, TOP = 16.0, 11.0, 0.3, 2.8
CORE = shapely.box(X - 5, Y - 4, X - T, Y - T)  # the only room of the plan
COLUMNS = [shapely.box(x - 0.2, y - 0.2, x + 0.2, y + 0.2) for x in (4.0, 9.0) for y in (3.0, 6.5)]
FENCE, LAYER = shapely.box(X + 3, 1, X + 3.2, 7), shapely.box(-0.7, 1, -0.4, 9)  # the layer is 0.4 m from the wall
DOOR = shapely.box(X - 4, Y - 4.2, X - 3, Y - 4)


def hall(gate: float = 4.0) -> shapely.MultiPolygon:
    """A hall with a core, open at a gate in the south, four columns, a wall in the yard and another before the hall."""
    outer = shapely.box(0, 0, X, Y)
    ring = difference(outer, outer.buffer(-T, join_style="mitre"))
    core = difference(shapely.box(X - 5.2, Y - 4.2, X, Y), CORE)
    return difference(united([ring, core, *COLUMNS, FENCE, LAYER]), united([shapely.box(5, -1, 5 + gate, 1), DOOR]))


def geojson(folder: Path, walls: shapely.MultiPolygon, rooms: bool) -> SceneGraph:
    features = [("wall", p) for p in shapely.get_parts(walls)] + [("door", DOOR)] + [("room", CORE)] * rooms
    of = [{"type": "Feature", "properties": {"kind": k}, "geometry": shapely.geometry.mapping(p)} for k, p in features]
    (folder / "plan.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": of}))
    return load_bim(folder / "plan.geojson").graph


def floor_plan(folder: Path, walls: shapely.MultiPolygon) -> SceneGraph:
    elements = {
        "wall": [{"polygon": shapely.geometry.mapping(walls)}], "door": [{"polygon": shapely.geometry.mapping(DOOR)}],
    }  # fmt: skip
    rooms = [{"type": "store", "polygon": shapely.geometry.mapping(CORE)}]
    (folder / "plan.json").write_text(json.dumps({"unit": "m", "rooms": rooms, "elements": elements}))
    return load_bim(folder / "plan.json").graph


def dxf(folder: Path, walls: shapely.MultiPolygon) -> SceneGraph:
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = 6
    for polygon in shapely.get_parts(walls):
        hatch = drawing.modelspace().add_hatch(dxfattribs={"layer": "WALL"})
        for ring in (polygon.exterior, *polygon.interiors):
            hatch.paths.add_polyline_path(list(ring.coords), is_closed=True)
    drawing.saveas(folder / "plan.dxf")
    return load_bim(folder / "plan.dxf").graph


def ifc(folder: Path, walls: shapely.MultiPolygon, rooms: bool) -> SceneGraph:
    writer = IfcWriter("hall", {"Ground": 0.0})
    for polygon in shapely.get_parts(walls):
        pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
        body = [Prism(tuple(p.exterior.coords[:-1]), 0.0, TOP) for p in pieces]
        writer.element("IfcColumn" if polygon.area < 0.2 else "IfcWall", "", "Ground", body)
    if rooms:
        x0, y0, x1, y1 = CORE.bounds
        writer.space("Core", "Ground", box(x0, y0, 0.0, x1, y1, TOP))
    writer.save(folder / "plan.ifc")
    return read_ifc(folder / "plan.ifc")[0]


def mesh(folder: Path, walls: shapely.MultiPolygon) -> SceneGraph:
    import trimesh

    floor, lintel = extruded(shapely.box(0, 0, X, Y), -0.2, 0.0), extruded(DOOR, 2.1, TOP)
    triangles = np.concatenate([floor, lintel, extruded(walls, 0.0, TOP)])
    trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles)).export(folder / "hall.stl")
    return read_mesh(folder / "hall.stl").graph


READERS: dict[str, Callable[[Path, shapely.MultiPolygon], SceneGraph]] = {
    "geojson": lambda f, w: geojson(f, w, rooms=False), "geojson with rooms": lambda f, w: geojson(f, w, rooms=True),
    "floor plan": floor_plan, "dxf": dxf, "ifc": lambda f, w: ifc(f, w, rooms=False),
    "ifc with rooms": lambda f, w: ifc(f, w, rooms=True), "mesh": mesh,
}  # fmt: skip


def at(graph: SceneGraph, x: float, y: float, normal: tuple[int, int]) -> list[str | None]:
    """The rooms of the surfaces with this normal at a place."""
    found = []
    for w in graph.wall_surfaces:
        away, n = np.subtract((x, y), w.centroid), np.array(w.normal)
        if n @ normal > 0.999 and abs(away @ n) < 0.02 and abs(away @ (-n[1], n[0])) < (w.length or 0.0) / 2:
            found.append(w.room)
    return found


@pytest.mark.parametrize("reader", READERS)
def test_every_side_of_a_wall_or_column_that_one_can_stand_before_is_a_surface(reader: str, tmp_path: Path) -> None:
    graph = READERS[reader](tmp_path, hall())
    hall_room: set[str | None] = {r.id for r in graph.rooms if shapely.Polygon(r.polygon).area > 50}
    inside = hall_room or {None}
    for column in COLUMNS:
        x, y = column.centroid.coords[0]
        for nx, ny in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            assert len(found := at(graph, x + 0.2 * nx, y + 0.2 * ny, (nx, ny))) == 1
            assert set(found) <= inside
    assert set(at(graph, T, 5, (1, 0))) == set(at(graph, X - T, 5, (-1, 0))) == inside
    assert at(graph, X, 5, (1, 0)) == at(graph, 2, 0, (0, -1)) == at(graph, 2, Y, (0, 1)) == [None]  # outdoors
    assert at(graph, X + 3, 4, (-1, 0)) == at(graph, X + 3.2, 4, (1, 0)) == at(graph, -0.7, 5, (-1, 0)) == [None]
    assert not at(graph, -0.4, 5, (1, 0)) and not at(graph, 0, 5, (-1, 0))  # between layers
    (core,) = {room for room in at(graph, X - 2, Y - T, (0, -1))}
    assert core is not None and core not in inside
    roomless = [w.room is None for w in graph.wall_surfaces]
    assert roomless == sorted(roomless)  # so that ids of those with a room do not depend on them


@pytest.mark.parametrize(("gate", "rooms"), [(5.9, 2), (6.1, 1)])
@pytest.mark.parametrize("reader", ["geojson", "dxf", "ifc"])
def test_a_hall_that_is_open_at_a_gate_is_a_room(reader: str, gate: float, rooms: int, tmp_path: Path) -> None:
    walls = united([hall(gate), DOOR]) if reader == "ifc" else hall(gate)  # an opening without a lintel is no door
    graph = READERS[reader](tmp_path, walls)
    assert len(graph.rooms) == rooms


def test_a_floor_that_is_exported_as_a_wall_is_no_wall(tmp_path: Path) -> None:
    graphs = []
    for floors in (0, 1):
        writer = IfcWriter("floors", {"Ground": 0.0})
        for x0, y0, x1, y1 in ((0, 0, 6, 0.3), (0, 4, 6, 4.3), (0, 0.3, 0.3, 4), (5.7, 0.3, 6, 4)):
            writer.element("IfcWall", "", "Ground", [box(x0, y0, 0.0, x1, y1, TOP)])
        for low, high in ((-0.3, 0.0), (1.0, 1.35)) * floors:  # a floor and a platform
            writer.element("IfcWall", "", "Ground", [box(2, 1, low, 4, 3, high)])
        writer.save(tmp_path / "plan.ifc")
        graphs.append(read_ifc(tmp_path / "plan.ifc")[0])
    planes = [[(w.plane, w.length, w.height) for w in graph.wall_surfaces] for graph in graphs]
    assert planes[0] == planes[1] and len(planes[0]) == 8 and len(graphs[1].rooms) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_a_generated_hall_is_the_same_each_time(kind: str, tmp_path: Path) -> None:
    for name in ("one", "other"):
        write_hall(generate_hall(kind, 0), tmp_path / f"{name}.stl", tmp_path / f"{name}.geojson")
    assert (tmp_path / "one.geojson").read_bytes() == (tmp_path / "other.geojson").read_bytes()
    assert (tmp_path / "one.stl").read_bytes() == (tmp_path / "other.stl").read_bytes()
    assert max(shapely.Polygon(r.polygon).area for r in load_bim(tmp_path / "one.geojson").graph.rooms) > 400
