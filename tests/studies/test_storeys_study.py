"""A drive over storeys whose recording has a hole: errors are those of the scans that are there."""

from pathlib import Path

import pytest
from small_ifc import write_small_ifc

from data.trajectory import Trajectory
from evaluation.studies import storeys
from evaluation.studies.storeys import StoreyDrive, measure


@pytest.mark.slow
def test_scans_that_are_missing_in_the_middle_of_a_drive_are_no_error(tmp_path: Path) -> None:
    bim = write_small_ifc(tmp_path / "small.ifc").path
    case = StoreyDrive(
        bim=str(bim), storeys=("Ground",), seed=3, carrier="wheeled", min_rooms=2, min_length=8.0, method="learned"
    )
    drive = storeys._drive(case, bim, tmp_path)
    times, truth = drive / "scans/times.txt", Trajectory.read_tum(drive / "truth.tum")
    stamps = times.read_text().splitlines()
    times.write_text("\n".join([*stamps[:60], *stamps[68:]]) + "\n")
    for scan in sorted((drive / "scans").glob("*.ply"))[60:68]:
        scan.unlink()
    found = measure(case, tmp_path)
    assert found.coverage == pytest.approx(1 - 8 / len(truth))
    assert found.rmse_m is not None and found.max_m is not None and found.unique_m is not None
    assert found.rmse_m < 0.03 and found.max_m < 0.15 and not found.wrong_place and not found.wrong_storey
