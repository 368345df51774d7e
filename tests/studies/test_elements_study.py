"""Verdicts on elements beside the truth: the design, how each was built, unplanned walls, and the tables."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_ifc import write_small_ifc
from study_rows import rows_of

from data.ifc.products import open_ifc
from data.scene_graph import Floor, Room, SceneGraph
from data.simulation import Change
from data.trajectory import Trajectory
from evaluation.drives import SequenceSpec
from evaluation.metrics.true_walls import TrueWall
from evaluation.studies.carried.elements import CHANGES, STUDY, Built, Choice, Verdicts, cases
from evaluation.studies.carried.elements_tables import tables
from evaluation.studies.carried.elements_truth import (
    Building,
    Judged,
    Unplanned,
    entered_m2,
    unplanned_found,
    with_fillings,
)
from sgslam.as_built.elements import ElementVerdict


def verdict(key: str, ifc_class: str, direction: tuple[float, float, float] | None = None) -> ElementVerdict:
    return ElementVerdict(
        key, "", ifc_class, "", (), "moved", 0.01, direction, 0.005, None, False, None, None, None, None, 0.5, 4, "", ()
    )  # fmt: skip


def wall(key: str, kind: str, y: float, views: int) -> TrueWall:
    return TrueWall(key, kind, (0.0, 0.0), views, ((0.0, y), (4.0, y), (4.0, y + 0.2), (0.0, y + 0.2)))


def judged(element: str, built: str, true_m: float, verdict: str, offset_m: float | None, **more: Any) -> Judged:
    fields = {"sigma_m": 0.004, "conclusive": True, "seen": 0.8, "views": 5 if element == "wall" else None} | more
    return Judged(element=element, built=built, true_m=true_m, verdict=verdict, offset_m=offset_m, **fields)


def case(cell: str) -> Built:
    spec = SequenceSpec(name="small", bim="small.ifc", storey="Ground")
    return Built(
        sequence=spec, seed=1, carrier="wheeled", sensor="VLP-16", seconds=70.0, cell=cell, changes=CHANGES[cell],
        tolerance_m=0.01,
    )  # fmt: skip


def test_the_pole_has_few_sensors_and_shelves_stand_where_walls_are_absent() -> None:
    found = cases(Choice(sequences=("office",), seeds=(0, 1), effects=("shelves", "tolerance")))
    assert len({own.key for own in found}) == len(found) == (2 + 2 + 1) * 3 * 2
    assert {own.sensor for own in found if own.carrier == "pole"} == {"VLP-16"}
    assert {own.effects for own in cases(Choice()) if own.cell == "absent"} == {("shelves",)}
    assert {own.effects for own in cases(Choice()) if own.cell != "absent"} == {()}
    assert Built.model_validate(found[0].model_dump(mode="json")).key == found[0].key
    assert len(cases(STUDY.quick)) == 3


def test_a_walls_offset_is_the_sum_of_its_shifts_along_what_was_measured() -> None:
    moved, off = Change("w", "moved", (0.0, 0.015)), Change("w", "moved", (0.0, -0.02))
    building = Building({"w": moved}, {"w": off}, {"w": 7})
    across = building.judged(verdict("w", "IfcWallStandardCase", (0.0, -1.0, 0.0)))
    along = building.judged(verdict("w", "IfcWall", (1.0, 0.0, 0.0)))
    assert across is not None and along is not None
    assert (across.element, across.built, across.views, along.true_m) == ("wall", "moved", 7, 0.0)
    np.testing.assert_allclose([across.true_m, building._offset(verdict("w", "IfcWall"))], 0.005)
    assert building.judged(verdict("s", "IfcSlab")) is None
    door = Building({"d": Change("d", "filled")}, {}, {}).judged(verdict("d", "IfcDoor"))
    assert door is not None and (door.built, door.views) == ("filled", None)


def test_doors_of_an_absent_wall_are_absent(tmp_path: Path) -> None:
    building = write_small_ifc(tmp_path / "small.ifc")
    model = open_ifc(building.path)
    door = model.by_type("IfcDoor")[0]
    host = door.FillsVoids[0].RelatingOpeningElement.VoidsElements[0].RelatingBuildingElement.GlobalId
    found = with_fillings(building.path, [Change(host, "absent")])
    assert found[door.GlobalId].kind == "absent"
    assert set(with_fillings(building.path, [Change(host, "moved")])) == {host}


def test_entries_are_on_unplanned_walls_on_planned_ones_or_false() -> None:
    walls = [
        wall("u1", "unplanned", 0.0, 3), wall("u2", "unplanned", 2.0, 2), wall("p", "as planned", 4.0, 9),
        wall("u3", "unplanned", 6.0, 5),
    ]  # fmt: skip
    traces = [
        ((0.0, 0.35), (1.0, 0.35)), ((1.0, -0.1), (2.0, -0.1)), ((0.0, 2.0), (1.0, 2.0)), ((0.0, 4.0), (9.0, 4.0)),
        ((1.0, 5.0), (2.0, 5.0)), ((3.6, 6.1), (5.0, 6.1)),
    ]  # fmt: skip
    assert unplanned_found(traces, walls, 12.0) == Unplanned(to_find=2, found=1, false=2, on_planned=1, m2=12.0)
    assert unplanned_found([], [], 0.0) == Unplanned(to_find=0, found=0, false=0, on_planned=0, m2=0.0)


def test_only_rooms_that_were_entered_on_their_storey_have_an_area() -> None:
    square = ((0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (0.0, 2.0))
    beside = tuple((x + 3.0, y) for x, y in square)
    rooms = (
        Room("a", (1.5, 1.0), "low", polygon=square), Room("b", (4.5, 1.0), "low", polygon=beside),
        Room("c", (1.5, 1.0), "high", polygon=square),
    )  # fmt: skip
    plan = SceneGraph("bim", rooms, (), floors=(Floor("low", elevation=0.0), Floor("high", elevation=3.0)))
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, 3] = (1.0, 1.0, 0.5)
    assert entered_m2(plan, Trajectory(np.arange(2), poses)) == pytest.approx(6.0)


def test_the_tables_count_what_was_told() -> None:
    first = Verdicts(
        rmse_m=0.005, not_seen={"as planned": 7, "moved": 1, "displaced": 1},
        unplanned=Unplanned(to_find=0, found=0, false=0, on_planned=0, m2=9.0),
        judged=(
            judged("wall", "moved", 0.015, "moved", 0.017), judged("wall", "moved", -0.015, "as planned", -0.009),
            judged("wall", "moved", 0.015, "as planned", 0.009, seen=0.2), judged("wall", "moved", 0.0, "moved", 0.011),
            judged("wall", "as planned", 0.0, "moved", 0.02), judged("wall", "as planned", 0.0, "as planned", 0.001),
            judged("wall", "moved", 0.015, "not seen", None), judged("door", "displaced", 0.1, "moved", 0.09),
            judged("door", "displaced", 0.1, "not seen", None), judged("door", "as planned", 0.0, "absent", None),
            judged("door", "as planned", 0.0, "uncertain", 0.02),
        ),
    )  # fmt: skip
    third = Verdicts(
        rmse_m=0.006, not_seen={"as planned": 5, "absent": 1},
        unplanned=Unplanned(to_find=3, found=2, false=1, on_planned=4, m2=40.0),
        judged=(
            judged("wall", "absent", 0.0, "absent", None), judged("wall", "absent", 0.0, "not seen", None),
            judged("wall", "absent", 0.0, "absent", None, views=2),
            judged("wall", "as planned", 0.0, "as planned", 0.0),
        ),
    )  # fmt: skip
    lost = Verdicts(rmse_m=None, judged=(), not_seen={}, unplanned=None)
    made = tables(rows_of([(case("15 mm"), first), (case("absent"), third), (case("30 mm"), lost)]))
    assert list(made["drives"].anchored) == ["1/1", "1/1", "0/1"]
    walls = made["walls"].set_index("cell").loc["15 mm"]
    assert list(walls)[2:] == ["1/2", "1", "1/3", "2/3", "0/3"]
    assert list(made["absent"].iloc[0])[2:] == ["1/2", "0/2", "1/2", "1/1", f"1/{(11 + 7) + (1 + 5)}"]
    assert list(made["openings"].iloc[0])[2:] == ["door", "1/1", "", "", "1/2", "1/3 (33 %)"]
    assert list(made["unplanned"].iloc[0])[2:] == ["1", "2/3", "1", "4", "40"]
    offsets = made["offsets"].set_index("measured")
    assert offsets.loc["displaced openings", "median error (mm)"] == "10.0"
    assert offsets.loc["walls", "number"] == "7" and offsets.loc["walls", "within 5 mm"].startswith("3/7")
