"""IFC of every version, unit and place, made by ifcopenshell: the same house to the thousandth of a millimetre."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
import shapely
from ifc_models import IfcModel, box

from data.common.errors import UserError
from data.ifc.guard import read_guarded
from data.plans import load_bim
from data.scene_graph import SceneGraph, WallSurface

Place = tuple[float, float, float]
SWISS, UTM = (2_600_000.123, 1_200_000.456, 408.7), (691_608.1, 5_334_765.2, 515.0)


def house(path: Path, version: str, unit: str, place: Place, yaw: float, drawn_there: bool) -> Path:
    """Two rooms of 3.7 x 4.4 m and 3.6 x 4.4 m; `drawn_there`: all coordinates are large, not the site's placement."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:3, 3] = place
    model = IfcModel(unit, None if drawn_there else T, version)
    x, y = place[:2] if drawn_there else (0.0, 0.0)
    z = place[2] if drawn_there else 0.0
    storey = model.storey("EG", z)
    walls = [(0, 0, 8, 0.3), (0, 4.7, 8, 5), (0, 0.3, 0.3, 4.7), (7.7, 0.3, 8, 4.7), (4, 0.3, 4.1, 4.7)]
    for number, bounds in enumerate([*walls, (0.3, 0.3, 4.0, 4.7), (4.1, 0.3, 7.7, 4.7)]):
        corners = [(float(a + x), float(b + y)) for a, b in box(*bounds)]
        model.prism("IfcWall" if number < 5 else "IfcSpace", corners, (z, z + 2.6), storey, f"{number}")
    return model.save(path)


def faults(graph: SceneGraph, place: Place, yaw: float, tolerance: float) -> list[str]:
    """What differs by more than the tolerance (m) from the house, put at a place and turned by yaw (rad)."""
    areas = sorted(shapely.Polygon(np.array(r.polygon) - place[:2]).area for r in graph.rooms)
    walls = [wall for wall in graph.wall_surfaces if wall.room is not None]
    off = max(_off_side(wall, place, yaw) for wall in walls)
    kept = {
        f"{len(graph.rooms)} rooms, {len(walls)} walls": (len(areas), len(walls)) == (2, 8),
        f"areas {areas}": np.allclose(areas, [3.6 * 4.4, 3.7 * 4.4], rtol=0, atol=20 * tolerance),
        f"a wall {off} m off": off < tolerance,
        f"elevation {graph.floors[0].elevation}": abs((graph.floors[0].elevation or 0.0) - place[2]) <= tolerance,
    }
    return [name for name, is_kept in kept.items() if not is_kept]


def _off_side(wall: WallSurface, place: Place, yaw: float) -> float:
    """How far (m) a wall lies from the nearest side of a room that it is parallel to."""
    back = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    point, normal = back @ (np.array(wall.centroid) - place[:2]), back @ wall.normal
    sides = (0.3, 4.0, 4.1, 7.7) if abs(normal[0]) > 0.5 else (0.3, 4.7)
    at = float(point[0] if abs(normal[0]) > 0.5 else point[1])
    return min(abs(at - side) for side in sides)


@pytest.mark.parametrize(
    ("version", "unit", "place"),
    [
        ("IFC2X3", "inches", (0.0, 0.0, 0.0)), ("IFC2X3", "millimetres", SWISS), ("IFC2X3", "metres", UTM),
        ("IFC4", "inches", SWISS), ("IFC4", "feet", UTM),
        ("IFC4X3", "millimetres", UTM), ("IFC4X3_ADD2", "metres", SWISS),
    ],
)  # fmt: skip
def test_versions_units_and_places(version: str, unit: str, place: Place, tmp_path: Path) -> None:
    path = house(tmp_path / "m.ifc", version, unit, place, 0.3, drawn_there=False)
    assert faults(load_bim(path, tmp_path / "cache").graph, place, 0.3, 1e-6) == []
    with zipfile.ZipFile(tmp_path / "m.ifczip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(path, "inner/m.ifc")
    assert faults(load_bim(tmp_path / "m.ifczip", tmp_path / "other").graph, place, 0.3, 1e-6) == []


@pytest.mark.parametrize(("version", "unit"), [("IFC2X3", "millimetres"), ("IFC4", "feet")])
def test_large_coordinates_without_a_placement(version: str, unit: str, tmp_path: Path) -> None:
    """As some programs export: every point in the country's own grid."""
    path = house(tmp_path / "m.ifc", version, unit, SWISS, 0.0, drawn_there=True)
    assert faults(load_bim(path, tmp_path / "cache").graph, SWISS, 0.0, 1e-4) == []


def test_archives_that_hold_no_model(tmp_path: Path) -> None:
    good = house(tmp_path / "m.ifc", "IFC4", "metres", (0.0, 0.0, 0.0), 0.0, drawn_there=False).read_bytes()
    for name, members in {
        "none": {"a.txt": b"x"}, "two": {"a.ifc": good, "b.ifc": good}, "cut": {"a.ifc": good[: len(good) // 2]},
        "bomb": {"a.ifc": bytes(60_000_000)},
    }.items():  # fmt: skip
        with zipfile.ZipFile(tmp_path / f"{name}.ifczip", "w", zipfile.ZIP_DEFLATED) as archive:
            for member, raw in members.items():
                archive.writestr(member, raw)
        with pytest.raises(UserError, match=rf"{name}\.ifczip"):
            load_bim(tmp_path / f"{name}.ifczip", tmp_path / "cache")
    (tmp_path / "text.ifczip").write_text("no archive")
    with pytest.raises(UserError, match="cannot be unpacked"):
        load_bim(tmp_path / "text.ifczip", tmp_path / "cache")


def test_a_reader_that_goes_down_or_never_ends_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from data.ifc import guard as ifc_guard

    path = house(tmp_path / "m.ifc", "IFC4", "metres", (0.0, 0.0, 0.0), 0.0, drawn_there=False)
    monkeypatch.setattr(ifc_guard, "MEMORY", 1 << 20)  # it cannot even begin
    with pytest.raises(UserError, match=r"crashes the reader|memory") as told:
        read_guarded(path)
    assert "\n" not in str(told.value)
    monkeypatch.undo()
    assert len(read_guarded(path)["graph"]["rooms"]) == 2  # the helper lives on
