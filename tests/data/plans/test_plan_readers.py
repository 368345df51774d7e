"""One contract for all forms of plans: the same walls, rooms and doors; what is wrong is refused in one line."""

import io
import json
import tarfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from plan_files import COLUMNS, CORE, DOOR, FAR, PLANS, T, X, Y, dxf, feature, geojson, hall, new_drawing, read_plan
from shapely.geometry import LineString, box, mapping

from data.common.errors import UserError
from data.geometry.areas import united
from data.ifc.writer import IfcWriter
from data.plans import load_bim, read_plans
from data.plans.dxf import is_wall_layer
from data.plans.mesh_plan import read_mesh
from data.scene_graph import SceneGraph


def at(graph: SceneGraph, x: float, y: float, normal: tuple[int, int]) -> list[str | None]:
    """The rooms of the surfaces with this normal at a place."""
    found = []
    for w in graph.wall_surfaces:
        away, n = np.subtract((x, y), w.centroid), np.array(w.normal)
        if n @ normal > 0.999 and abs(away @ n) < 0.02 and abs(away @ (-n[1], n[0])) < (w.length or 0.0) / 2:
            found.append(w.room)
    return found


def assert_is_the_hall(graph: SceneGraph, dx: float = 0.0, dy: float = 0.0) -> None:
    """Every side of a wall or column that one can stand before is a surface, of the room that it bounds."""
    hall_room: set[str | None] = {r.id for r in graph.rooms if shapely.Polygon(r.polygon).area > 50}
    inside = hall_room or {None}

    def facing(x: float, y: float, nx: int, ny: int) -> list[str | None]:
        return at(graph, x + dx, y + dy, (nx, ny))

    for column in COLUMNS:
        x, y = column.centroid.coords[0]
        for nx, ny in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            assert len(found := facing(x + 0.2 * nx, y + 0.2 * ny, nx, ny)) == 1
            assert set(found) <= inside
    assert set(facing(T, 5, 1, 0)) == set(facing(X - T, 5, -1, 0)) == inside
    assert facing(X, 5, 1, 0) == facing(2, 0, 0, -1) == facing(2, Y, 0, 1) == [None]  # outdoors
    assert facing(X + 3, 4, -1, 0) == facing(X + 3.2, 4, 1, 0) == facing(-0.7, 5, -1, 0) == [None]
    assert not facing(-0.4, 5, 1, 0) and not facing(0, 5, -1, 0)  # between layers
    (core,) = {room for room in facing(X - 2, Y - T, 0, -1)}
    assert core is not None and core not in inside
    area = shapely.Polygon(graph.room_by_id[core].polygon)
    assert area.symmetric_difference(shapely.affinity.translate(CORE, dx, dy)).area < 0.6  # up to half of the door
    roomless = [w.room is None for w in graph.wall_surfaces]
    assert roomless == sorted(roomless)  # so that ids of those with a room do not depend on them


@pytest.mark.parametrize("form", PLANS)
def test_every_form_gives_the_same_walls_and_rooms(form: str, tmp_path: Path) -> None:
    graph = read_plan(PLANS[form](tmp_path, hall()))
    assert_is_the_hall(graph, *(FAR if form == "dxf block" else (0.0, 0.0)))
    if len(graph.rooms) == 2 and not form.startswith("ifc"):  # there a door is an element, and none is written
        assert {frozenset(r.id for r in graph.rooms)} == {frozenset(d.rooms) for d in graph.doors if len(d.rooms) == 2}
    heights = {w.height is None for w in graph.wall_surfaces}
    assert heights == {form.split()[0] != "ifc"}  # as the mesh has no ceiling


@pytest.mark.parametrize(("gate", "rooms"), [(5.9, 2), (6.1, 1)])
@pytest.mark.parametrize("form", ["geojson", "dxf hatches", "ifc"])
def test_a_hall_that_is_open_at_a_gate_is_a_room(form: str, gate: float, rooms: int, tmp_path: Path) -> None:
    walls = united([hall(gate), DOOR]) if form == "ifc" else hall(gate)  # an opening without a lintel is no door
    assert len(read_plan(PLANS[form](tmp_path, walls)).rooms) == rooms


@pytest.mark.parametrize(
    ("unit", "units", "metric", "guessed"),
    [
        (0.001, 4, 1, False),
        (0.3048, 2, 0, False),
        (0.01, 0, 1, True),
        (0.0254, 0, 0, True),
        (0.001, 6, 1, True),  # stated wrongly: sixteen kilometres
    ],
)
def test_units_of_drawings_given_and_guessed(
    unit: float, units: int, metric: int, guessed: bool, tmp_path: Path
) -> None:
    bim = load_bim(dxf(tmp_path / "a.dxf", hall(), "lines", unit=unit, drawing=new_drawing(units, metric)))
    assert_is_the_hall(bim.graph)
    assert any("taken to be in" in n for n in bim.notices) == guessed


@pytest.mark.parametrize("layer", ["A-WALL-FULL", "Aussenwände", "plan$0$MUR", "MAUER 24"])
def test_walls_are_on_layers_with_such_names(layer: str, tmp_path: Path) -> None:
    drawing = new_drawing()
    drawing.modelspace().add_lwpolyline([(1, 1), (2, 1), (2, 2)], close=True, dxfattribs={"layer": "FURNITURE"})
    bim = load_bim(dxf(tmp_path / "a.dxf", hall(), "outlines", layer, drawing=drawing))
    assert_is_the_hall(bim.graph)
    assert any(layer in notice for notice in bim.notices) and bim.graph.floors[0].elevation == 0.0
    assert not any(map(is_wall_layer, ["A-DOOR", "FURNITURE", "A-WALL-DIMS", "TEXT", "0", "murmur2", "Decke"]))


def test_layers_are_asked_for_where_no_name_says_it(tmp_path: Path) -> None:
    drawing = new_drawing()
    drawing.modelspace().add_line((0, 0), (5, 5), dxfattribs={"layer": "X-2"})
    path = dxf(tmp_path / "plan.dxf", hall(), "outlines", "X-1", drawing=drawing)
    with pytest.raises(UserError, match=r"--layer; there are: X-1 \(\d+\), X-2 \(1\)"):
        load_bim(path)
    with pytest.raises(UserError, match="--layer x-3: no such layer"):
        load_bim(path, layers=["x-3"])
    assert_is_the_hall(load_bim(path, layers=["x-1"]).graph)


RING = [(0, 0), (10, 0), (10, 6), (0, 6), (0, 0)]
CENTRES = [*pairwise(RING), ((6, 0), (6, 2)), ((6, 2.9), (6, 6))]
ROOMS = [box(0.3, 0.3, 6.0, 5.7), box(6.1, 0.3, 9.7, 5.7)]


def areas(graph: SceneGraph) -> list[float]:
    return sorted((shapely.Polygon(r.polygon).area for r in graph.rooms), reverse=True)


def test_walls_drawn_as_single_lines_and_with_open_ends(tmp_path: Path) -> None:
    single, double = new_drawing(), new_drawing()
    for a, b in CENTRES:
        single.modelspace().add_line(a, b, dxfattribs={"layer": "A-WALL"})
    for x in (6.0, 6.1):  # the inner wall's sides, not closed at the door
        for ends in (((x, 0.3), (x, 2.0)), ((x, 2.9), (x, 5.7))):
            double.modelspace().add_line(*ends, dxfattribs={"layer": "A-WALL"})
    for bounds in ((0, 0, 10, 6), (0.3, 0.3, 9.7, 5.7)):
        ring = list(box(*bounds).exterior.coords)
        double.modelspace().add_lwpolyline(ring[:-1], close=True, dxfattribs={"layer": "A-WALL"})
    for drawing, expected in ((single, [5.9 * 5.9, 3.9 * 5.9]), (double, [r.area for r in ROOMS])):
        drawing.saveas(tmp_path / "a.dxf")
        bim = load_bim(tmp_path / "a.dxf")
        np.testing.assert_allclose(areas(bim.graph), expected, rtol=0.02)
        assert [len(d.rooms) for d in bim.graph.doors] == [2]
        assert any("single lines" in n for n in bim.notices) == (drawing is single)
    thick = [feature(LineString(c), layer="walls", thickness=0.1) for c in CENTRES]
    assert len(load_bim(geojson(tmp_path / "thick.geojson", thick)).graph.rooms) == 2


def test_storeys_heights_and_names_of_geojson(tmp_path: Path) -> None:
    features = [
        feature(room, type="room", name=f"{storey}{k}", storey=storey, elevation=z, height=3.0)
        for storey, z in (("upper", 3.0), ("ground", 0.0))
        for k, room in enumerate(ROOMS)
    ]
    graph = load_bim(geojson(tmp_path / "two.geojson", features)).graph
    assert [(f.name, f.elevation) for f in graph.floors] == [("ground", 0.0), ("upper", 3.0)]
    upper = graph.on_floor(graph.floors[1].id)
    assert {r.name for r in upper.rooms} == {"upper0", "upper1"}
    assert {w.height for w in upper.wall_surfaces} == {(3.0, 6.0)}
    assert {(v.height(0, 0), v.is_floor, v.floor) for v in upper.level_surfaces} == {
        (3.0, True, "storey-2"), (6.0, False, "storey-2")
    }  # fmt: skip
    assert len(graph.level_surfaces) == 8 and {v.room for v in graph.level_surfaces} >= {r.id for r in graph.rooms}


@pytest.mark.parametrize(("heights", "levels"), [((3.0, 3.005), 4), ((3.0, 3.02), 0), ((None, None), 2)])
def test_levels_of_geojson_are_those_it_gives(heights: tuple[float | None, ...], levels: int, tmp_path: Path) -> None:
    rooms = [feature(r, type="room", elevation=1.0, height=h) for r, h in zip(ROOMS, heights, strict=True)]
    assert len(load_bim(geojson(tmp_path / "a.geojson", rooms)).graph.level_surfaces) == levels
    without = [feature(r, type="room", height=h) for r, h in zip(ROOMS, heights, strict=True)]
    assert load_bim(geojson(tmp_path / "b.geojson", without)).graph.level_surfaces == ()


def test_geojson_in_degrees(tmp_path: Path) -> None:
    """As an indoor map gives it: longitude and latitude, rooms that touch."""
    metres = np.array([np.cos(np.radians(47.37)), 1.0]) * np.radians(1) * 6_378_137.0
    rooms = [shapely.transform(box(*b), lambda xy: xy / metres + [8.54, 47.37]) for b in ((0, 0, 6, 6), (6, 0, 10, 6))]
    bim = load_bim(geojson(tmp_path / "map.geojson", [feature(r, indoor="room", level="0") for r in rooms]))
    np.testing.assert_allclose(areas(bim.graph), [36, 24], rtol=0.02)
    assert len(bim.graph.wall_surfaces) == 8  # also where they touch
    assert any("longitude" in n for n in bim.notices)


def json_plan(*rooms: Any, **more: Any) -> str:
    return json.dumps({"unit": "m", "rooms": [{"type": "room", "polygon": mapping(r)} for r in rooms], **more})


def line(*points: str) -> str:
    return f'{{"type": "Feature", "geometry": {{"type": "LineString", "coordinates": [{",".join(points)}]}}}}'


NO_ROOM = json.dumps({"rooms": [{"polygon": {"type": "Polygon"}}]})
DOORS = {"door": [{"polygon": mapping(box(400, 100, 410, 190))}]}
WRONG = [  # name of the file, content, part of what is said
    ("garbage.ifc", "hello", "not IFC"),
    ("a.py", "import os", "not a building"),
    ("graph.json", "{}", "not a scene graph"),
    ("a.dxf", "no drawing", "DXF"),
    ("a.geojson", "[" * 100_000, "not JSON"),
    ("a.geojson", '{"type": "FeatureCollection", "features": []}', "no features"),
    ("a.geojson", line("[0, 0]", "[1]"), "broken geometry"),
    ("a.geojson", line("[0,0]", "[1e999,0]", "[1,1]"), "finite"),
    ("a.geojson", line("[0,0]", "[90000,0]"), "extends"),
    ("a.geojson", '{"type": "Feature", "geometry": {"type": "Point", "coordinates": [0,0]}}', "not a building's size"),
    ("a.json", json_plan(box(0, 0, 4, 3), unit="mm"), "metres"),
    ("a.json", json_plan(box(0, 0, 400, 300), elements=DOORS), "doors are 90 m wide"),
    ("a.json", NO_ROOM, "not a floor plan"),
    ("a.stl", "solid nothing", "cannot be read|no triangles"),
    ("far.obj", "v 0 0 0\nv -1e308 0 3\nv 0 1e308 3\nf 1 2 3\n", "wide"),
]


@pytest.mark.parametrize(("name", "content", "message"), WRONG)
def test_wrong_plans_are_refused_in_one_line(name: str, content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(UserError, match=message) as error:
        if name.endswith((".stl", ".obj")):
            read_mesh(tmp_path / name)
        elif name == "a.json":
            list(read_plans(tmp_path / name))
        else:
            load_bim(tmp_path / name, tmp_path / "cache")
    assert str(tmp_path / name) in str(error.value) and "\n" not in str(error.value)


def test_paths_and_bodies_that_are_no_plans_are_refused(tmp_path: Path) -> None:
    IfcWriter.begun("empty", {"Ground": 0.0}).save(tmp_path / "empty.ifc")
    for path, message in ((tmp_path / "empty.ifc", "has no walls"), (tmp_path / "none.ifc", "no such file")):
        with pytest.raises(UserError, match=message):
            load_bim(path, tmp_path / "cache")
    (tmp_path / "plan.txt").write_text("x")
    (tmp_path / "none").mkdir()
    for path in (tmp_path / "missing", tmp_path / "plan.txt", tmp_path / "none"):
        with pytest.raises(UserError, match=path.name):
            list(read_plans(path))
    for extents, message in (((9, 9, 0.1), "metres"), ((9, 9, 3), "no walls"), ((9000, 9000, 3000), "metres")):
        trimesh.creation.box(extents=extents).export(tmp_path / "body.stl")
        with pytest.raises(UserError, match=message):
            read_mesh(tmp_path / "body.stl")
    bomb = new_drawing()
    block = bomb.blocks.new("SELF")
    block.add_blockref("SELF", (1, 1), dxfattribs={"row_count": 9999, "column_count": 9999, "row_spacing": 1})
    block.add_line((0, 0), (1, 0))
    bomb.modelspace().add_blockref("SELF", (0, 0), dxfattribs={"layer": "WALL"})
    bomb.saveas(tmp_path / "bomb.dxf")
    with pytest.raises(UserError, match="over 2,000,000 lines, or 50,000 blocks"):
        load_bim(tmp_path / "bomb.dxf")


def test_a_folder_leaves_out_what_it_cannot_use_and_knows_duplicates(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A plan drawn twice is one building, also where its drawing differs by centimetres."""
    flat = [box(0, 0, 4, 3), box(4.2, 0, 7.2, 3), box(0, 3.2, 4, 8.2), box(4.2, 3.2, 7.2, 7.2)]
    mirrored = [shapely.transform(room, lambda xy: xy * [-0.998, 1.0]) for room in flat]
    for name, rooms in {"a": flat, "b": [*flat[:3], box(4.2, 3.2, 7.2, 8.2)], "c": mirrored, "d": []}.items():
        (tmp_path / f"{name}.json").write_text(json_plan(*rooms, name=name))
    read_back = list(read_plans(tmp_path))
    assert [(p.name, p.building) for p in read_back] == [("a", "a"), ("b", "b"), ("c", "a")]
    assert len(caplog.messages) == 1 and "d.json" in caplog.messages[0]


def test_an_archive_is_read_without_being_unpacked(tmp_path: Path) -> None:
    """Links and paths that lead out are not followed."""
    path = tmp_path / "plans.tar.gz"
    with tarfile.open(path, "w:gz") as archive:
        for name in ("plans/one.json", "../two.json"):
            raw = json_plan(box(0, 0, 4, 3), name=name).encode()
            (member := tarfile.TarInfo(name)).size = len(raw)
            archive.addfile(member, io.BytesIO(raw))
        link = tarfile.TarInfo("plans/link.json")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        archive.addfile(link)
    assert [p.name for p in read_plans(path)] == ["plans/one.json", "../two.json"]
    assert not [*tmp_path.parent.glob("two.json")] and list(tmp_path.iterdir()) == [path]
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(UserError, match="tar archive"):
        list(read_plans(path))
