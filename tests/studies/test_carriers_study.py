"""Tracking with any carrier: the design, a drive that is simulated and tracked, and the tables."""

from pathlib import Path
from typing import Any

import pytest
from small_ifc import write_small_ifc
from study_rows import rows_of

from data.common.errors import UserError
from evaluation.drives import SequenceSpec
from evaluation.metrics.tracker_claims import Reliability
from evaluation.studies.carried.carriers import QUICK, Choice, Errors, Run, Tracking, cases, measure
from evaluation.studies.carried.carriers_tables import claims, tables


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> SequenceSpec:
    path = write_small_ifc(tmp_path_factory.mktemp("carriers") / "small.ifc").path
    return SequenceSpec(name="small", bim=str(path), storey="Ground")


def run(building: SequenceSpec, *methods: str, **fields: Any) -> Run:
    given = {"seed": 1, "carrier": "handheld", "sensor": "VLP-16", "seconds": 6.0, **fields}
    return Run(sequence=building, methods=methods, **given)  # type: ignore[arg-type]


def test_each_drive_of_the_design_is_there_once() -> None:
    design = Choice(sequences=("demo", "house-1"), seeds=(0, 1), effects=("glass", "people"))
    found = cases(design)
    assert len({case.key for case in found}) == len(found)
    cells = 3 * 6 + 2 * 2 + 6 + len(design.mounts) + 4 * 2 * 2
    assert len(found) == cells * 2 * 2 and {case.methods for case in found} == {design.methods}
    recorded = [case for case in found if case.recorded]
    assert len(recorded) == 16 * 4 and {case.times for case in recorded} == {True, False}
    assert all(design.recording in case.files() for case in recorded)
    assert {case.pace for case in recorded if case.backwards} == {1.0}
    assert all(case.effects in ((), ("all",)) or case.sensor in design.few_sensors for case in found)
    assert len(cases(QUICK)) < 20 and all(case.seconds == 20 for case in cases(QUICK))


def test_each_cell_is_there_with_drives_in_turn() -> None:
    design = Choice(sequences=("demo", "house-1"), seeds=(0, 1), parts=("cells",), effects=("glass",), per_cell=3)
    found = cases(design)
    cells = {(case.carrier, case.effects, case.sensor) for case in found}
    assert len(cells) == 4 * 3 * 6 and len({case.key for case in found}) == len(found) == 3 * len(cells)
    used = [sum((case.sequence.name, case.seed) == drive for case in found)
            for drive in (("demo", 0), ("demo", 1), ("house-1", 0), ("house-1", 1))]  # fmt: skip
    assert used == [54] * 4


@pytest.mark.slow
def test_a_drive_is_tracked_by_each_method_and_its_scans_are_deleted(building: SequenceSpec, tmp_path: Path) -> None:
    found = measure(run(building, "sgslam", "kiss_icp", carrier="wheeled"), tmp_path)
    assert found.scans == 60 and set(found.found) == set(found.scans_per_s) == {"sgslam", "kiss_icp"}
    ours, kiss = found.found["sgslam"], found.found["kiss_icp"]
    assert (ours.missing, ours.instant, ours.kidnaps) == (0, 0.0, 0) and (kiss.instant, kiss.kidnaps) == (1.0, None)
    assert ours.ate_m is not None and ours.ate_m < 0.1 and ours.second_m <= ours.second_95_m < 0.1
    told = ours.reliability
    assert told is not None and told.up_deg is not None and kiss.reliability is None
    assert told.good + told.degraded + told.lost == pytest.approx(1.0) and told.good > 0.9 and told.wrongly_good == 0
    # over four seeds all scans are good, all motions inside, and up errs by 0.16 to 0.25 degrees
    assert told.motions >= 30 and told.inside_95 is not None and told.inside_95 > 0.8 and told.up_deg < 1.0
    assert kiss.second_m < 0.2 and min(found.scans_per_s.values()) > 1
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_peer_gets_the_times(building: SequenceSpec, tmp_path: Path) -> None:
    told, untold = (
        measure(run(building, "small_gicp", times=times, seconds=12.0), tmp_path).found["small_gicp"]
        for times in (True, False)
    )
    assert told.instant == 1.0 and told.missing == untold.missing == 0
    assert told.second_m < 0.8 * untold.second_m  # over four seeds 0.45 to 0.64 times as large


@pytest.mark.slow
def test_a_carrier_that_is_not_there_is_told(building: SequenceSpec, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="carrier 'horse'"):
        measure(run(building, "small_gicp", carrier="horse"), tmp_path)
    assert not list(tmp_path.iterdir())


def errors(ate_m: float | None, kidnaps: int | None = None, reliability: Reliability | None = None) -> Errors:
    return Errors(
        missing=1, instant=0.0, ate_m=ate_m, second_m=0.02, second_95_m=0.04, second_deg=0.1, second_95_deg=0.2,
        worst_step_m=0.5, kidnaps=kidnaps, reliability=reliability,
    )  # fmt: skip


def tracking(**found: Errors) -> Tracking:
    return Tracking(scans=60, found=found, scans_per_s=dict.fromkeys(found, 20.0))  # type: ignore[arg-type]


def test_the_tables_tell_each_cell_and_compare_with_the_better_peer(building: SequenceSpec) -> None:
    drives: list[dict[str, Any]] = [
        {"seed": 1}, {"seed": 2}, {"mount_deg": (0.0, 12.0, 0.0)}, {"effects": ("glass",)},
        {"effects": ("all",)}, {"carrier": "walk.tum", "pace": 2.0, "backwards": True, "times": False},
    ]  # fmt: skip
    peers = {"kiss_icp": errors(0.2), "small_gicp": errors(0.12)}
    found = [tracking(sgslam=errors(0.36 if n == 1 else 0.06, kidnaps=int(n != 1)), **peers) for n in range(6)]
    rows = rows_of(zip((run(building, *found[0].found, **drive) for drive in drives), found, strict=True))
    made = tables(rows)
    (carriers,) = made["carriers"].to_dict("records")
    assert (carriers["carrier"], carriers["sensor"], carriers["seconds"]) == ("handheld", "VLP-16", "6")
    assert carriers["drives"] == "2" and carriers["sgslam: ATE (m)"] == "0.210 (0.060 to 0.360)"
    assert carriers["ratio"] == "1.75 (0.50 to 3.00)"
    assert made["cells"].to_dict("records") == [
        {"carrier": "handheld", "effects": "none", "VLP-16": "0.210 (1.75)*"},
        {"carrier": "handheld", "effects": "glass", "VLP-16": "0.060 (0.50)"},
        {"carrier": "handheld", "effects": "all", "VLP-16": "0.060 (0.50)"},
    ]
    assert made["effects"].effects.tolist() == ["none", "glass", "all"]
    assert made["mounts"]["mount"].tolist() == ["0, 0, 0", "0, 12, 0"] and made["mounts"].drives.tolist() == ["2", "1"]
    (recorded,) = made["recording"].to_dict("records")
    assert (recorded["carrier"], recorded["times"]) == ("recording, backwards, pace 2", "not given")
    compared = made["ratios"].set_index("part").loc["carriers"]
    assert (compared["no worse"], compared["tracked"], compared["tracked by the better peer"]) == ("1/2", "1/2", "0/2")
    ours = made["errors"].set_index("method").loc["sgslam"]
    assert (ours["drives"], ours["false kidnappings"], ours["poses missing"]) == ("6", "5", "6/360")
    relative, kidnapped = claims(rows)
    assert relative.value == "0.50 (0.50 to 3.00)" and kidnapped.value.startswith("5 of 6")


def test_a_part_without_rows_has_no_table_and_a_lost_drive_is_worse_than_any(building: SequenceSpec) -> None:
    rows = [
        (run(building, "sgslam", "kiss_icp"), tracking(sgslam=errors(None, kidnaps=0), kiss_icp=errors(1.0))),
        (run(building, "kiss_icp", seed=2), tracking(kiss_icp=errors(2.0))),
    ]
    made = tables(rows_of(rows))
    assert set(made) == {"cells", "carriers", "ratios", "errors"}
    (compared,) = made["ratios"].to_dict("records")
    assert (compared["no worse"], compared["worse by 2 cm"], compared["tracked"]) == ("0/1", "1/1", "0/1")
    (cell,) = made["carriers"].to_dict("records")
    assert (cell["sgslam: ATE (m)"], cell["ratio"]) == ("inf", "inf")
    assert cell["KISS-ICP: ATE (m)"] == "1.500 (1.000 to 2.000)"
    assert "lost" in claims(rows_of(rows))[0].value
    assert made["errors"].drives.tolist() == ["1", "2"]


def test_methods_that_tracked_a_drive_in_rows_of_their_own_are_compared(building: SequenceSpec) -> None:
    rows = rows_of(
        [
            (run(building, "sgslam"), tracking(sgslam=errors(0.06))),
            (run(building, "sgslam", "kiss_icp"), tracking(sgslam=errors(0.4), kiss_icp=errors(0.2))),
            (run(building, "small_gicp"), tracking(small_gicp=errors(0.12))),
        ]
    )
    rows.loc[0, "made.date"] = "2026-01-02 00:00"  # our tracker was measured again
    (cell,) = tables(rows)["carriers"].to_dict("records")
    assert (cell["drives"], cell["sgslam: ATE (m)"], cell["ratio"]) == ("1", "0.060", "0.50")
    assert tables(rows)["errors"].drives.tolist() == ["1", "1", "1"]


def reliable(good: float, inside_95: float | None, motions: int) -> Reliability:
    return Reliability(
        good=good, degraded=0.0, lost=1 - good, inside_95=inside_95, motions=motions, wrongly_good=2, up_deg=0.5
    )


def test_reliability_is_pooled_over_scans_and_motions(building: SequenceSpec) -> None:
    drives: list[dict[str, Any]] = [{"seed": 1}, {"seed": 2}, {"seed": 3}, {"effects": ("glass",)}]
    told = [reliable(1.0, 0.9, 30), reliable(0.5, 0.6, 10), reliable(0.0, None, 0), reliable(0.0, None, 0)]
    found = [tracking(sgslam=errors(0.1, 0, own), kiss_icp=errors(0.2)) for own in told]
    rows = rows_of(zip((run(building, "sgslam", "kiss_icp", **drive) for drive in drives), found, strict=True))
    plain, glass = tables(rows)["reliability"].to_dict("records")
    assert (plain["carrier"], plain["mount"], plain["effects"]) == ("handheld", "0, 0, 0", "none")
    assert (plain["drives"], plain["good (%)"], plain["lost (%)"]) == ("3", "50.0", "50.0")
    assert plain["inside the 95 % region (%)"] == "82.5" and plain["wrongly good"] == "6/180"
    assert plain["error of up (deg)"] == "0.50 (0.50 to 0.50)"
    assert (glass["effects"], glass["drives"], glass["inside the 95 % region (%)"]) == ("glass", "1", "")
