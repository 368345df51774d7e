"""The tables of odometries and of moving scans, and the file that their rows are kept in."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from drives import small_drive

from data import UserError
from data.scans.writers import SCAN_WRITERS
from data.trajectory.stamps import ns_to_seconds
from evaluation.harness import RecordFile, SequenceSpec
from evaluation.drives.sequences import odometry_of_run
from evaluation.studies import moving_scans, odometries
from sgslam.config import Config, OdometrySettings

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Row:
    name: str
    seed: int
    error: float | None


def test_rows_are_found_again_after_a_restart(tmp_path: Path) -> None:
    first = RecordFile(tmp_path / "rows.csv", Row)
    assert first.find(name="a") is None
    first.add(Row("a", 0, 0.5))
    first.add(Row("a", 1, None))
    again = RecordFile(tmp_path / "rows.csv", Row)
    assert again.find(name="a", seed=1) == {"name": "a", "seed": "1", "error": ""}
    assert again.records == first.records and again.find(name="b") is None


def test_rows_of_another_version_are_refused(tmp_path: Path) -> None:
    (tmp_path / "rows.csv").write_text("name,seed\na,0\n")
    with pytest.raises(UserError, match="other columns"):
        RecordFile(tmp_path / "rows.csv", Row)


@pytest.fixture(scope="module")
def own_sequence(tmp_path_factory: pytest.TempPathFactory) -> SequenceSpec:
    """A user's own sequence: the small building's drive in files."""
    drive, folder = small_drive(), tmp_path_factory.mktemp("own")
    (folder / "scans").mkdir()
    for i, (_, points) in enumerate(drive.scans):
        SCAN_WRITERS["bin"](folder / "scans" / f"{i:06d}.bin", points.astype(np.float32), None)
    stamps = "".join(f"{ns_to_seconds(stamp)}\n" for stamp, _ in drive.scans)
    (folder / "scans" / "times.txt").write_text(stamps)
    drive.truth.write_tum(folder / "truth.tum")
    drive.bim.graph.save(folder / "plan.json")
    return SequenceSpec("own", str(folder / "plan.json"), None, str(folder / "scans"), str(folder / "truth.tum"))


def test_a_given_odometry_is_measured_and_not_again(own_sequence: SequenceSpec, tmp_path: Path) -> None:
    (r,) = records = odometries.measure([own_sequence], [0], ["given"], tmp_path)
    assert r["odometry"] == "given" and r["anchored"] == "True" and float(r["rmse_bim_m"]) < 0.03
    assert float(r["cpu_run"]) > 0 and float(r["cpu_kiss"]) > 0 and float(r["alone_ape_m"]) < 1.0
    before = (tmp_path / "odometries.csv").read_bytes()
    assert odometries.measure([own_sequence], [0], ["given"], tmp_path) == records
    assert (tmp_path / "odometries.csv").read_bytes() == before
    assert "| own | a TUM file | 1 |" in odometries.table(records)


def test_an_odometry_alone_is_the_one_that_is_asked_for() -> None:
    from data.scans import Scan

    scans = [Scan(i, stamp, points, 0, Path()) for i, (stamp, points) in enumerate(small_drive().scans[:15])]
    found = [
        odometry_of_run(scans, Config(odometry=OdometrySettings(method=method))).poses  # type: ignore[arg-type]
        for method in ("kiss", "small_gicp")
    ]
    assert not np.allclose(*found)
    assert np.array_equal(odometry_of_run(scans).poses, found[0])


def test_the_table_of_moving_scans_tells_each_arm() -> None:
    rows = [
        {"drive": "quick", "seed": str(seed), "arm": arm, "scans": "9", "anchored": str(error is not None),
         "rmse_bim_m": "" if error is None else str(error), "max_bim_m": "" if error is None else str(3 * error)}
        for seed in (0, 1) for arm, error in (("as they are", 0.04 if seed else None), ("deskewed", 0.006))
    ]  # fmt: skip
    text = moving_scans.table(rows)
    assert "| quick | moving, as they are | 1 of 2 | none, 0.0400 | 0.120 |" in text
    assert "| quick | moving, deskewed | 2 of 2 | 0.0060, 0.0060 | 0.018 |" in text
