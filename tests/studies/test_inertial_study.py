"""Tracking with an IMU: the design, a drive that is tracked by each method, and the tables."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from small_ifc import write_small_ifc
from study_rows import rows_of

from data.common.errors import UserError
from data.imu import ImuSamples
from data.scans import Scan
from evaluation.drives import SequenceSpec
from evaluation.slam_ablation.peers import genz_lio_alone
from evaluation.studies.carried.inertial import QUICK, Choice, Run, cases, measure, tables

LIBRARIES = ("rko_lio", "genz_lio")
needs_both = pytest.mark.skipif(
    any(find_spec(name) is None for name in LIBRARIES), reason="needs the extras rko_lio and genz_lio"
)


def test_each_drive_of_the_design_is_there_once() -> None:
    design = Choice(sequences=("demo", "house-1"), seeds=(0, 1))
    found = cases(design)
    assert len({case.key for case in found}) == len(found) == (3 + 3) * 2 * 2 * 4
    as_long = {case.seconds * case.pace for case in found}
    assert as_long == {design.seconds} and {case.pace for case in found if case.recorded} == {1.0, 2.0, 4.0}
    assert {case.imu for case in cases(QUICK)} == {"mid360"}


@needs_both
@pytest.mark.long
@pytest.mark.slow
def test_a_drive_is_tracked_by_each_method(tmp_path: Path) -> None:
    building = SequenceSpec(name="small", bim=str(write_small_ifc(tmp_path / "small.ifc").path), storey="Ground")
    work = tmp_path / "work"
    work.mkdir()
    case = Run(
        sequence=building, seed=1, carrier="handheld", sensor="VLP-16", imu="mid360", seconds=6.0,
        methods=("sgslam", "sgslam_imu", *LIBRARIES), anchored=("sgslam_imu",),
    )  # fmt: skip
    found = measure(case, work)
    assert found.scans == 60 and all(errors.missing == 0 for errors in found.found.values())
    ate = {method: errors.ate_m for method, errors in found.found.items()}
    assert all(own is not None and own < 0.15 for own in ate.values()), ate
    assert {method: errors.instant for method, errors in found.found.items()} == {
        "sgslam": 0.0, "sgslam_imu": 0.0, "rko_lio": 1.0, "genz_lio": 1.0,
    }  # fmt: skip
    made = tables(rows_of([(case, found)]))
    assert made["ate"].iloc[0]["GenZ-LIO: ATE (m)"].startswith(f"{ate['genz_lio']:.3f}")
    assert 0 < found.turn_deg_s <= found.fastest_deg_s < 90
    assert found.with_plan["sgslam_imu"].scans == 60 and list(made["anchored"]["method"]) == ["sgslam with the IMU"]
    assert list(made["errors"]["method"]) == ["sgslam", "sgslam with the IMU", "RKO-LIO", "GenZ-LIO"]
    assert not list(work.iterdir())


@pytest.mark.skipif(find_spec("genz_lio") is None, reason="needs the extra genz_lio")
def test_samples_that_begin_after_the_scans_are_refused() -> None:
    stamps = np.arange(10**9, 2 * 10**9, 5_000_000)
    samples = ImuSamples(stamps, np.zeros((len(stamps), 3)), np.tile([0.0, 0.0, 9.8], (len(stamps), 1)))
    with pytest.raises(UserError, match="begin after the scans"):
        genz_lio_alone([Scan(0, 0, np.ones((30, 3)))], samples)
