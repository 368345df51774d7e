"""Other SLAM systems' output anchored: the design, a drive whose output the command anchors, and the tables."""

from pathlib import Path

import pandas as pd
import pytest
from small_ifc import write_small_ifc
from study_rows import rows_of

from data.common.errors import UserError
from evaluation.drives import SequenceSpec
from evaluation.slam_ablation.kiss_slam import kiss_slam_results
from evaluation.studies.carried.other_slam import QUICK, Choice, Gain, Gains, Run, cases, measure, tables

NO_COMMAND = "no_such_command"


def test_each_drive_of_the_design_is_there_once(capsys: pytest.CaptureFixture[str]) -> None:
    found = cases(QUICK.model_copy(update={"kiss_slam": NO_COMMAND}))
    assert len({case.key for case in found}) == len(found) == 4 * 2
    assert {case.systems for case in found} == {("rko_lio", "small_gicp")}
    assert "KISS-SLAM is left out" in capsys.readouterr().err
    with_it = cases(Choice(sequences=("office",), seeds=(0,), kiss_slam="true"))
    assert {case.systems for case in with_it} == {("kiss_slam", "rko_lio", "small_gicp")}


def test_a_command_that_fails_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="false failed: no message"):
        kiss_slam_results("false", tmp_path / "scans", tmp_path)


def case_of(building: SequenceSpec, sensor: str = "VLP-16") -> Run:
    return Run(
        sequence=building, seed=1, carrier="handheld", sensor=sensor, imu="mid360", seconds=15.0,
        systems=("small_gicp",),
    )  # fmt: skip


@pytest.mark.long
@pytest.mark.slow
def test_the_output_of_a_drive_is_anchored(tmp_path: Path) -> None:
    building = SequenceSpec(name="small", bim=str(write_small_ifc(tmp_path / "small.ifc").path), storey="Ground")
    (work := tmp_path / "work").mkdir()
    found = measure(case_of(building), work)
    gain = found.found["small_gicp"]
    assert found.scans == gain.poses == 150 and found.cpu_s["small_gicp"] > 0
    assert gain.anchored and gain.alone_m is not None and gain.rmse_m is not None and gain.worst_m is not None
    assert gain.rmse_m < gain.alone_m < 0.05 and gain.worst_m < 0.05 and gain.wrong == 0
    assert not list(work.iterdir())


def test_an_output_that_is_not_anchored_counts_as_no_gain() -> None:
    building = SequenceSpec(name="small", bim="small.ifc", storey="Ground")
    good = Gain(poses=9, alone_m=0.1, anchored=True, reason="fits", rmse_m=0.01, worst_m=0.02, wrong=0)
    bad = Gain(poses=9, alone_m=0.2, anchored=False, reason="tilted", rmse_m=None, worst_m=None, wrong=0)
    rows = [
        (case_of(building, sensor), Gains(scans=9, length_m=5.0, found={"small_gicp": gain}, cpu_s={"small_gicp": 3.0}))
        for sensor, gain in (("VLP-16", good), ("Mid-360", bad))
    ]
    made = tables(rows_of(rows))
    (gained,) = made["gain"].to_dict("records")
    assert gained["anchored"] == "1/2" and gained["at least 80 %"] == "1/2"
    assert gained["error removed (%)"] == "90 (90 to 90)" and gained["poses wrong"] == "0/9"
    assert made["drives"]["anchored: RMSE (m)"].tolist() == ["0.010", ""]
    lost = pd.DataFrame(made["not_anchored"])
    assert lost[["sensor", "reason"]].values.tolist() == [["Mid-360", "tilted"]]
