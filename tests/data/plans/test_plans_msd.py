"""Modified Swiss Dwellings' table: apartments and floors, rows in any order, bad rows counted."""

import csv
from pathlib import Path
from typing import Any

import pytest
import shapely
from plans import box

from data import UserError
from data.plans import read_plans

Row = dict[str, Any]


def row(floor: int, apartment: str, kind: str, polygon: Any, entity: str = "area") -> Row:
    geom = polygon if isinstance(polygon, str) else shapely.Polygon(polygon).wkt
    place = {"site_id": 7, "building_id": 70 + floor % 2, "floor_id": float(floor), "apartment_id": apartment}
    height = {"elevation": 2.9 * floor, "height": 2.6}
    return place | height | {"entity_type": entity, "entity_subtype": kind.upper(), "geom": geom, "roomtype": kind}


V1 = [*row(1, "aa", "Kitchen", box(0, 0, 4, 3)), "plan_id", "zoning"]
V2 = ["", *V1[1:], V1[0]]  # another order of columns, the index first


def flat(floor: int, apartment: str, x: float = 0.0) -> list[Row]:
    return [
        row(floor, apartment, "Bedroom", box(x, 0, 4, 3)),
        row(floor, apartment, "Corridor", box(x + 4.12, 0, 1.5, 3)),
        row(floor, apartment, "Balcony", box(x, -2, 4, 1.6)),
        row(floor, "", "Door", box(x + 4, 1, 0.12, 0.9), "opening"),
        row(floor, "", "Structure", box(x - 0.2, -0.2, 6, 0.2), "separator"),
    ]


def table(path: Path, rows: list[Row], columns: list[str] = V1) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        writer.writerows(rows)
    return path


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize(("name", "columns"), [("MSD 5.664k (V1).csv", V1), ("mds_V2_5.372k.csv", V2)])
def test_apartments_in_both_published_tables(tmp_path: Path, name: str, columns: list[str], mixed: bool) -> None:
    """Rooms, doors, floor with its elevation, building; the balcony is no room; rows may lie anywhere."""
    rows = flat(1, "aa") + flat(1, "bb", 6.0) + flat(2, "cc")
    path = table(tmp_path / name, rows[::2] + rows[1::2] if mixed else rows, columns)
    plans = sorted(read_plans(path), key=lambda plan: plan.name)
    assert [p.name for p in plans] == ["apartment aa", "apartment bb", "apartment cc"]
    assert {p.building for p in plans} == {"site 7"}
    for plan, floor in zip(plans, ("1", "1", "2"), strict=True):
        graph = plan.graph
        assert {r.name for r in graph.rooms} == {"Bedroom", "Corridor"}
        assert [(f.id, f.elevation) for f in graph.floors] == [(floor, 2.9 * int(floor))]
        assert {r.floor for r in graph.rooms} == {floor} and len(graph.wall_surfaces) == 8
        assert graph.wall_surfaces[0].height == pytest.approx((2.9 * int(floor), 2.9 * int(floor) + 2.6))
        assert [set(d.rooms) for d in graph.doors if len(d.rooms) == 2] == [{r.id for r in graph.rooms}]


def test_a_maisonettes_rooms_are_on_both_of_its_floors(tmp_path: Path) -> None:
    """Stairs belong to no apartment."""
    stairs = row(1, "", "Stairs", box(6, 4, 3, 5))
    path = table(tmp_path / "t.csv", [*flat(1, "aa"), stairs, *flat(1, "bb", 6.0), *flat(2, "aa")])
    maisonette = next(p for p in read_plans(path) if p.name == "apartment aa").graph
    assert [r.name for r in maisonette.rooms] == 2 * ["Bedroom", "Corridor"]
    assert [f.id for f in maisonette.floors] == ["1", "2"]
    assert len(maisonette.on_floor("2").wall_surfaces) == 8


def test_bad_rows_are_counted_and_other_tables_refused(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """No WKT, nothing in it, a row cut short: the rest is read."""
    rows = [*flat(1, "aa"), row(1, "aa", "Kitchen", "POLYGON ((0 0, 1"), row(1, "aa", "Kitchen", "POLYGON EMPTY")]
    path = table(tmp_path / "t.csv", [*rows, row(2, "bb", "Kitchen", "nonsense")])
    path.write_text(path.read_text() + "cut,short\n")
    assert [len(p.graph.rooms) for p in read_plans(path)] == [2]
    for part in ("1 of 2 plans", "2 rows: the polygon is not WKT", "1 rows: no area", "1 rows: not as many columns"):
        assert part in "\n".join(caplog.messages)
    for content, message in (
        (b"a,b\n1,2\n", r"t\.csv: not Modified Swiss Dwellings: no column floor_id"),
        (b"floor_id,\xff\xfe\n", "not a CSV table"),
    ):
        path.write_bytes(content)
        with pytest.raises(UserError, match=message):
            list(read_plans(path))
