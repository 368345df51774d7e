"""Scans made worse: each perturbation and how it grows with its severity, a measured drive, tables and figure."""

from pathlib import Path

import numpy as np
import pytest
from small_ifc import write_small_ifc
from study_rows import rows_of

from data.scans import Scan
from data.scans.writers import SCAN_WRITERS
from data.trajectory import Trajectory
from evaluation.drives import SequenceSpec
from evaluation.drives.carried import CarriedDrive
from evaluation.drives.perturbations import PERTURBATIONS, SEVERITIES, Perturbation, Perturbed
from evaluation.studies.carried.degradation import Choice, Degraded, Measured, cases, measure, plots, tables

SECONDS, RADIUS_M = 40, 5.0
STANDING = ("dropout", "field of view", "noise", "occlusion", "sparsity", "people", "vibration")


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> CarriedDrive:
    """A scan a second, of points in 20,000 directions at five metres, taken within its first tenth of a second."""
    folder = tmp_path_factory.mktemp("scans")
    rays = np.random.default_rng(0).normal(size=(20_000, 3))
    points = RADIUS_M * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    stamps = np.arange(SECONDS, dtype=np.int64) * 1_000_000_000
    for stamp in stamps.tolist():
        SCAN_WRITERS["ply"](folder / f"{stamp:020d}.ply", points, np.linspace(0.0, 0.1, len(points)))
    return CarriedDrive(folder, Trajectory(stamps, np.tile(np.eye(4), (SECONDS, 1, 1))), SECONDS, 0.0, times=True)


def perturbed(drive: CarriedDrive, perturbation: Perturbation, severity: int, count: int = 1) -> list[Scan]:
    return list(Perturbed(drive, perturbation, severity).scans(count))


def ranges(scan: Scan) -> np.ndarray:
    return np.asarray(np.linalg.norm(scan.points, axis=1))


@pytest.mark.parametrize("perturbation", STANDING)
def test_each_reading_gives_the_same_scan_and_severity_0_the_one_that_came(
    drive: CarriedDrive, perturbation: Perturbation
) -> None:
    (plain,) = drive.scans(1)
    (same,), (first,), (again,) = (perturbed(drive, perturbation, severity) for severity in (0, 3, 3))
    np.testing.assert_array_equal(same.points, plain.points)
    np.testing.assert_array_equal(first.points, again.points)
    assert not np.array_equal(first.points, plain.points)
    assert first.point_times is not None and len(first.point_times) == len(first.points)


@pytest.mark.parametrize("severity", [1, 2, 3, 4])
def test_dropout_and_sparsity_leave_their_share(drive: CarriedDrive, severity: int) -> None:
    (dropped,), (sparse,) = perturbed(drive, "dropout", severity), perturbed(drive, "sparsity", severity)
    assert len(dropped.points) / 20_000 == pytest.approx(1 - SEVERITIES["dropout"][severity - 1], abs=0.02)
    assert len(sparse.points) / 20_000 == pytest.approx(SEVERITIES["sparsity"][severity - 1], abs=0.03)
    beams = np.unique(np.round(np.degrees(np.arcsin(sparse.points[:, 2] / RADIUS_M)) / 2))
    assert len(beams) / 91 == pytest.approx(SEVERITIES["sparsity"][severity - 1], abs=0.03)


@pytest.mark.parametrize("severity", [1, 2, 3, 4])
def test_a_narrow_field_of_view_looks_ahead(drive: CarriedDrive, severity: int) -> None:
    (scan,) = perturbed(drive, "field of view", severity)
    half = SEVERITIES["field of view"][severity - 1] / 2
    seen = np.degrees(np.abs(np.arctan2(scan.points[:, 1], scan.points[:, 0])))
    assert half - 2 < seen.max() <= half


@pytest.mark.parametrize("severity", [1, 2, 3, 4])
def test_noise_is_along_the_rays(drive: CarriedDrive, severity: int) -> None:
    (plain,), (noisy,) = drive.scans(1), perturbed(drive, "noise", severity)
    assert np.std(ranges(noisy)) == pytest.approx(SEVERITIES["noise"][severity - 1], rel=0.03)
    np.testing.assert_allclose(np.cross(plain.points, noisy.points), 0.0, atol=1e-9)


@pytest.mark.parametrize("severity", [1, 2, 3, 4])
def test_what_stands_near_the_sensor_hides_its_share_of_the_directions(drive: CarriedDrive, severity: int) -> None:
    scans = perturbed(drive, "occlusion", severity, 3)
    hidden = [ranges(scan) < 1.0 for scan in scans]
    share = round(12 * SEVERITIES["occlusion"][severity - 1]) / 12
    assert np.mean(hidden) == pytest.approx(share, abs=0.02)
    assert np.array_equal(hidden[0], hidden[1]) and not np.array_equal(hidden[0], hidden[2])  # moves after 2 s


def test_people_walk_before_the_walls_and_more_of_them_hide_more(drive: CarriedDrive) -> None:
    hidden = []
    for severity in (1, 2, 3, 4):
        scans = perturbed(drive, "people", severity, 2)
        shown = np.array([ranges(scan) for scan in scans])
        assert shown.max() <= RADIUS_M + 1e-6 and shown.min() > 0.5
        heights = np.concatenate([scan.points[ranges(scan) < RADIUS_M - 1e-6, 2] for scan in scans])
        assert heights.min() > -1.4 - 1e-6 and heights.max() < 0.4 + 1e-6
        assert not np.array_equal(*(shown < RADIUS_M - 1e-6))
        hidden.append(np.mean(shown < RADIUS_M - 1e-6))
    assert 0 < hidden[0] < hidden[1] < hidden[2] < hidden[3]


@pytest.mark.parametrize("severity", [1, 2, 3, 4])
def test_vibration_turns_the_rays_by_its_amplitude(drive: CarriedDrive, severity: int) -> None:
    (plain,), (turned,) = drive.scans(1), perturbed(drive, "vibration", severity)
    np.testing.assert_allclose(ranges(turned), RADIUS_M, rtol=2e-3)
    off = np.degrees(np.linalg.norm(turned.points - plain.points, axis=1).max() / RADIUS_M)
    assert 0.9 < off / SEVERITIES["vibration"][severity - 1] < 1.5  # about both axes together


@pytest.mark.parametrize("severity", [1, 2, 3, 4])
def test_gaps_are_of_two_seconds(drive: CarriedDrive, severity: int) -> None:
    stamps = [scan.stamp_ns // 1_000_000_000 for scan in Perturbed(drive, "gaps", severity).scans()]
    missing = sorted(set(range(SECONDS)) - set(stamps))
    assert 5 in missing and 0 in stamps
    assert len(missing) == pytest.approx(2 * SEVERITIES["gaps"][severity - 1], abs=1)


def test_each_cell_of_the_matrix_is_there_once() -> None:
    found = cases(Choice(sequences=("demo", "house-1"), sensors=("VLP-16", "Mid-360")))
    assert len({case.key for case in found}) == len(found) == 2 * 2 * (9 * 4 + 1)
    assert {case.times for case in found if case.perturbation == "motion distortion"} == {False}
    paces = {case.pace for case in found if case.perturbation == "motion distortion"}
    assert paces == set(SEVERITIES["motion distortion"])


@pytest.mark.long
def test_a_drive_is_measured_and_lands_in_tables_and_figure(tmp_path: Path) -> None:
    building = SequenceSpec(name="small", bim=str(write_small_ifc(tmp_path / "small.ifc").path), storey="Ground")
    (tmp_path / "work").mkdir()
    common = {"sequence": building, "seed": 1, "carrier": "handheld", "sensor": "VLP-16", "seconds": 6.0}
    measured = []
    for perturbation, severity in (("dropout", 0), ("gaps", 1)):
        case = Degraded.model_validate({**common, "perturbation": perturbation, "severity": severity})
        measured.append((case, measure(case, tmp_path / "work")))
    clean, gap = (record for _, record in measured)
    assert (clean.scans, gap.scans) == (60, 50)
    ours = clean.found["sgslam"]
    assert ours is not None and ours.ate_m is not None and ours.ate_m < 0.05 and ours.missing == 0
    lost = gap.model_copy(update={"found": {**gap.found, "kiss_icp": None}})
    rows = rows_of([measured[0], (measured[1][0], lost)])
    matrix = tables(rows)["matrix"].set_index("perturbation")
    assert list(matrix.index) == ["none", "gaps"] and matrix.loc["gaps", "amount"] == "1 gaps of 2 s"
    assert matrix.loc["none", "VLP-16: ATE (m)"].startswith(f"{ours.ate_m:.3f} (")
    assert "(lost, " in matrix.loc["gaps", "VLP-16: ATE (m)"]
    assert tables(rows)["methods"].iloc[0]["tracked by KISS-ICP"] == "0/1"
    plots(rows, tmp_path)
    assert (tmp_path / "degradation.svg").stat().st_size > 1000


def test_a_wrong_scan_is_counted() -> None:
    building = SequenceSpec(name="demo", bim="demo")
    case = Degraded(
        sequence=building, seed=0, carrier="handheld", sensor="VLP-16", seconds=20.0, perturbation="noise", severity=4
    )
    record = Measured(scans=200, found={}, anchored=200, rmse_m=0.7, wrong=120, reason="")
    line = tables(rows_of([(case, record)]))["methods"].iloc[0]
    assert (line["drives wrong"], line["scans wrong"], line["to 0.1 m"]) == ("1/1", "120/200", "0/1")
    assert set(PERTURBATIONS) == set(SEVERITIES)
