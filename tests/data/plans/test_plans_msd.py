"""Modified Swiss Dwellings' table: apartments and floors, rows in any order, bad rows counted."""

import csv
from pathlib import Path

import pytest
import shapely
from plans import box

from data import UserError
from data.plans import read_plans
from data.plans.sources import read_msd

V1 = (
    "apartment_id", "site_id", "building_id", "plan_id", "floor_id", "unit_id", "area_id", "unit_usage",
    "entity_type", "entity_subtype", "geom", "elevation", "height", "zoning", "roomtype",
)  # fmt: skip
V2 = ("", *V1[1:], "apartment_id")  # another order of columns, the index first


def row(floor: int, apartment: str, kind: str, polygon: object, entity: str = "area", height: float = 2.6) -> dict:
    return {
        "site_id": 7, "building_id": 70 + floor % 2, "plan_id": 700, "floor_id": float(floor), "unit_id": 1.0,
        "apartment_id": apartment, "entity_type": entity, "entity_subtype": kind.upper().replace(" ", "_"),
        "geom": polygon if isinstance(polygon, str) else shapely.Polygon(polygon).wkt,
        "elevation": 2.9 * floor, "height": height, "roomtype": kind, "zoning": "Zone1",
    }  # fmt: skip


def flat(floor: int, apartment: str, x: float = 0.0) -> list[dict]:
    return [
        row(floor, apartment, "Bedroom", box(x, 0, 4, 3)),
        row(floor, apartment, "Corridor", box(x + 4.12, 0, 1.5, 3)),
        row(floor, apartment, "Balcony", box(x, -2, 4, 1.6)),
        row(floor, "", "Door", box(x + 4, 1, 0.12, 0.9), "opening"),
        row(floor, "", "Structure", box(x - 0.2, -0.2, 6, 0.2), "separator"),
    ]


def table(path: Path, rows: list[dict], columns: tuple[str, ...] = V1) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        writer.writerows(rows)
    return path


@pytest.mark.parametrize(("name", "columns"), [("MSD 5.664k (V1).csv", V1), ("mds_V2_5.372k.csv", V2)])
def test_apartments_in_both_published_tables(tmp_path: Path, name: str, columns: tuple[str, ...]) -> None:
    """Rooms, doors, floor with its elevation, building; the balcony is no room."""
    path = table(tmp_path / name, flat(1, "aa") + flat(1, "bb", 6.0) + flat(2, "cc"), columns)
    plans = list(read_plans(path))
    assert [p.name for p in plans] == ["apartment aa", "apartment bb", "apartment cc"]
    assert {p.building for p in plans} == {"site 7"}
    for plan, floor in zip(plans, ("1", "1", "2"), strict=True):
        graph = plan.graph
        assert [r.name for r in graph.rooms] == ["Bedroom", "Corridor"]
        assert [(f.id, f.elevation) for f in graph.floors] == [(floor, 2.9 * int(floor))]
        assert {r.floor for r in graph.rooms} == {floor} and len(graph.wall_surfaces) == 8
        assert graph.wall_surfaces[0].height == pytest.approx((2.9 * int(floor), 2.9 * int(floor) + 2.6))
        assert [set(d.rooms) for d in graph.doors if len(d.rooms) == 2] == [{r.id for r in graph.rooms}]
    assert [p.name for p in read_plans(path, limit=2)] == ["apartment aa", "apartment bb"]


def test_rows_of_a_plan_may_lie_anywhere(tmp_path: Path) -> None:
    """A shuffled table gives the same apartments."""
    rows = flat(1, "aa") + flat(2, "bb")
    kept = {p.name: p.graph for p in read_plans(table(tmp_path / "a.csv", rows))}
    mixed = {p.name: p.graph for p in read_plans(table(tmp_path / "b.csv", rows[::2] + rows[1::2]))}
    for name, graph in kept.items():
        assert {w.centroid for w in graph.wall_surfaces} == {w.centroid for w in mixed[name].wall_surfaces}


def test_whole_floors_have_what_lies_between_the_apartments(tmp_path: Path) -> None:
    """Stairs belong to no apartment; a maisonette's rooms are on both of its floors."""
    stairs = row(1, "", "Stairs", box(6, 4, 3, 5))
    path = table(tmp_path / "t.csv", [*flat(1, "aa"), stairs, *flat(1, "bb", 6.0), *flat(2, "aa")])
    first, second = read_msd(path, by="floor")
    assert [r.name for r in first.graph.rooms] == ["Bedroom", "Corridor", "Stairs", "Bedroom", "Corridor"]
    assert second.name == "floor 2" and first.building == second.building
    maisonette = next(p for p in read_msd(path) if p.name == "apartment aa").graph
    assert [f.id for f in maisonette.floors] == ["1", "2"]
    assert len(maisonette.on_floor("2").wall_surfaces) == 8


def test_raw_edges_of_the_published_graphs(tmp_path: Path) -> None:
    """Every edge of every ring, balconies as well, in the table's coordinates."""
    ring = [(0, 0), (2, 0), (4, 0), (4, 3), (0, 3)]
    path = table(tmp_path / "t.csv", [row(1, "aa", "Bedroom", ring), row(1, "aa", "Balcony", box(0, -2, 4, 2))])
    (plan,) = read_plans(path, merge_collinear=False)
    assert len(plan.graph.rooms) == 2 and len(plan.graph.wall_surfaces) == 9


def test_bad_rows_are_counted_and_reported(tmp_path: Path) -> None:
    """No WKT, nothing in it, a row cut short: the rest is read."""
    rows = [*flat(1, "aa"), row(1, "aa", "Kitchen", "POLYGON ((0 0, 1"), row(1, "aa", "Kitchen", "POLYGON EMPTY")]
    path = table(tmp_path / "t.csv", [*rows, row(2, "bb", "Kitchen", "nonsense")])
    with path.open("a") as file:
        file.write("cut,short\n")
    notices: list[str] = []
    plans = list(read_plans(path, on_skip=notices.append))
    assert [len(p.graph.rooms) for p in plans] == [2]
    told = "\n".join(notices)
    assert "1 of 2 plans" in told and "2 rows: the polygon is not WKT" in told
    assert "1 rows: no area" in told and "1 rows: not as many columns" in told


def test_other_tables_are_refused(tmp_path: Path) -> None:
    """By the column that they lack, or for not being a table."""
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match=r"t\.csv: not Modified Swiss Dwellings: no column floor_id"):
        list(read_plans(path))
    path.write_bytes(b"floor_id,\xff\xfe\n")
    with pytest.raises(UserError, match="not a CSV table"):
        list(read_plans(path))
