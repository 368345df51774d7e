"""IFC models as A-graphs: small models against their truth, real ones against what must always hold."""

import json
import math
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import shapely
from ifc_models import IfcModel, box
from numpy.typing import NDArray

from data import SceneGraph, UserError, WallSurface
from data.ifc.graph import read_ifc
from data.plans import load_bim

SHARED = Path(__file__).parents[4] / "shared"
SCHEMA = Path(__file__).parents[3] / "data" / "scene_graph" / "scene_graph.schema.json"
REAL = sorted((SHARED / "data" / "ifc").glob("*.ifc"))
Side = tuple[str, float, float, float, float]  # room, normal x y, offset along the normal, length


def placed(yaw: float, x: float, y: float, z: float) -> NDArray[np.float64]:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def two_rooms(model: IfcModel, z: float, name: str, spaces: str = "AB") -> None:
    """A and B, 4 m x 5 m each, 0.2 m between them with a door; outer door into B; no west wall."""
    storey = model.storey(name, z)
    wall, height = "IfcWallStandardCase", (z, z + 2.7)
    south = [model.prism(wall, box(-0.3, -0.3, 3, 0), height, storey)]
    south.append(model.prism(wall, box(3, -0.3, 8.5, 0), height, storey))
    model.prism("IfcWall", box(-0.3, 5, 8.5, 5.3), height, storey)
    model.prism(wall, box(8.2, 0, 8.5, 5), height, storey)
    partition = model.prism(wall, box(4, 0, 4.2, 5), height, storey)
    model.opening(partition, box(3.9, 2, 4.3, 2.9), (z, z + 2.1), "IfcDoor")
    model.opening(south[0], box(1, -0.4, 2, 0.1), (z + 0.9, z + 2.2), "IfcWindow")
    model.opening(south[1], box(6, -0.4, 7, 0.1), (z, z + 2.1), "IfcDoor")
    for room, area in (("A", box(0, 0, 4, 5)), ("B", box(4.2, 0, 8.2, 5))):
        if room in spaces:
            model.prism("IfcSpace", area, (z, z + 2.5), storey, f"{name}-{room}")


TWO_ROOMS: list[Side] = [
    ("A", 1, 0, 0.0, 5.0), ("A", -1, 0, -4.0, 5.0), ("A", 0, 1, 0.0, 4.0), ("A", 0, -1, -5.0, 4.0),
    ("B", 1, 0, 4.2, 5.0), ("B", -1, 0, -8.2, 5.0), ("B", 0, 1, 0.0, 4.0), ("B", 0, -1, -5.0, 4.0),
]  # fmt: skip


def house(path: Path, unit: str, T: NDArray[np.float64]) -> SceneGraph:
    """Two storeys of two rooms; the west wall is one wall through both."""
    model = IfcModel(unit, T)
    two_rooms(model, 0.0, "ground", "AB")
    two_rooms(model, 3.0, "first", "AB")
    model.prism("IfcWall", box(-0.3, 0, 0, 5), (0.0, 5.7), model.file.by_type("IfcBuildingStorey")[0])
    return read_ifc(model.save(path))[0]


def indoors(graph: SceneGraph) -> list[WallSurface]:
    """The surfaces that face the building's inside; all of them in a building without rooms."""
    hull = shapely.MultiPoint([end for w in graph.wall_surfaces for end in w.ends()]).convex_hull
    before = [shapely.Point(np.add(w.centroid, np.multiply(0.4, w.normal))) for w in graph.wall_surfaces]
    faced = zip(graph.wall_surfaces, before, strict=True)
    return [w for w, point in faced if w.room is not None or hull.contains(point) or not graph.rooms]


def sides(graph: SceneGraph, T: NDArray[np.float64]) -> list[Side]:
    """The graph's surfaces indoors in the building's axes."""
    found = []
    for w in indoors(graph):
        assert w.plane is not None and w.length is not None
        normal, mid = T[:2, :2].T @ w.normal, T[:2, :2].T @ (np.array(w.centroid) - T[:2, 3])
        assert w.plane[:3] == (*w.normal, 0.0)
        assert w.plane[3] == pytest.approx(-float(np.dot(w.normal, w.centroid)), abs=1e-6)
        room = graph.room_by_id[w.room].name if w.room else ""
        found.append((room, *normal.tolist(), float(normal @ mid), w.length))
    return found


def matches(found: list[Side], expected: list[Side], tolerance: float = 1e-4) -> bool:
    def order(side: Side) -> tuple[str, float, float, float, float]:
        return (side[0], *(round(x, 3) + 0.0 for x in side[1:]))

    found, expected = sorted(found, key=order), sorted(expected, key=order)
    return [f[0] for f in found] == [e[0] for e in expected] and np.allclose(
        [f[1:] for f in found], [e[1:] for e in expected], atol=tolerance
    )


@pytest.mark.parametrize(
    ("unit", "T"),
    [
        ("metres", np.eye(4)),
        ("millimetres", placed(0.5, 2800.0, -1100.0, 412.0)),
        ("feet", placed(-2.0, 0.0, 0.0, 0.0)),
        ("metres", placed(1.0, 691_000.0, 5_336_000.0, 519.0)),
    ],
)
def test_known_house(tmp_path: Path, unit: str, T: NDArray[np.float64]) -> None:
    graph = house(tmp_path / "house.ifc", unit, T)
    expected = [(f"{s}-{r[0]}", *r[1:]) for s in ("ground", "first") for r in TWO_ROOMS]
    assert matches(sides(graph, T), expected)
    outdoors = [w for w in graph.wall_surfaces if w.room is None]
    assert len(outdoors) == 8 and {w.floor for w in outdoors} == {f.id for f in graph.floors}

    z = T[2, 3]
    assert [(f.name, pytest.approx(f.elevation)) for f in graph.floors] == [("ground", z), ("first", z + 3)]
    floor = {f.id: f for f in graph.floors}
    for w in indoors(graph):  # the wall through both storeys too ends at each room's floor and ceiling
        assert w.height == pytest.approx((floor[w.floor].elevation, floor[w.floor].elevation + 2.5))
        assert floor[w.floor].name == graph.room_by_id[w.room].name.split("-")[0]
    centroids = {r.name: T[:2, :2].T @ (np.array(r.centroid) - T[:2, 3]) for r in graph.rooms}
    assert np.allclose(centroids["first-A"], [2.0, 2.5], atol=1e-4)
    assert all(shapely.Polygon(r.polygon).area == pytest.approx(20.0, abs=1e-3) for r in graph.rooms)

    doors = {tuple(sorted(graph.room_by_id[r].name for r in d.rooms)): d for d in graph.doors}
    assert set(doors) == {("ground-A", "ground-B"), ("ground-B",), ("first-A", "first-B"), ("first-B",)}
    assert np.allclose(T[:2, :2] @ [4.1, 2.45] + T[:2, 3], doors["first-A", "first-B"].centroid, atol=1e-4)
    assert np.allclose(T[:2, :2] @ [6.5, -0.15] + T[:2, 3], doors["ground-B",].centroid, atol=1e-4)


def one_room(model: IfcModel, space: list[tuple[float, float]] | None) -> object:
    """Four walls about 6 m x 4 m."""
    storey = model.storey("ground", 0.0)
    for area in (box(-0.3, -0.3, 6.3, 0), box(-0.3, 4, 6.3, 4.3), box(-0.3, 0, 0, 4), box(6, 0, 6.3, 4)):
        model.prism("IfcWall", area, (0.0, 3.0), storey)
    if space:
        model.prism("IfcSpace", space, (0.0, 2.5), storey, "room")
    return storey


ONE_ROOM: list[Side] = [
    ("room", 1, 0, 0, 4.0), ("room", -1, 0, -6, 4.0), ("room", 0, 1, 0, 6.0), ("room", 0, -1, -4, 6.0)
]  # fmt: skip


@pytest.mark.parametrize("inset", [-0.15, 0.0, 0.02, 0.08], ids=["centre lines", "faces", "plaster", "lining"])
def test_surfaces_are_the_walls_faces_wherever_the_space_ends(tmp_path: Path, inset: float) -> None:
    model = IfcModel()
    one_room(model, box(inset, inset, 6 - inset, 4 - inset))
    assert matches(sides(read_ifc(model.save(tmp_path / "m.ifc"))[0], np.eye(4)), ONE_ROOM)


def test_partition_within_one_space_shows_both_sides_and_its_end(tmp_path: Path) -> None:
    model = IfcModel()
    storey = one_room(model, box(0, 0, 6, 4))
    model.prism("IfcWall", box(3, 0, 3.2, 1.5), (0.0, 2.0), storey)
    found = sides(read_ifc(model.save(tmp_path / "m.ifc"))[0], np.eye(4))
    stub = [("room", -1, 0, -3, 1.5), ("room", 1, 0, 3.2, 1.5), ("room", 0, 1, 1.5, 0.2)]
    assert matches(found, ONE_ROOM + stub)


@pytest.mark.parametrize(("width", "pieces"), [(1.2, [5.0]), (3.0, [1.0, 1.0])])
def test_doorways_are_bridged_and_wide_passages_are_not(tmp_path: Path, width: float, pieces: list[float]) -> None:
    """Both are open up to the ceiling in one wall; their reveals are no surfaces."""
    model = IfcModel()
    two_rooms(model, 0.0, "g", "B")
    partition = model.file.by_type("IfcWall")[-1]
    model.opening(partition, box(3.9, 2.5 - width / 2, 4.3, 2.5 + width / 2), (-1.0, 4.0))
    model.prism("IfcSpace", box(0, 0, 4, 5), (0.0, 2.5), model.file.by_type("IfcBuildingStorey")[0], "g-A")
    graph = read_ifc(model.save(tmp_path / "m.ifc"))[0]
    facing = [s for s in sides(graph, np.eye(4)) if s[0] == "g-A" and s[1] == -1]
    assert [s[4] for s in facing] == pytest.approx(pieces)


def test_row_of_thin_partitions_is_no_wall_and_stumps_beside_a_wide_door_are(tmp_path: Path) -> None:
    model = IfcModel()
    storey = one_room(model, box(0, 0, 6, 4))
    for x in (1.0, 2.0, 3.0):  # stalls, open to the room, drawn short of the floor
        model.prism("IfcWall", box(x, 0, x + 0.025, 1.2), (0.3, 2.0), storey)
    east = model.file.by_type("IfcWall")[3]
    model.opening(east, box(5.9, 0.1, 6.4, 2.3), (0.0, 2.1), "IfcDoor")
    model.opening(east, box(5.9, 2.4, 6.4, 3.9), (0.0, 2.1), "IfcDoor")
    found = sides(read_ifc(model.save(tmp_path / "m.ifc"))[0], np.eye(4))
    stalls = [("room", s, 0, s * x, 1.2) for x0 in (1.0, 2.0, 3.0) for s, x in ((-1, x0), (1, x0 + 0.025))]
    assert matches(found, ONE_ROOM + stalls)


def test_wall_behind_another_wall_is_not_seen(tmp_path: Path) -> None:
    model = IfcModel()
    storey = one_room(model, box(0, 0.17, 6, 4))
    lining = model.prism("IfcWall", box(0, 0.05, 6, 0.17), (0.0, 3.0), storey)  # a cavity of 5 cm behind it
    graph = read_ifc(model.save(tmp_path / "m.ifc"))[0]
    expected = [("room", 1, 0, 0, 3.83), ("room", -1, 0, -6, 3.83), ("room", 0, 1, 0.17, 6.0), ONE_ROOM[3]]
    assert matches(sides(graph, np.eye(4)), expected)
    assert [w.source for w in indoors(graph) if w.normal[1] > 0.9] == [lining.GlobalId]


def test_curved_wall_becomes_chords(tmp_path: Path) -> None:
    model, radius = IfcModel(), 3.0
    storey = model.storey("ground", 0.0)
    angle = np.linspace(0.0, np.pi, 121)
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    half = lambda r: [tuple(p) for p in (r * arc).tolist()]  # noqa: E731
    model.prism("IfcWall", half(radius) + half(radius + 0.3)[::-1], (0.0, 3.0), storey)
    model.prism("IfcWall", box(-3.3, -0.3, 3.3, 0), (0.0, 3.0), storey)
    model.prism("IfcSpace", half(radius), (0.0, 2.5), storey, "round")
    graph = read_ifc(model.save(tmp_path / "m.ifc"))[0]
    curved = [w for w in graph.wall_surfaces if w.room is not None and (w.length or 0) < 5]
    assert 15 < len(curved) < 32
    assert sum(w.length or 0 for w in curved) == pytest.approx(np.pi * radius, rel=0.01)
    for w in curved:
        assert np.hypot(*w.centroid) == pytest.approx(radius, abs=0.02)
        assert np.dot(w.normal, w.centroid) / radius < -0.99


@pytest.mark.parametrize("outline", [4.0, 4.05, 4.1], ids=["inner", "centre", "outer"])
def test_curtain_wall_of_panes_and_mullions_is_one_surface(tmp_path: Path, outline: float) -> None:
    model = IfcModel("millimetres")
    storey = model.storey("ground", 0.0)
    for area in (box(-0.3, -0.3, 6.3, 0), box(-0.3, 0, 0, 4), box(6, 0, 6.3, 4)):
        model.prism("IfcWall", area, (0.0, 3.0), storey)
    panes = [("IfcPlate", box(x + 0.025, 4.04, x + 1.475, 4.06), (0.0, 3.0)) for x in (0, 1.5, 3, 4.5)]
    mullions = [("IfcMember", box(x - 0.025, 4.0, x + 0.025, 4.1), (0.0, 3.0)) for x in (0.025, 1.5, 3, 4.5, 5.975)]
    curtain = model.assembly("IfcCurtainWall", panes + mullions, storey)
    model.prism("IfcSpace", box(0, 0, 6, outline), (0.0, 2.5), storey, "room")
    graph = read_ifc(model.save(tmp_path / "m.ifc"))[0]
    (pane,) = [w for w in indoors(graph) if w.source == curtain.GlobalId]
    assert len(indoors(graph)) == 4 and len(graph.wall_surfaces) == 8
    assert pane.normal == pytest.approx((0.0, -1.0)) and pane.length == pytest.approx(6.0, abs=0.06)
    assert 4.0 <= pane.centroid[1] <= 4.04


def test_building_without_spaces_and_closed_faces_gives_every_free_side(tmp_path: Path) -> None:
    model = IfcModel()
    storey = model.storey("ground", 0.0)
    model.prism("IfcWall", box(0, -0.1, 8, 0.3), (0.0, 2.7), storey)
    model.prism("IfcWall", box(0, 0.3, 0.3, 6), (0.0, 2.7), storey)
    graph, (notice,) = read_ifc(model.save(tmp_path / "m.ifc"))
    long = [("", 0, -1, 0.1, 8.0), ("", 0, 1, 0.3, 7.7), ("", -1, 0, 0, 6.1), ("", 1, 0, 0.3, 5.7)]
    assert matches(sides(graph, np.eye(4)), [*long, ("", 1, 0, 8.0, 0.4)])  # the other is too short
    assert "no IfcSpace" in notice and "2 walls enclose none" in notice
    assert {w.floor for w in graph.wall_surfaces} == {graph.floors[0].id}


def test_room_whose_space_is_missing_keeps_its_walls(tmp_path: Path) -> None:
    model = IfcModel()
    two_rooms(model, 0.0, "g", "A")
    model.prism("IfcWall", box(-0.3, 0, 0, 5), (0.0, 2.7), model.file.by_type("IfcBuildingStorey")[0])
    graph = read_ifc(model.save(tmp_path / "m.ifc"))[0]
    expected = [(f"g-{s[0]}" if s[0] == "A" else "", *s[1:]) for s in TWO_ROOMS]
    assert matches(sides(graph, np.eye(4)), expected)


def test_spaces_that_are_no_rooms_are_left_out(tmp_path: Path) -> None:
    model = IfcModel()
    two_rooms(model, 0.0, "g")
    storey = model.file.by_type("IfcBuildingStorey")[0]
    model.prism("IfcSpace", box(-0.3, -0.3, 8.5, 5.3), (0.0, 2.7), storey, "gross")
    model.prism("IfcSpace", box(0, 0, 4, 5), (0.0, 2.5), storey, "double")
    model.prism("IfcSpace", box(1, 1, 1.5, 1.5), (0.0, 2.5), storey, "shaft")
    model.prism("IfcSpace", box(0, 0, 4, 5), (2.5, 3.0), storey, "void")
    model.prism("IfcSpace", box(0, -9, 4, -1), (0.0, 2.5), storey, "terrace").PredefinedType = "EXTERNAL"
    model.prism("IfcSpace", box(5, 1, 7, 3), (0.0, 2.5), storey, "nested")
    graph, (notice,) = read_ifc(model.save(tmp_path / "m.ifc"))
    assert [r.name for r in graph.rooms] == ["g-A", "g-B", "nested"]
    assert notice == (
        "5 of 8 spaces left out: 1 outer, gross or parts (terrace), 2 under 1 m2 or 1.3 m high (shaft, void), "
        "2 double or covering others (gross, double)"
    )


def test_of_many_spaces_that_are_left_out_the_first_are_named(tmp_path: Path) -> None:
    model = IfcModel()
    two_rooms(model, 0.0, "g")
    storey = model.file.by_type("IfcBuildingStorey")[0]
    for number in range(5):
        model.prism("IfcSpace", box(number, -3, number + 0.5, -2), (0.0, 2.5), storey, f"shaft {number}")
    _, (notice,) = read_ifc(model.save(tmp_path / "m.ifc"))
    assert notice.endswith("5 under 1 m2 or 1.3 m high (shaft 0, shaft 1, shaft 2 and 2 more)")


def test_files_of_other_kinds_are_refused(tmp_path: Path) -> None:
    empty = IfcModel().save(tmp_path / "empty.ifc")
    garbage = tmp_path / "garbage.ifc"
    garbage.write_text("hello")
    graphless = tmp_path / "graph.json"
    graphless.write_text("{}")
    for path, say in (
        (empty, "has no walls"), (garbage, "not IFC"), (graphless, "not a scene graph"),
        (tmp_path / "none.ifc", "no such file"), (Path(__file__), "not a building"),
    ):  # fmt: skip
        with pytest.raises(UserError, match=say) as error:
            load_bim(path, tmp_path / "cache")
        assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_zip_json_and_cache_give_the_same_graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = IfcModel()
    one_room(model, box(0, 0, 6, 4))
    ifc, cache = model.save(tmp_path / "m.ifc"), tmp_path / "a" / "cache"
    monkeypatch.setenv("SGSLAM_CACHE_DIR", str(cache))
    bim = load_bim(ifc)
    (entry,) = cache.iterdir()
    with zipfile.ZipFile(tmp_path / "m.ifczip", "w") as archive:
        archive.write(ifc, "m.ifc")
    bim.graph.save(tmp_path / "a.json")
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert load_bim(ifc) == load_bim(ifc, blocked / "cache") == bim
    assert load_bim(tmp_path / "m.ifczip").graph == load_bim(tmp_path / "a.json").graph == bim.graph

    for damage in ("", "[]", '{"graph": {"schema_version": 1}}', "\xff"):
        entry.write_bytes(damage.encode("latin-1"))
        assert load_bim(ifc) == bim
        assert json.loads(entry.read_text())["graph"] == json.loads((tmp_path / "a.json").read_text())

    script = "import sys, data.plans.bim as b; b.load_bim(sys.argv[1]); sys.exit('ifcopenshell' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script, str(ifc)], check=False).returncode == 0


@pytest.mark.long
@pytest.mark.skipif(not REAL, reason="../shared/data/ifc is not there")
@pytest.mark.parametrize("path", REAL, ids=lambda p: p.stem)
def test_real_models(path: Path, tmp_path: Path) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    graph = load_bim(path, tmp_path).graph
    schema = json.loads(SCHEMA.read_text())
    jsonschema.validate(json.loads(json.dumps(graph.to_dict())), schema)
    areas = {r.id: shapely.Polygon(r.polygon) for r in graph.rooms}
    assert graph.wall_surfaces and all(a.is_valid and a.area >= 1 for a in areas.values())
    assert all(areas[w.room].intersects(_strip(w)) for w in graph.wall_surfaces if w.room)
    for w in graph.wall_surfaces:
        assert w.plane and w.length and w.height
        assert math.hypot(*w.normal) == pytest.approx(1.0)
        assert np.dot(w.plane[:2], w.centroid) + w.plane[3] == pytest.approx(0.0, abs=1e-6)
        assert w.length >= 0.15 and w.height[1] - w.height[0] >= 0.3
    enclosed = [len(graph.surfaces_of_room[r.id]) >= 3 for r in graph.rooms]
    assert not enclosed or np.mean(enclosed) > 0.85
    assert all(len(d.rooms) <= 2 for d in graph.doors)


def _strip(surface: WallSurface) -> shapely.Polygon:
    """The 0.35 m in front of a wall surface."""
    ends = np.array(surface.ends())
    return shapely.Polygon([*ends, *(ends + 0.35 * np.array(surface.normal))[::-1]])
