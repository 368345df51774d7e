"""IFC models as A-graphs: small models against their truth, real ones against what must always hold."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import shapely
from ifc_models import IfcModel, Polygon, box
from numpy.typing import NDArray

from data import SceneGraph, UserError, WallSurface
from data.ifc import guard
from data.ifc.graph import read_ifc
from data.ifc.writer import placed
from data.plans import load_bim

EYE, SWISS, UTM = np.eye(4), (2_600_000.123, 1_200_000.456, 408.7), (691_608.1, 5_334_765.2, 515.0)
WALL = (0.0, 2.7)
Place = tuple[float, float, float]
Side = tuple[str, float, float, float, float]  # room, normal x y, offset along the normal, length


def two_rooms(model: IfcModel, z: float, name: str, spaces: str = "AB") -> None:
    """A and B, 4 m x 5 m each, 0.2 m between them with a door; outer door into B; no west wall."""
    storey, height = model.storey(name, z), (z, z + 2.7)
    wall = "IfcWall" if model.file.schema == "IFC4X3" else "IfcWallStandardCase"
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


def sides_of(room: str, x: float, width: float, depth: float) -> list[Side]:
    """Of a room from (x, 0) on."""
    across: list[Side] = [(room, 1, 0, x, depth), (room, -1, 0, -x - width, depth)]
    return [*across, (room, 0, 1, 0.0, width), (room, 0, -1, -depth, width)]


TWO_ROOMS = sides_of("A", 0.0, 4.0, 5.0) + sides_of("B", 4.2, 4.0, 5.0)


def indoors(graph: SceneGraph) -> list[WallSurface]:
    """The surfaces that face the building's inside; all of them in a building without rooms."""
    hull = shapely.MultiPoint([end for w in graph.wall_surfaces for end in w.ends()]).convex_hull
    before = [shapely.Point(np.add(w.centroid, np.multiply(0.4, w.normal))) for w in graph.wall_surfaces]
    faced = zip(graph.wall_surfaces, before, strict=True)
    return [w for w, point in faced if w.room is not None or hull.contains(point) or not graph.rooms]


def sides(graph: SceneGraph, T: NDArray[np.float64] = EYE, names: dict[str, str] | None = None) -> list[Side]:
    """The graph's surfaces indoors in the building's axes."""
    found, names = [], names or {r.id: r.name for r in graph.rooms}
    for w in indoors(graph):
        assert w.plane is not None and w.length is not None
        normal, mid = T[:2, :2].T @ w.normal, T[:2, :2].T @ (np.array(w.centroid) - T[:2, 3])
        assert w.plane[:3] == (*w.normal, 0.0)
        assert w.plane[3] == pytest.approx(-float(np.dot(w.normal, w.centroid)), abs=1e-6)
        found.append((names[w.room] if w.room else "", *normal.tolist(), float(normal @ mid), w.length))
    return found


def matches(found: list[Side], expected: list[Side], tolerance: float = 1e-4) -> bool:
    def order(side: Side) -> tuple[str, float, float, float, float]:
        return (side[0], *(round(x, 2) + 0.0 for x in side[1:]))

    found, expected = sorted(found, key=order), sorted(expected, key=order)
    return [f[0] for f in found] == [e[0] for e in expected] and np.allclose(
        [f[1:] for f in found], [e[1:] for e in expected], atol=tolerance
    )


@pytest.mark.parametrize(
    ("version", "unit", "place", "yaw", "drawn_there", "spaces"),
    [
        ("IFC2X3", "millimetres", SWISS, 0.0, True, "AB"),
        ("IFC4", "feet", UTM, -2.0, False, "AB"),
        ("IFC4X3_ADD2", "metres", SWISS, 0.3, False, "AB"),
        ("IFC4", "millimetres", UTM, 0.5, False, ""),
    ],
)
def test_a_known_house(
    version: str, unit: str, place: Place, yaw: float, drawn_there: bool, spaces: str, tmp_path: Path
) -> None:
    """Two storeys of two rooms; the west wall is one wall through both. Without spaces, rooms are the closed faces."""
    T = placed(*place, yaw)
    model = IfcModel(unit, None if drawn_there else T, version, place if drawn_there else (0.0, 0.0, 0.0))
    two_rooms(model, 0.0, "ground", spaces)
    two_rooms(model, 3.0, "first", spaces)
    model.prism("IfcWall", box(-0.3, 0, 0, 5), (0.0, 5.7), model.file.by_type("IfcBuildingStorey")[0])
    graph, notices = read_ifc(model.save(tmp_path / "house.ifc"))
    tolerance = 1e-4 if spaces else 1e-3

    floors, names = {f.id: f for f in graph.floors}, {}
    assert [f.name for f in graph.floors] == ["ground", "first"]
    assert [f.elevation for f in graph.floors] == pytest.approx([place[2], place[2] + 3])
    for room in graph.rooms:
        x, y = T[:2, :2].T @ (np.array(room.centroid) - T[:2, 3])
        names[room.id] = f"{floors[room.floor or ''].name}-{'A' if x < 4 else 'B'}"
        assert (x, y) == pytest.approx((2.0 if x < 4 else 6.2, 2.5), abs=tolerance)
        assert shapely.Polygon(np.subtract(room.polygon, place[:2])).area == pytest.approx(20.0, abs=10 * tolerance)
        assert not spaces or room.name == names[room.id]
    expected = [(f"{s}-{r[0]}", *r[1:]) for s in ("ground", "first") for r in TWO_ROOMS]
    assert matches(sides(graph, T, names), expected, tolerance)
    for w in indoors(graph):  # the wall through both storeys too ends at each room's floor and ceiling
        low = floors[w.floor or ""].elevation or 0.0
        assert not spaces or w.height == pytest.approx((low, low + 2.5))
    assert {w.floor for w in graph.wall_surfaces if w.room is None} == set(floors)

    doors = {tuple(sorted(names[r] for r in d.rooms)): d for d in graph.doors}
    assert set(doors) == {("ground-A", "ground-B"), ("ground-B",), ("first-A", "first-B"), ("first-B",)}
    assert np.allclose(T[:2, :2] @ [4.1, 2.45] + T[:2, 3], doors["first-A", "first-B"].centroid, atol=tolerance)
    assert np.allclose(T[:2, :2] @ [6.5, -0.15] + T[:2, 3], doors["ground-B",].centroid, atol=tolerance)
    if not spaces:
        assert len(notices) == 1 and "4 rooms were made of the closed faces between 11 walls" in notices[0]
        assert (graph, notices) == read_ifc(tmp_path / "house.ifc")  # the same ids


def shell(space: Polygon | None = None, width: float = 6.0, depth: float = 4.0) -> tuple[IfcModel, object]:
    """Four walls around `width` x `depth` metres."""
    model, w, d = IfcModel(), width, depth
    storey = model.storey("ground", 0.0)
    ends = ((-0.3, -0.3, w + 0.3, 0), (-0.3, d, w + 0.3, d + 0.3), (-0.3, 0, 0, d), (w, 0, w + 0.3, d))
    for area in ends:
        model.prism("IfcWall", box(*area), WALL, storey)
    if space:
        model.prism("IfcSpace", space, (0.0, 2.5), storey, "room")
    return model, storey


def read(model: IfcModel, folder: Path) -> SceneGraph:
    return read_ifc(model.save(folder / "m.ifc"))[0]


ONE_ROOM = sides_of("room", 0.0, 6.0, 4.0)


@pytest.mark.parametrize("inset", [-0.15, 0.0, 0.02, 0.08], ids=["centre lines", "faces", "plaster", "lining"])
def test_surfaces_are_the_walls_faces_wherever_the_space_ends(tmp_path: Path, inset: float) -> None:
    model, _ = shell(box(inset, inset, 6 - inset, 4 - inset))
    assert matches(sides(read(model, tmp_path)), ONE_ROOM)


def test_walls_that_enclose_nothing_show_every_free_side(tmp_path: Path) -> None:
    """In a building without rooms, and in a wing whose end is open."""
    model = IfcModel()
    storey = model.storey("ground", 0.0)
    model.prism("IfcWall", box(0, -0.1, 8, 0.3), WALL, storey)
    model.prism("IfcWall", box(0, 0.3, 0.3, 6), WALL, storey)
    graph, (notice,) = read_ifc(model.save(tmp_path / "m.ifc"))
    free = [("", 0, -1, 0.1, 8.0), ("", 0, 1, 0.3, 7.7), ("", -1, 0, 0, 6.1), ("", 1, 0, 0.3, 5.7)]
    assert matches(sides(graph), [*free, ("", 1, 0, 8.0, 0.4)])  # the other end is too short
    assert "no IfcSpace" in notice and "2 walls enclose none" in notice

    model, storey = shell()
    model.prism("IfcWall", box(6.3, -0.3, 12.0, 0), WALL, storey)
    model.prism("IfcWall", box(6.3, 4, 12.0, 4.3), WALL, storey)
    graph, notices = read_ifc(model.save(tmp_path / "m.ifc"))
    assert "1 room was made of the closed faces between 6 walls" in notices[0]
    assert len(graph.surfaces_of_room[graph.rooms[0].id]) == 4
    wing = sorted(np.round(w.normal, 6).tolist() for w in indoors(graph) if w.room is None)
    assert wing == [[0.0, -1.0], [0.0, 1.0], [1.0, 0.0]]


def test_spaces_that_are_missing_and_spaces_that_are_no_rooms(tmp_path: Path) -> None:
    model = IfcModel()
    two_rooms(model, 0.0, "g", "A")
    model.prism("IfcWall", box(-0.3, 0, 0, 5), WALL, model.file.by_type("IfcBuildingStorey")[0])
    expected = [(f"g-{s[0]}" if s[0] == "A" else "", *s[1:]) for s in TWO_ROOMS]
    assert matches(sides(read(model, tmp_path)), expected)  # the other room keeps its walls

    model = IfcModel()
    two_rooms(model, 0.0, "g")
    storey = model.file.by_type("IfcBuildingStorey")[0]
    model.prism("IfcSpace", box(-0.3, -0.3, 8.5, 5.3), WALL, storey, "gross")
    model.prism("IfcSpace", box(0, 0, 4, 5), (0.0, 2.5), storey, "double")
    model.prism("IfcSpace", box(0, 0, 4, 5), (2.5, 3.0), storey, "void")
    model.prism("IfcSpace", box(0, -9, 4, -1), (0.0, 2.5), storey, "terrace").PredefinedType = "EXTERNAL"
    model.prism("IfcSpace", box(5, 1, 7, 3), (0.0, 2.5), storey, "nested")
    for number in range(4):
        model.prism("IfcSpace", box(number, -3, number + 0.5, -2), (0.0, 2.5), storey, f"shaft {number}")
    graph, (notice,) = read_ifc(model.save(tmp_path / "m.ifc"))
    assert [r.name for r in graph.rooms] == ["g-A", "g-B", "nested"]
    assert "8 of 11 spaces left out: 1 outer, gross or parts (terrace)" in notice
    assert "5 under 1 m2 or 1.3 m high (" in notice and " and 2 more)" in notice
    assert "2 double or covering others (gross, double)" in notice


def areas(model: IfcModel, folder: Path) -> list[float]:
    return sorted(shapely.Polygon(r.polygon).area for r in read(model, folder).rooms)


@pytest.mark.parametrize(
    ("gap", "filling", "rooms"),
    [(0.25, None, 2), (2.0, None, 1), (2.0, "IfcDoor", 2), (2.0, "IfcWindow", 2)],
)
def test_gaps_between_walls_join_rooms_unless_narrow_or_filled(
    tmp_path: Path, gap: float, filling: str | None, rooms: int
) -> None:
    model, storey = shell()
    model.prism("IfcWall", box(2.9, 0, 3.1, 1), WALL, storey)
    model.prism("IfcWall", box(2.9, 1 + gap, 3.1, 4), WALL, storey)
    if filling:
        model.prism(filling, box(2.9, 1, 3.1, 1 + gap), (0.0, 2.1), storey)
    assert len(areas(model, tmp_path)) == rooms


@pytest.mark.parametrize(
    ("width", "filling", "rooms"), [(0.9, None, 2), (2.5, None, 1), (2.5, "IfcDoor", 2), (2.5, "IfcWindow", 2)]
)
def test_openings_under_a_lintel_join_rooms_if_wide_and_unfilled(
    tmp_path: Path, width: float, filling: str | None, rooms: int
) -> None:
    model, storey = shell()
    wall = model.prism("IfcWall", box(2.9, 0, 3.1, 4), WALL, storey)
    model.opening(wall, box(2.8, 0.5, 3.2, 0.5 + width), (-0.1, 2.2), filling)
    found = areas(model, tmp_path)
    assert len(found) == rooms
    assert rooms == 1 or found == pytest.approx([2.9 * 4, 2.9 * 4], abs=0.02)  # the opening is thicker than the wall


def test_zip_json_and_cache_give_the_same_graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, _ = shell(box(0, 0, 6, 4))
    ifc, cache = model.save(tmp_path / "m.ifc"), tmp_path / "a" / "cache"
    monkeypatch.setenv("SGSLAM_CACHE_DIR", str(cache))
    bim = load_bim(ifc)
    (entry,) = cache.iterdir()
    with zipfile.ZipFile(tmp_path / "m.ifczip", "w") as archive:
        archive.write(ifc, "inner/m.ifc")
    bim.graph.save(tmp_path / "a.json")
    (blocked := tmp_path / "file").write_text("")
    assert load_bim(ifc) == load_bim(ifc, blocked / "cache") == bim
    assert load_bim(tmp_path / "m.ifczip").graph == load_bim(tmp_path / "a.json").graph == bim.graph
    for damage in ("", "[]", '{"graph": {"schema_version": 1}}', "\xff"):
        entry.write_bytes(damage.encode("latin-1"))
        assert load_bim(ifc) == bim
        assert json.loads(entry.read_text())["graph"] == json.loads((tmp_path / "a.json").read_text())
    script = "import sys, data.plans.bim as b; b.load_bim(sys.argv[1]); sys.exit('ifcopenshell' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script, str(ifc)], check=False).returncode == 0


def test_broken_archives_and_a_reader_that_goes_down_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = shell(box(0, 0, 6, 4))[0].save(tmp_path / "m.ifc")
    good = path.read_bytes()
    half = good[: len(good) // 2]
    bad = {"none": {"a.txt": b"x"}, "two": {"a.ifc": good, "b.ifc": good}, "cut": {"a.ifc": half}, "no archive": {}}
    for name, members in bad.items():
        with zipfile.ZipFile(tmp_path / f"{name}.ifczip", "w", zipfile.ZIP_DEFLATED) as archive:
            for member, raw in members.items():
                archive.writestr(member, raw)
        if not members:
            (tmp_path / f"{name}.ifczip").write_text("no archive")
        with pytest.raises(UserError, match=rf"{name}\.ifczip"):
            load_bim(tmp_path / f"{name}.ifczip", tmp_path / "cache")
    monkeypatch.setattr(guard, "MEMORY", 1 << 20)  # it cannot even begin
    with pytest.raises(UserError, match=r"crashes the reader|memory") as told:
        guard.read_guarded(path)
    assert "\n" not in str(told.value)
    monkeypatch.undo()
    assert len(guard.read_guarded(path)["graph"]["rooms"]) == 1
