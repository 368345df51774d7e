"""Cases, their drives and conditions, and what a run leaves: small real drives, measured by their truth."""

from pathlib import Path

import numpy as np
import pytest

from data.common.errors import UserError
from data.scans import Scan
from evaluation.buildings import building_named, plan_graph
from evaluation.conditions import CHANGES, RECORDING, SENSOR, Troubled, doubled, leaves_of, split
from evaluation.drive import Drive, DriveCase, DriveOptions, drive_of, release
from evaluation.outcome import Outcome
from evaluation.run import run
from evaluation.variants import variant_named

pytestmark = pytest.mark.slow
OF_SCANS = {k: v for k, v in (SENSOR | RECORDING).items() if k not in ("shaken", "kidnapped", "gaps")}
CASE = DriveCase(building="generated/apartment_3", seconds=12.0)


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("drives")


@pytest.fixture(scope="module")
def drive(work: Path) -> Drive:
    return drive_of(CASE, work)


@pytest.fixture(scope="module")
def clean(drive: Drive) -> list[Scan]:
    return list(drive.scans())


def test_cases_of_one_drive_share_it_and_it_is_deleted_after_them(work: Path, drive: Drive) -> None:
    same = CASE.model_copy(update={"variant": "KISS-ICP", "trouble": "noise 2", "times": False})
    assert same.group == CASE.group and drive_of(same, work).folder == drive.folder
    changes = {"seed": 1, "carrier": "handheld", "changes": "15 mm", "trouble": "shaken", "sensor": "XT32"}
    assert all(CASE.model_copy(update={name: value}).group != CASE.group for name, value in changes.items())
    other = CASE.model_copy(update={"seconds": 6.0})
    short = drive_of(other, work)
    assert short.count == 60 and short.folder.exists()
    release(other, work)
    assert not short.folder.exists() and drive.folder.exists()


def test_a_peers_row_does_not_depend_on_our_packages() -> None:
    assert CASE.model_copy(update={"variant": "KISS-ICP"}).depends == ("data",)
    assert "sgslam" in CASE.depends


@pytest.mark.parametrize(("name", "amounts"), OF_SCANS.items())
def test_a_trouble_is_the_same_at_each_reading_and_as_strong_as_it_says(
    name: str, amounts: tuple[float, ...], drive: Drive, clean: list[Scan]
) -> None:
    strength, leaves = [], leaves_of(plan_graph(drive.plan))
    for trouble in [f"{name} {severity}" for severity in range(1, len(amounts) + 1)] or [name]:
        troubled = Troubled(drive, trouble, leaves=leaves)
        first, again = ([scan.points for scan in troubled.scans()] for _ in range(2))
        assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
        strength.append(np.mean([_difference(a.points, b) for a, b in zip(clean, first, strict=True)]))
    assert strength[0] > 0 or name == "levelled"  # a robot is level
    assert all(np.diff(strength) > 0)


def _difference(points: np.ndarray, other: np.ndarray) -> float:
    """The share of points that are missing, or the mean distance by which they are moved."""
    if len(points) != len(other):
        return 1 - len(other) / len(points)
    return float(np.linalg.norm(points - other, axis=1).mean())


def test_gaps_and_kidnapping_take_scans_away(drive: Drive, clean: list[Scan], work: Path) -> None:
    assert len(list(Troubled(drive, "gaps 1").scans())) == len(clean) - 20  # one gap of 2 s
    long = drive_of(CASE.model_copy(update={"seconds": 36.0}), work)
    carried = Troubled(long, "kidnapped")
    stamps = [scan.stamp_ns for scan in carried.scans()]
    assert len(stamps) == 240 and np.ptp(np.diff(stamps)) == 0  # 12 s of 36 s; the stamps show no gap
    step = np.linalg.norm(np.diff(carried.truth.positions, axis=0), axis=1)
    assert step.max() > 5 * np.median(step[step > 0.01])  # but the truth does
    assert np.allclose(carried.truth.at([stamps[0]])[0], long.truth.poses[0])


def test_covered_scans_see_the_cap_for_five_seconds(drive: Drive) -> None:
    near = [np.linalg.norm(s.points, axis=1).max() < 0.3 for s in Troubled(drive, "covered").scans()]
    assert sum(near) == 50 and near.index(True) == 48  # from 40 % of 120 scans on


def test_mirrored_scans_and_scans_in_feet(drive: Drive, clean: list[Scan]) -> None:
    mirrored, feet = (next(Troubled(drive, name).scans()).points for name in ("mirrored", "feet"))
    assert np.allclose(mirrored * [1, -1, 1], clean[0].points) and np.allclose(feet * 0.3048, clean[0].points)


def test_a_doubled_plan_holds_every_room_twice_and_apart(drive: Drive) -> None:
    plan = plan_graph(drive.plan)
    both = doubled(plan)
    assert len(both.rooms) == 2 * len(plan.rooms) == len({room.id for room in both.rooms})
    assert len(both.wall_surfaces) == 2 * len(plan.wall_surfaces)
    x = np.array([corner[0] for room in both.rooms for corner in room.polygon or ()])
    half = len(x) // 2
    assert x[half:].min() > x[:half].max() and np.allclose(np.ptp(x[half:]), np.ptp(x[:half]))
    moved = both.wall_surfaces[len(plan.wall_surfaces)]
    assert moved.plane is not None and np.dot(moved.plane[:2], moved.centroid) + moved.plane[3] == pytest.approx(
        np.dot(plan.wall_surfaces[0].plane[:2], plan.wall_surfaces[0].centroid) + plan.wall_surfaces[0].plane[3]
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: split("rain"), "trouble 'rain'"),
        (lambda: split("noise 5"), "trouble 'noise 5'"),
        (lambda: split("noise"), "trouble 'noise'"),
        (lambda: variant_named("best"), "no variant 'best'"),
        (lambda: building_named("castle"), "no building 'castle'"),
        (lambda: list(DriveOptions(buildings=("castle",)).drives()), "no building 'castle'"),
    ],
)
def test_unknown_names_are_refused(call: object, message: str) -> None:
    with pytest.raises(UserError, match=message):
        call()  # type: ignore[operator]
    assert set(CHANGES) <= {*SENSOR, *RECORDING}


def test_designs_take_drives_in_turn() -> None:
    options = DriveOptions(buildings=("demo", "office", "institute"), seeds=(0, 1))
    cells = [{"sensor": name} for name in ("VLP-16", "OS0-32", "XT32")]
    found = [DriveCase(**design) for design in options.in_turn(cells, 2)]
    assert [case.sensor for case in found] == ["VLP-16"] * 2 + ["OS0-32"] * 2 + ["XT32"] * 2
    assert len({case.group for case in found}) == 6  # each of the six drives once


@pytest.fixture(scope="module")
def records(work: Path) -> dict[str, dict[str, object]]:
    case = DriveCase(building="generated/apartment_3", seconds=20.0)
    variants = ("anchored", "unanchored", "tracking", "KISS-ICP", "ICP to the BIM")
    return {name: run(case.model_copy(update={"variant": name}), work) for name in variants}


def test_all_measures_follow_from_what_a_run_leaves(records: dict[str, dict[str, object]], work: Path) -> None:
    anchored = records["anchored"]
    assert anchored["anchored"] and anchored["coverage"] == 1.0 and anchored["wrong"] == 0 and not anchored["silent"]
    assert 0 < anchored["rmse_m"] < 0.05  # type: ignore[operator]
    assert anchored["plan_view_m"] ** 2 + anchored["height_m"] ** 2 == pytest.approx(anchored["rmse_m"] ** 2)  # type: ignore[operator]
    assert anchored["role"] == "development" and anchored["scans"] == 200
    placed = anchored["placed"]
    assert (placed["scans"], placed["wrong"]) == (200, 0) and placed["signals"]["planned_walls_crossed"] == 0  # type: ignore[index]
    assert not records["tracking"]["anchored"] and records["tracking"]["reliability"]["good"] > 0.5  # type: ignore[index]
    assert records["KISS-ICP"]["rmse_m"] < 0.5 and records["ICP to the BIM"]["rmse_m"] < 0.2  # type: ignore[operator]
    files = sorted((work / "runs").glob("*.npz"))
    kept = [outcome for outcome in map(Outcome.load, files) if len(outcome.anchored)]
    assert len(files) == 5 and anchored["rmse_m"] in [outcome.measures()["rmse_m"] for outcome in kept]


def test_a_run_of_this_build_is_not_made_again(records: dict[str, dict[str, object]], work: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in (work / "runs").glob("*.npz")}
    again = run(DriveCase(building="generated/apartment_3", seconds=20.0), work)
    assert again == records["anchored"]
    assert before == {path: path.stat().st_mtime_ns for path in (work / "runs").glob("*.npz")}


def test_poses_that_are_wrong_are_counted_and_an_alarm_makes_them_not_silent(drive: Drive) -> None:
    stamps = drive.truth.stamps_ns[:100]
    poses = drive.truth.poses[:100].copy()
    poses[:7, 0, 3] += 0.6  # m; a wrong place begins at 0.5
    poses[7:9, 0, 3] += 0.4
    found = drive.truth.only(np.arange(len(drive.truth)) < 100)
    outcome = Outcome(120, drive.truth, type(found)(stamps, poses))
    assert outcome.measures()["wrong"] == 7 and outcome.measures()["silent"]
    assert outcome.measures()["coverage"] == pytest.approx(100 / 120)
    assert not Outcome(120, drive.truth, type(found)(stamps, poses), facts={"alarms": ["walls"]}).measures()["silent"]
    assert Outcome(120, drive.truth, found, no_place=True).measures()["wrong"] == 100  # wherever it is anchored
