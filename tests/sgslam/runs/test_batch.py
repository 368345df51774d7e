"""`sgslam batch`: each line of a list is one run, whoever computes it and whatever interrupts it."""

import csv
from pathlib import Path

import numpy as np
import pytest
from boxes import pose, room, scan, scene_of
from commands import called

from data.common.errors import UserError
from sgslam.cli.batch import RECORD, read_jobs
from sgslam.cli.options import RunOptions


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scans,plan\n", "has no jobs"),
        ("scans,building\na,b\n", "unknown column 'building'"),
        ("scans,plan\n,b.ifc\n", "line 2: scans are missing"),
        ("\ufeffscans,plan\na,b,c\n", "line 2: more values than columns; put flags that have commas in quotes"),
        ("scans,flags\na,--start '1\n", "line 2: flags: No closing quotation"),
        ("scans,flags\na,--fast\n", "line 2: flags: .*--fast"),
        ("scans\ndrive/scans\nother/scans\n", "line 3: .*scans is the folder of an earlier job too"),
    ],
)
def test_a_wrong_list_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "jobs.csv").write_text(text)
    with pytest.raises(UserError, match=message):
        read_jobs(tmp_path / "jobs.csv")


def test_paths_are_relative_to_the_list(tmp_path: Path) -> None:
    (tmp_path / "jobs.csv").write_text(
        "scans, plan, out, flags\na/scans, b.ifc, c, --set 'odometry.method=kiss'\nd,,,\n"
    )
    first, second = read_jobs(tmp_path / "jobs.csv")
    given = RunOptions(scan_dir=Path("a/scans"), bim=Path("b.ifc"), out=tmp_path / "c", set=("odometry.method=kiss",))
    assert first.options == given
    assert second.options == RunOptions(scan_dir=Path("d"), out=tmp_path / "jobs_runs/d")
    assert first.folder == tmp_path


def _written(folder: Path, jobs: int) -> Path:
    """A list of jobs, of which the last one has no scans."""
    (folder / "scans").mkdir(parents=True)
    scene = scene_of(room(0.0, 0.0, 8.0, 6.0))
    for k in range(12):
        np.save(folder / "scans" / f"{k}.npy", scan(scene, pose(2.0 + 0.1 * k, 3.0), seed=k))
    lines = [f"scans,,run{k},--single-pass" for k in range(jobs - 1)]
    path = folder / "jobs.csv"
    path.write_text("\n".join(["\ufeffscans,plan,out,flags", *lines, "nowhere,,bad,--single-pass"]) + "\n")
    return path


def _rows(path: Path) -> list[tuple[str, str, str]]:
    with path.with_name("jobs_results.csv").open() as file:
        return [(Path(row["out"]).name, row["status"], row["scans"]) for row in csv.DictReader(file)]


@pytest.mark.slow
def test_a_job_that_fails_is_named_and_done_ones_are_kept(tmp_path: Path) -> None:
    path = _written(tmp_path, 3)
    first = called("sgslam.cli.batch", path, "--jobs", "2")
    assert first.returncode == 1 and f"failed: {tmp_path / 'bad'}" in first.stdout
    assert _rows(path) == [("run0", "map only", "12"), ("run1", "map only", "12"), ("bad", "failed", "")]
    assert "nowhere: does not exist" in path.with_name("jobs_results.html").read_text()
    poses = (tmp_path / "run0/trajectory_map.tum").read_bytes()
    assert poses == (tmp_path / "run1/trajectory_map.tum").read_bytes()
    written = (tmp_path / "run0" / RECORD).stat().st_mtime_ns
    path.write_text(path.read_text().replace("nowhere", "scans"))
    again = called("sgslam.cli.batch", path)
    assert again.returncode == 0 and "3 jobs, 1 to run" in again.stdout
    assert (tmp_path / "run0" / RECORD).stat().st_mtime_ns == written
    assert (tmp_path / "bad/trajectory_map.tum").read_bytes() == poses
