"""Models without IfcSpace: rooms are the closed faces between the walls."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from ifc_models import IfcModel, box
from test_ifc_graph import TWO_ROOMS, indoors, matches, placed, sides, two_rooms

from data import SceneGraph
from data.ifc.graph import read_ifc

WALL = (0.0, 2.7)


def without_spaces(path: Path, unit: str = "metres", T: np.ndarray | None = None) -> tuple[SceneGraph, tuple[str, ...]]:
    """Two storeys of two rooms; the west wall is one wall through both."""
    model = IfcModel(unit, T)
    two_rooms(model, 0.0, "ground", "")
    two_rooms(model, 3.0, "first", "")
    model.prism("IfcWall", box(-0.3, 0, 0, 5), (0.0, 5.7), model.file.by_type("IfcBuildingStorey")[0])
    return read_ifc(model.save(path))


def shell(width: float = 6.0, depth: float = 4.0, height: tuple[float, float] = WALL) -> tuple[IfcModel, object]:
    """Four walls around `width` x `depth` metres."""
    model = IfcModel()
    storey = model.storey("ground", 0.0)
    w, d = width, depth
    for area in (
        box(-0.3, -0.3, w + 0.3, 0),
        box(-0.3, d, w + 0.3, d + 0.3),
        box(-0.3, 0, 0, d),
        box(w, 0, w + 0.3, d),
    ):
        model.prism("IfcWall", area, height, storey)
    return model, storey


def areas(model: IfcModel, path: Path) -> list[float]:
    graph, _ = read_ifc(model.save(path / "m.ifc"))
    return sorted(shapely.Polygon(r.polygon).area for r in graph.rooms)


@pytest.mark.parametrize(
    ("unit", "T"), [("metres", np.eye(4)), ("millimetres", placed(0.5, 691_000.0, 5_336_000.0, 519.0))]
)
def test_rooms_surfaces_and_doors_are_those_of_the_model_with_spaces(tmp_path: Path, unit: str, T: np.ndarray) -> None:
    graph, notices = without_spaces(tmp_path / "m.ifc", unit, T)
    assert len(notices) == 1 and "4 rooms were made of the closed faces between 11 walls" in notices[0]
    floors = {f.id: f.name for f in graph.floors}
    name = {}
    for room in graph.rooms:
        x, y = T[:2, :2].T @ (np.array(room.centroid) - T[:2, 3])
        name[room.id] = f"{floors[room.floor]}-{'A' if x < 4 else 'B'}"
        assert (x, y) == pytest.approx((2.0 if x < 4 else 6.2, 2.5), abs=1e-3)
        assert shapely.Polygon(room.polygon).area == pytest.approx(20.0, abs=1e-2)
    assert sorted(r.name for r in graph.rooms) == ["Room 1", "Room 1", "Room 2", "Room 2"]
    label = {f"{r.floor}{r.name}": name[r.id] for r in graph.rooms}
    assert len(label) == 4

    for floor in graph.floors:
        part = graph.on_floor(floor.id)
        of_room = {r.id: name[r.id][-1] for r in part.rooms}
        found = [(of_room[w.room], *s[1:]) for w, s in zip(indoors(part), sides(part, T), strict=True)]
        assert matches(found, TWO_ROOMS, tolerance=1e-3)
    joined = sorted(tuple(sorted(name[r] for r in d.rooms)) for d in graph.doors)
    assert joined == [("first-A", "first-B"), ("first-B",), ("ground-A", "ground-B"), ("ground-B",)]


def test_the_same_file_gives_the_same_ids(tmp_path: Path) -> None:
    assert without_spaces(tmp_path / "m.ifc") == read_ifc(tmp_path / "m.ifc")


@pytest.mark.parametrize(
    ("gap", "filling", "rooms"),
    [(0.25, None, 2), (2.0, None, 1), (0.9, "IfcDoor", 2), (2.0, "IfcDoor", 2), (2.0, "IfcWindow", 2)],
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


def test_columns_shafts_and_cavities_are_no_rooms(tmp_path: Path) -> None:
    model, storey = shell(10.0, 6.0)
    for area in (box(4, 2, 4.1, 3), box(5, 2, 5.1, 3), box(4, 1.9, 5.1, 2), box(4, 3, 5.1, 3.1)):
        model.prism("IfcWall", area, WALL, storey)  # a shaft of 0.9 m x 1 m
    for area in (box(7, 1, 7.2, 1.2), box(7, 4, 7.2, 4.2)):
        model.prism("IfcColumn", area, WALL, storey)
    model.prism("IfcWall", box(0, 5.4, 10, 5.5), WALL, storey)  # 0.5 m before the north wall
    assert areas(model, tmp_path) == [pytest.approx(54.0, abs=0.01)]


def test_columns_close_a_front_between_walls(tmp_path: Path) -> None:
    model = IfcModel()
    storey = model.storey("ground", 0.0)
    for area in (box(-0.3, -0.3, 12.3, 0), box(-0.3, 0, 0, 4), box(12, 0, 12.3, 4), box(-0.3, 4, 2.7, 4.3)):
        model.prism("IfcWall", area, WALL, storey)
    model.prism("IfcWall", box(9.3, 4, 12.3, 4.3), WALL, storey)  # 6.6 m apart, wider than a gate
    assert areas(model, tmp_path) == []
    model.prism("IfcColumn", box(2.7, 4, 3.5, 4.3), WALL, storey)
    assert areas(model, tmp_path) == [pytest.approx(48.0, abs=0.01)]


def test_an_open_wing_beside_rooms_keeps_its_walls_without_a_room(tmp_path: Path) -> None:
    model, storey = shell()
    model.prism("IfcWall", box(6.3, -0.3, 12.0, 0), WALL, storey)
    model.prism("IfcWall", box(6.3, 4, 12.0, 4.3), WALL, storey)
    graph, _ = read_ifc(model.save(tmp_path / "m.ifc"))
    (room,) = graph.rooms
    assert len(graph.surfaces_of_room[room.id]) == 4
    assert sorted(np.round(w.normal, 6).tolist() for w in indoors(graph) if w.room is None) == [
        [0.0, -1.0], [0.0, 1.0], [1.0, 0.0],
    ]  # fmt: skip


def test_a_storey_whose_walls_enclose_nothing_keeps_every_free_side(tmp_path: Path) -> None:
    model, _ = shell()
    upper = model.storey("upper", 3.0)
    for area in (box(0, 0, 6, 0.3), box(0, 0.3, 0.3, 4)):
        model.prism("IfcWall", area, (3.0, 5.7), upper)
    graph, notices = read_ifc(model.save(tmp_path / "m.ifc"))
    assert "1 room was made of the closed faces between 6 walls" in notices[0]
    above = graph.on_floor(upper.GlobalId)
    assert not above.rooms and above.wall_surfaces and all(w.room is None for w in above.wall_surfaces)


def test_a_room_beside_split_levels_stands_at_the_level_of_its_door(tmp_path: Path) -> None:
    """Rooms at 0.0 m and 1.4 m, with walls as high as both: each is met at both levels' heights."""
    model, lower = shell(height=(0.0, 4.1))
    middle = model.storey("middle", 1.4)
    for area in (box(6.3, -0.3, 11.3, 0), box(6.3, 4, 11.3, 4.3), box(11, 0, 11.3, 4)):
        model.prism("IfcWall", area, (0.6, 4.1), middle)
    north, east = model.file.by_type("IfcWall")[1], model.file.by_type("IfcWall")[6]
    model.opening(north, box(1, 3.9, 2, 4.4), (0.0, 2.0), "IfcDoor")
    model.opening(east, box(10.9, 1, 11.4, 2), (1.4, 3.4), "IfcDoor")
    graph, _ = read_ifc(model.save(tmp_path / "m.ifc"))
    assert {r.floor: round(r.centroid[0], 1) for r in graph.rooms} == {lower.GlobalId: 3.0, middle.GlobalId: 8.7}
    assert [len(d.rooms) for d in graph.doors] == [1, 1]
