"""Live use is measured at the sensor's pace: a drive is played, and its numbers add up."""

from pathlib import Path
from time import sleep

import numpy as np
import pytest
from small_ifc import write_small_ifc
from study_rows import rows_of

from data.trajectory import Trajectory
from evaluation.drives import SequenceSpec
from evaluation.drives.carried import CarriedDrive
from evaluation.studies import live as study
from evaluation.studies.live import Choice, LiveCase, cases, measure, tables


def test_each_drive_of_the_design_is_there_once() -> None:
    found = cases(Choice(seeds=(0, 1)))
    assert len({case.key for case in found}) == len(found) == 2 * 2 * 2 * 2


@pytest.mark.long
@pytest.mark.slow
def test_a_drive_is_played_at_its_pace_and_ends_as_a_run(tmp_path: Path) -> None:
    building = SequenceSpec(name="small", bim=str(write_small_ifc(tmp_path / "small.ifc").path), storey="Ground")
    work = tmp_path / "work"
    work.mkdir()
    case = LiveCase(sequence=building, seed=1, carrier="wheeled", sensor="VLP-16", seconds=8.0, offline=True)
    found = measure(case, work)
    assert found.scans == 80 and found.dropped == 0 and found.points > 10_000
    assert found.offline_m is not None and found.offline_m < 1e-9
    assert found.p50_ms is not None and found.p99_ms is not None and found.longest_ms is not None
    assert 0 < found.p50_ms <= found.p99_ms <= found.longest_ms
    assert [sample.seconds for sample in found.memory] == [0.0]
    assert found.memory[0].tracking > 50 and found.memory[0].mapping > 50
    made = tables(rows_of([(case, found)]))
    assert made["answers"].iloc[0]["dropped"] == 0 and "1/1 of the drive (MB)" in made["memory"]
    assert not list(work.iterdir())


class _Slow:
    """A tracker that takes twice as long for a scan as the sensor."""

    def add_scan(self, stamp_ns: int, points: np.ndarray, point_times: np.ndarray | None) -> str:
        sleep(0.02)
        return "answer"


def test_an_answer_is_late_by_those_before_it_too(tmp_path: Path) -> None:
    """The time counts from when a scan was due, not from when the tracker took it."""
    stamps = np.arange(20, dtype=np.int64) * 10_000_000
    np.savetxt(tmp_path / "times.txt", stamps / 1e9)
    for number in range(20):
        np.save(tmp_path / f"{number:03d}.npy", np.ones((30, 3)))
    drive = CarriedDrive(tmp_path, Trajectory(stamps, np.tile(np.eye(4), (20, 1, 1))), 20, 1.0, times=False)
    _, late_s, points, _ = study._play(_Slow(), drive)  # type: ignore[arg-type]
    assert points == 30 and late_s[-1] > 20 * 0.02 - 19 * 0.01 - 0.01
