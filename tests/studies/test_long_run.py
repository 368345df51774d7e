"""Long runs are measured: the drive comes in parts, and its numbers add up."""

from pathlib import Path

import numpy as np
import pytest
from small_ifc import write_small_ifc
from study_rows import rows_of

from data.common.errors import UserError
from data.scans import ScanFolder
from evaluation.drives import endless_drive as drives
from evaluation.drives.endless_drive import DriveSpec, endless_drive
from evaluation.studies.long_run import Choice, cases, measure, plots, tables

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def bim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_ifc(tmp_path_factory.mktemp("long") / "small.ifc").path


def test_a_drive_comes_in_parts_that_are_gone_when_they_were_read(bim: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drives, "PART", 8)
    stamps, sizes, before = list[int](), list[int](), None
    with endless_drive(DriveSpec(bim, "Ground", 20)) as (truth, parts):
        for part in parts:
            assert before is None or not before.exists()
            before = part
            scans = list(ScanFolder(part))
            stamps += [scan.stamp_ns for scan in scans]
            sizes.append(len(scans))
            assert min(len(scan.points) for scan in scans) > 13_000
        assert stamps == truth.stamps_ns.tolist()
    assert sizes == [8, 8, 4] and before is not None and not before.parent.exists()


def test_a_standing_robots_scans_differ_by_their_noise_alone(bim: Path) -> None:
    with endless_drive(DriveSpec(bim, "Ground", 3, standing=True)) as (truth, parts):
        assert np.ptp(truth.positions, axis=0).max() == 0
        (part,) = ([scan.points for scan in ScanFolder(folder)] for folder in parts)
    first, second = part[0], part[1]
    assert first.shape == second.shape and not np.array_equal(first, second)
    away = np.linalg.norm(first - second, axis=1)
    assert away.max() < 0.2 and np.sqrt(np.mean(away**2)) == pytest.approx(0.02 * np.sqrt(2), rel=0.1)


def test_a_storey_that_is_not_there_is_told(bim: Path) -> None:
    with pytest.raises(UserError, match="Attic"), endless_drive(DriveSpec(bim, "Attic", 3)):
        pass


@pytest.mark.long
def test_the_parts_of_a_run_add_up(bim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drives, "PART", 30)
    (case,) = cases(Choice(bim=str(bim), storey="Ground", scans=60, standing=True))
    whole = measure(case, tmp_path)
    assert not list(tmp_path.iterdir())
    assert whole.seconds is not None and whole.peak_memory_mb is not None
    first, last = whole.samples
    assert (first.scans, last.scans) == (30, 60) and 0 < last.memory_mb <= whole.peak_memory_mb
    assert whole.seconds == pytest.approx(last.seconds + (whole.finish_seconds or 0) + (whole.writing_seconds or 0))
    rows = rows_of([(case, whole)])
    made = tables(rows)
    assert made["runs"]["scans a second"].tolist() == [f"{60 / whole.seconds:.0f}"]
    assert made["tenths"].scans.tolist() == ["30", "60"]
    speed = 30 / (last.seconds - first.seconds)
    assert made["tenths"]["scans a second"].tolist() == [f"{30 / first.seconds:.0f}", f"{speed:.0f}"]
    plots(rows, tmp_path)
    assert (tmp_path / "long_run.svg").read_text().startswith("<?xml")


def test_a_storey_must_be_named() -> None:
    with pytest.raises(UserError, match="name the storey"):
        cases(Choice(storey=None))
