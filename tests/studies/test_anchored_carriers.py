"""Runs with a plan and any carrier: the design, a drive that is run, and the tables."""

from pathlib import Path
from typing import Any

import pytest
from small_ifc import write_small_ifc
from study_rows import rows_of

from evaluation.drives import SequenceSpec
from evaluation.drives.carried import CarriedCase
from evaluation.metrics.regions import Inside
from evaluation.studies.carried.anchored_carriers import Anchored, Choice, cases, measure, tables


def case(building: SequenceSpec, **fields: Any) -> CarriedCase:
    given = {"seed": 1, "carrier": "handheld", "sensor": "VLP-16", "seconds": 12.0, **fields}
    return CarriedCase(sequence=building, **given)  # type: ignore[arg-type]


def found(rmse_m: float | None, **fields: Any) -> Anchored:
    given = {
        "scans": 120, "length_m": 70.0, "anchored": rmse_m is not None, "reason": "so" if rmse_m else "why not",
        "first_anchor_s": None if rmse_m is None else 5.0,
        "rmse_m": rmse_m, "plan_view_m": rmse_m, "height_m": rmse_m, "worst_m": rmse_m, "wrong": 0,
        "inside": None if rmse_m is None else Inside(poses=100, plan_view=0.9, height=1.0, yaw=rmse_m), "map_m": 0.02,
        "odometry_m": 0.03, "lost": 0, "kidnaps": 0, "floors": 1, "rooms": 2, "scans_per_s": 50.0, **fields,
    }  # fmt: skip
    return Anchored(**given)  # type: ignore[arg-type]


def test_each_drive_of_the_design_is_there_once() -> None:
    design = Choice(sequences=("demo", "house-1"), seeds=(0, 1), effects=("glass", "people"), sensors=("OS1-64",))
    drives = cases(design)
    assert len({drive.key for drive in drives}) == len(drives) == 2 * 2 * (2 * (3 + 2 + 2) + 1)
    assert {drive.times for drive in drives if drive.recorded} == {True, False}
    assert all(drive.times for drive in drives if not drive.recorded)
    assert all(drive.carrier == "handheld" for drive in drives if drive.effects)


def test_a_few_drives_a_cell_are_drawn_from_all() -> None:
    design = Choice(sequences=("demo", "house-1"), seeds=(0, 1, 2), per_cell=2, untimed=(), sensors=("OS1-64",))
    drives = cases(design)
    cells = {(drive.carrier, drive.effects, drive.sensor) for drive in drives}
    assert len(drives) == 2 * len(cells)
    assert len({(drive.sequence.name, drive.seed) for drive in drives}) == 6


@pytest.mark.slow
def test_a_drive_is_run_with_the_plan_and_its_scans_are_deleted(tmp_path: Path) -> None:
    building = SequenceSpec(name="small", bim=str(write_small_ifc(tmp_path / "small.ifc").path), storey="Ground")
    work = tmp_path / "work"
    work.mkdir()
    own = measure(case(building), work)
    assert own.scans == 120 and own.map_m is not None and own.odometry_m is not None and own.odometry_m < 0.1
    assert own.floors == 1 and own.kidnaps == 0 and own.scans_per_s > 1
    assert own.anchored == (own.rmse_m is not None) == (own.first_anchor_s is not None)
    assert not list(work.iterdir())


def test_the_tables_count_drives_with_an_anchored_twin() -> None:
    a, b = (SequenceSpec(name=name, bim=f"{name}.ifc", storey="Ground") for name in ("a", "b"))
    rows = rows_of([
        (case(a, carrier="wheeled"), found(0.01)), (case(b, carrier="wheeled"), found(None)),
        (case(a), found(0.02)), (case(b), found(None)),
        (case(a, effects=("glass",)), found(None, map_m=0.05, kidnaps=1)),
        (case(a, effects=("glass",), backwards=True), found(0.02, length_m=59.0)),
    ])  # fmt: skip
    made = tables(rows)
    line = made["anchored"].set_index(["carrier", "effects"])
    assert line.loc[("handheld", "none"), "anchored"] == "1/2"
    assert line.loc[("handheld", "none"), "of those over 60 m with an anchored twin"] == "1/1"
    assert line.loc[("handheld", "glass"), "of those over 60 m with an anchored twin"] == "0/1"
    assert line.loc[("handheld", "none"), "RMSE (m)"] == "0.020 (0.020 to 0.020)"
    assert made["not_anchored"].reason.tolist() == ["why not"] * 3
    assert made["not_anchored"].building.tolist() == ["a", "b", "b"]
    told = made["calibration"].set_index(["carrier", "effects"])
    assert told.loc[("handheld", "none")].to_dict() == {
        "poses": "100", "plan view": "90.0%", "height": "100.0%", "yaw": "2.0%",
    }  # fmt: skip
    (against,) = made["against_odometry"].to_dict("records")
    assert against["no worse"] == "5/6" and against["worse by 1 cm"] == "1/6" and against["false kidnappings"] == "1/6"
