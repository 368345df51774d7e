"""Runs in which something goes wrong: what the system gets, what counts as wrong, and the tables."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_ifc import write_small_ifc
from study_rows import rows_of

from data import UserError
from data.scans import Scan
from data.scans.writers import SCAN_WRITERS
from data.trajectory import Trajectory
from evaluation.drives import SequenceSpec
from evaluation.drives.carried import CarriedDrive
from evaluation.drives.sequences import plan_of
from evaluation.drives.troubles import BEGINS, CARRIED_S, COVERED_S, TROUBLES, Trouble, TroubledDrive, twin_plan
from evaluation.metrics.regions import Inside
from evaluation.metrics.trajectories import wrong_poses
from evaluation.studies.carried.trust import Choice, Outcome, Runs, Troubled, cases, claims, measure, tables

SECONDS = 40.0


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> CarriedDrive:
    """A scan a second of two points, taken on a straight way at a metre a second."""
    folder = tmp_path_factory.mktemp("scans")
    stamps, poses = np.arange(int(SECONDS), dtype=np.int64) * 1_000_000_000, np.tile(np.eye(4), (int(SECONDS), 1, 1))
    poses[:, 0, 3] = np.arange(SECONDS)
    for stamp in stamps.tolist():
        SCAN_WRITERS["ply"](folder / f"{stamp:020d}.ply", np.array([[3.0, 1.0, 0.5], [0.0, 4.0, 0.0]]), None)
    return CarriedDrive(folder, Trajectory(stamps, poses), int(SECONDS), length=0.0, times=False)


def told(drive: CarriedDrive, trouble: Trouble) -> tuple[list[Scan], Trajectory]:
    troubled = TroubledDrive(drive, trouble, SECONDS)
    return list(troubled.scans()), troubled.truth


def test_mirrored_scans_and_feet(drive: CarriedDrive) -> None:
    (plain, truth), (mirrored, _), (feet, _) = (told(drive, trouble) for trouble in ("none", "mirrored", "feet"))
    assert truth.stamps_ns.tolist() == [scan.stamp_ns for scan in plain]
    np.testing.assert_allclose(mirrored[0].points, [[3.0, -1.0, 0.5], [0.0, -4.0, 0.0]])
    np.testing.assert_allclose(feet[0].points, plain[0].points / 0.3048)


def test_levelled_scans_lie_where_an_upright_sensor_sees_them(tmp_path: Path) -> None:
    turns = np.tile(np.eye(4), (2, 1, 1))
    turns[:, :3, :3] = Rotation.from_euler("zyx", [[40.0, 10.0, -5.0], [50.0, -10.0, 15.0]], degrees=True).as_matrix()
    turns[1, :3, 3] = [0.3, 0.0, 0.1]
    motion, times = Trajectory(np.array([0, 100_000_000]), turns), np.array([0.0, 0.05, 0.1])
    seen, at = np.array([[2.0, 1.0, -0.5], [0.0, 3.0, 1.0], [-4.0, 0.0, 0.2]]), np.round(1e9 * times).astype(np.int64)
    SCAN_WRITERS["ply"](tmp_path / f"{0:020d}.ply", seen, times)
    (scan,) = TroubledDrive(CarriedDrive(tmp_path, motion, 1, 0.0, times=True), "levelled", SECONDS).scans()
    true = motion.at(at)
    world = np.einsum("nij,nj->ni", true[:, :3, :3], seen)
    headings = Rotation.from_euler("z", np.arctan2(true[:, 1, 0], true[:, 0, 0])[:, None]).as_matrix()
    np.testing.assert_allclose(np.einsum("nij,nj->ni", headings, scan.points), world, atol=1e-4)


def test_a_twin_plan_has_everything_twice_and_apart(tmp_path: Path) -> None:
    plan = plan_of(SequenceSpec(name="flat", bim="generated/apartment_3"), tmp_path)
    both, count = twin_plan(plan), len(plan.wall_surfaces)
    assert both.wall_surfaces[:count] == plan.wall_surfaces and len(both.wall_surfaces) == 2 * count
    assert len(both.rooms) == 2 * len(plan.rooms) and len(both.doors) == 2 * len(plan.doors)
    for own, twin in zip(plan.wall_surfaces, both.wall_surfaces[count:], strict=True):
        assert own.plane is not None and twin.plane is not None
        assert np.dot(twin.plane[:2], twin.centroid) + twin.plane[3] == pytest.approx(
            np.dot(own.plane[:2], own.centroid) + own.plane[3]
        )
    first, second = ([wall.centroid[0] for wall in half] for half in (plan.wall_surfaces, both.wall_surfaces[count:]))
    assert min(second) - max(first) > 4.0


def test_a_cover_hides_everything_for_a_while(drive: CarriedDrive) -> None:
    scans, truth = told(drive, "covered")
    near = [scan.stamp_ns / 1e9 for scan in scans if np.linalg.norm(scan.points, axis=1).max() < 0.3]
    assert near == list(np.arange(BEGINS * SECONDS, BEGINS * SECONDS + COVERED_S))
    assert len(scans) == len(truth) == SECONDS


def test_who_is_carried_elsewhere_sees_no_gap_in_time(drive: CarriedDrive) -> None:
    scans, truth = told(drive, "kidnapped")
    assert [scan.stamp_ns for scan in scans] == truth.stamps_ns.tolist()
    assert set(np.diff(truth.stamps_ns)) == {1_000_000_000}
    jumps = np.diff(truth.positions[:, 0])
    assert jumps.max() == 1.0 + CARRIED_S and (jumps == 1.0).sum() == len(jumps) - 1


@pytest.mark.parametrize(("metres", "degrees", "wrong"), [(0.49, 0.0, 0), (0.51, 0.0, 1), (0.0, 4.9, 0), (0.0, 5.1, 1)])
def test_what_is_wrong(drive: CarriedDrive, metres: float, degrees: float, wrong: int) -> None:
    poses, a = drive.truth.poses.copy(), np.radians(degrees)
    poses[7, 2, 3] += metres
    poses[7, :3, :3] = [[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]
    assert wrong_poses(Trajectory(drive.truth.stamps_ns, poses), drive.truth) == wrong


def test_every_trouble_meets_every_drive_and_foreign_plans_are_foreign() -> None:
    drives = cases(Choice(sequences=("demo", "house-1"), seeds=(0,), carriers=("wheeled",), sensors=("VLP-16",)))
    assert len({drive.key for drive in drives}) == len(drives) == 2 * 2
    assert all(drive.foreign.bim != drive.sequence.bim for drive in drives)
    troubles = {drive.sequence.name: set(drive.troubles) for drive in drives}
    assert troubles == {"demo": set(TROUBLES), "house-1": set(TROUBLES) - {"wrong storey"}}  # it has one storey
    (alone,) = cases(Choice(sequences=("demo",), seeds=(0,), carriers=("pole",), sensors=("VLP-16",), effects=((),)))
    assert set(alone.troubles) == set(TROUBLES) - {"foreign"}


def small(path: Path, *troubles: Trouble, carrier: str = "handheld") -> Troubled:
    building = SequenceSpec(name="small", bim=str(path), storey="Ground")
    return Troubled(
        sequence=building, foreign=building, seed=1, carrier=carrier, sensor="VLP-16", seconds=12.0, troubles=troubles
    )


@pytest.mark.long
def test_a_run_under_a_cover_calls_it_lost_and_a_shaken_one_is_another_drive(tmp_path: Path) -> None:
    path = write_small_ifc(tmp_path / "small.ifc").path
    (tmp_path / "work").mkdir()
    found = measure(small(path, "covered", "shaken"), tmp_path / "work").found
    own = found["covered"]
    assert own.scans == 120 and 50 <= own.lost <= 60 and own.anchored + own.lost <= own.scans
    assert "lost_scans" in own.alarms and own.wrong == 0
    assert found["shaken"].scans == 120 and found["shaken"].lost < 50


def test_a_wrong_storey_needs_two(tmp_path: Path) -> None:
    (tmp_path / "work").mkdir()
    flat = SequenceSpec(name="flat", bim="generated/apartment_3")
    case = small(tmp_path / "none.ifc", "wrong storey").model_copy(update={"sequence": flat})
    with pytest.raises(UserError, match="building with one"):
        measure(case, tmp_path / "work")


def test_the_tables_count_wrong_runs(tmp_path: Path) -> None:
    told = Outcome(
        scans=100, anchored=100, lost=0, wrong=0, wrong_live=0, worst_m=0.05, rmse_m=0.01, first_anchor_s=5.0,
        kidnaps=0, inside=Inside(poses=100, plan_view=0.9, height=1.0, yaw=0.8), alarms=(), reason="",
    )  # fmt: skip
    path, nowhere = tmp_path / "a.ifc", told.model_copy(update={"anchored": 0, "inside": None})
    mirrored = told.model_copy(update={"wrong": 100, "wrong_live": 3, "inside": None})
    covered = told.model_copy(update={"anchored": 40, "lost": 60, "alarms": ("lost_scans",)})
    rows = rows_of([
        (small(path, *TROUBLES), Runs(found={"none": nowhere, "levelled": told, "mirrored": mirrored})),
        (small(path, *TROUBLES, carrier="pole"), Runs(found={"none": told, "levelled": nowhere, "covered": covered})),
    ])  # fmt: skip
    found = tables(rows)
    line = found["troubles"].set_index("trouble")
    assert line["drives wrong"].to_dict() == {"none": "0/2", "levelled": "0/2", "mirrored": "1/1", "covered": "0/1"}
    assert line.loc["covered", "scans anchored"] == "40.0%" and line.loc["covered", "scans lost"] == "60.0%"
    assert line.loc["mirrored", "wrong and no alarm"] == "1/1"
    assert found["levelled"].to_dict("records") == [
        {"carrier": "handheld", "anchored with the true attitude": "1", "and without": "0/1"}
    ]
    assert found["inside"].set_index("trouble").loc["covered", "yaw"] == "80.0%"
    wrong, without_alarm = claims(rows)
    assert wrong.value.startswith("1 of 4") and without_alarm.value == "1/1"
