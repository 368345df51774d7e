"""Long runs are measured: the drive comes in parts, and what is told of it adds up."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small_ifc import write_small_ifc

from data.common.errors import UserError
from data.scans import ScanFolder
from evaluation.harness import endless_drive
from evaluation.drives.endless_drive import DriveSpec, EndlessDrive

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def bim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_ifc(tmp_path_factory.mktemp("long") / "small.ifc").path


def test_a_drive_comes_in_parts_that_are_gone_when_they_were_read(bim: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endless_drive, "_PART", 8)
    stamps, sizes, before = list[int](), list[int](), None
    with EndlessDrive(DriveSpec(bim, "Ground", 20)) as drive:
        for part in drive.parts():
            assert before is None or not before.exists()
            before = part
            scans = list(ScanFolder(part))
            stamps += [scan.stamp_ns for scan in scans]
            sizes.append(len(scans))
            assert min(len(scan.points) for scan in scans) > 13_000
        assert stamps == drive.truth.stamps_ns.tolist()
    assert sizes == [8, 8, 4] and before is not None and not before.parent.exists()


def test_a_standing_robots_scans_differ_by_their_noise_alone(bim: Path) -> None:
    with EndlessDrive(DriveSpec(bim, "Ground", 3, standing=True)) as drive:
        assert np.ptp(drive.truth.positions, axis=0).max() == 0
        (part,) = ([scan.points for scan in ScanFolder(folder)] for folder in drive.parts())
    first, second = part[0], part[1]
    assert first.shape == second.shape and not np.array_equal(first, second)
    away = np.linalg.norm(first - second, axis=1)
    assert away.max() < 0.2 and np.sqrt(np.mean(away**2)) == pytest.approx(0.02 * np.sqrt(2), rel=0.1)


def test_a_storey_that_is_not_there_is_told(bim: Path) -> None:
    with pytest.raises(UserError, match="Attic"):
        EndlessDrive(DriveSpec(bim, "Attic", 3))


def test_the_command_measures_and_writes_its_section(bim: Path, tmp_path: Path) -> None:
    words = ["--out", "out", "--bim", str(bim), "--storey", "Ground", "--scans", "60", "--standing"]
    command = [sys.executable, "-m", "evaluation.studies.long_run", *words, "--benchmarks", "page.md"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "out/samples.json").read_text())
    samples, whole = told["samples"], told["whole"]
    assert [s["scans"] for s in samples] == [60] and whole["scans"] == 60
    assert 0 < samples[-1]["memory"] <= whole["peak_memory_mb"]
    parts = samples[-1]["seconds"] + whole["finish_seconds"] + whole["writing_seconds"]
    assert whole["seconds"] == pytest.approx(parts) and whole["scans_per_second"] == pytest.approx(60 / parts)
    page = (tmp_path / "page.md").read_text()
    assert page.count("<!-- standing -->") == 1 and "| 60 | " in page and "cores, 20" in page
    assert (tmp_path / "docs/standing.svg").read_text().startswith("<?xml")
    assert (tmp_path / "out/run/report.html").exists()
