"""What the ablation makes harder, and what it compares with: weak odometry, wrong matches, ICP to the BIM."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boxes import pose
from small_ifc import STOREY, SmallBuilding, write_small_ifc
from study_rows import rows_of

from data import Room, SceneGraph, WallSurface
from data.common.errors import UserError
from data.plans import load_bim
from data.scans import Scan, ScanFolder
from data.simulation import SimulatedRun
from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from evaluation.drives import Conditions, SequenceSpec
from evaluation.drives.conditions import NORMAL
from evaluation.drives.stand_in_matchers import OracleMatcher, WrongMatches
from evaluation.drives.weakened import LEAST_ERROR_M, RANGE_M, shortened, weaken_odometry
from evaluation.metrics.trajectories import ape, error_in_bim, origin_alignment
from evaluation.slam_ablation.icp_to_bim import ALIGNERS, register_to_bim, surfaces_of_graph, surfaces_of_ifc
from evaluation.slam_ablation.scores import Scores, _of_trajectory
from evaluation.slam_ablation.study import Run
from evaluation.slam_ablation.variants import shortened_scan
from evaluation.studies import wrong_matches
from evaluation.studies.relocalisation import _error
from matching import MatchResult

needs_open3d = pytest.mark.skipif(find_spec("open3d") is None, reason="needs the extra open3d")


def scores(**values: Any) -> Scores:
    """A record with these values."""
    plain = {"anchored": True, "driven_m": 9.0, "seconds": 1.0, "seconds_reading": 1.5, "peak_memory_mb": 200.4}
    return Scores(**{**plain, "poses": 600, **values})


def test_corrupted_runs_stand_beside_clean_ones() -> None:
    found = [("a", 0, 0.010, 20.0, 0.009, 20.0), ("a", 1, 0.020, 30.0, 0.024, 50.0), ("b", 0, 0.010, 20.0, None, None)]
    rows = rows_of(
        (
            Run(sequence=SequenceSpec(name=name, bim="demo"), seed=seed, conditions=conditions, variant="anchored"),
            scores(rmse_m=error, first_anchor_s=first, matched_poses=0 if error is None else 540),
        )
        for name, seed, *values in found
        for conditions, error, first in zip(
            (NORMAL, Conditions(wrong_matches=5)), values[::2], values[1::2], strict=True
        )
    )
    assert wrong_matches.tables(rows)["drives"].to_numpy().tolist() == [
        ["a", "5", "0", "0.0100", "0.0090", "540/600", "540/600", "0.90", "20", "20"],
        ["a", "5", "1", "0.0200", "0.0240", "540/600", "540/600", "1.20", "30", "50"],
        ["**a**", "5", "all", "0.0150", "0.0165", "1080/1200", "1080/1200", "1.10", "25", "35"],
        ["b", "5", "0", "0.0100", "not anchored", "540/600", "0/600", "", "20", ""],
    ]


def around_a_block(metres: float) -> Trajectory:
    """A drive of so many metres around a square of 10 x 10 m, 5 cm a scan."""
    along = np.arange(0.0, metres, 0.05)
    side, rest = np.divmod(along, 10.0)
    corners = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    headings = side % 4 * np.pi / 2
    poses = np.tile(np.eye(4), (len(along), 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(headings)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(headings), -np.sin(headings)
    poses[:, :2, 3] = corners[side.astype(int) % 4] + rest[:, None] * poses[:, :2, 0]
    return Trajectory(np.arange(len(along), dtype=np.int64) * 100_000_000, poses)


def test_odometry_is_weakened_until_its_error_is_large_enough() -> None:
    truth = around_a_block(60.0)
    weak = weaken_odometry(truth, truth, seed=3)
    assert weak.rmse_m > LEAST_ERROR_M and weak.level & (weak.level - 1) == 0
    assert np.isclose(ape(weak.trajectory, truth, "origin").translation.rmse, weak.rmse_m)
    steps = np.linalg.norm(np.diff(weak.trajectory.positions, axis=0), axis=1)
    assert np.allclose(steps[10:180], 0.05 * (1 + weak.level / 100))  # so many per cent too long
    same, other = (weaken_odometry(truth, truth, seed=s).trajectory.poses for s in (3, 4))
    assert np.array_equal(same, weak.trajectory.poses) and not np.allclose(other, same)
    assert f"{weak.level} % too long" in weak.describe() and f"{RANGE_M:g} m" in weak.describe()
    assert weaken_odometry(around_a_block(400.0), around_a_block(400.0), seed=3).level < weak.level
    with pytest.raises(UserError, match="too short"):
        weaken_odometry(around_a_block(0.5), around_a_block(0.5), seed=0)


def test_a_weak_sensor_sees_what_is_near() -> None:
    ranges = np.linspace(1.0, 20.0, 400)
    points = np.column_stack([ranges, np.zeros((400, 2))])
    assert shortened(points)[:, 0].max() < RANGE_M and len(shortened(points)) == np.sum(ranges < RANGE_M)
    assert len(shortened(points + np.array([50.0, 0.0, 0.0]))) == 50
    scan = shortened_scan(Scan(0, 0, points[::-1], 0, Path(), point_times=ranges[::-1]))
    assert scan.point_times is not None and np.array_equal(scan.point_times, scan.points[:, 0])


def plan(rooms: int, frame: str) -> SceneGraph:
    """Rooms of 4 x 3 m in a row, four walls each."""
    spaces, walls = [], []
    for k in range(rooms):
        x = 5.0 * k
        spaces.append(Room(f"{frame}{k}", (x, 0.0), "f"))
        for j, (nx, ny) in enumerate(((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))):
            centre = (x - 2.0 * nx, -1.5 * ny)
            walls.append(WallSurface(f"{frame}{k}w{j}", f"{frame}{k}", centre, (nx, ny), 3.0 + abs(ny), "f"))
    return SceneGraph(frame, tuple(spaces), tuple(walls))


class Knows:
    """Answers with equal numbers."""

    def __init__(self, status: str = "unique") -> None:
        self.status = status

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        rooms = tuple((x.id, y.id, 0.9) for x, y in zip(s.rooms, a.rooms, strict=False))
        walls = tuple((x.id, y.id, 0.9) for x, y in zip(s.wall_surfaces, a.wall_surfaces, strict=False))
        return MatchResult(self.status, "", rooms, walls, (0.0, 0.0, 0.0), "f")  # type: ignore[arg-type]


def test_wrong_matches_take_whole_rooms_elsewhere() -> None:
    s, a = plan(5, "s"), plan(6, "a")
    right, wrong = (m.match(s, a) for m in (Knows(), WrongMatches(Knows(), 2, seed=1)))
    changed = {x[0] for x, y in zip(wrong.rooms, right.rooms, strict=True) if x != y}
    assert len(changed) == 2
    elsewhere = {room: target for room, target, _ in wrong.rooms}
    for mine, true in zip(wrong.wall_surfaces, right.wall_surfaces, strict=True):
        room = mine[0][:2]
        if room not in changed:
            assert mine == true
        else:
            surface = a.surface_by_id[mine[1]]
            assert surface.room == elsewhere[room] != true[1][:2]
            assert np.allclose(surface.normal, s.surface_by_id[mine[0]].normal)
    assert WrongMatches(Knows(), 2, seed=1).match(s, a) == wrong
    assert WrongMatches(Knows("ambiguous"), 2, seed=1).match(s, a) == Knows("ambiguous").match(s, a)


def test_the_oracle_answers_with_the_truth() -> None:
    a = plan(4, "a")
    s = replace(plan(2, "s"), frame="map")
    T_bim_map = np.eye(4)
    T_bim_map[0, 3] = 5.0  # the map's first room is the plan's second
    answer = OracleMatcher(T_bim_map, "f").match(s, a)
    assert answer.status == "unique" and dict((x, y) for x, y, _ in answer.rooms) == {"s0": "a1", "s1": "a2"}
    assert all(y == f"a{int(x[1]) + 1}{x[2:]}" for x, y, _ in answer.wall_surfaces)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[SmallBuilding, SimulatedRun]:
    folder = tmp_path_factory.mktemp("icp")
    building = write_small_ifc(folder / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.5)
    return building, simulate(building.path, STOREY, folder / "drive", seed=2, min_rooms=2, min_length=5.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "variant"),
    [("ifc", "icp-to-bim"), ("graph", "icp-to-bim"), pytest.param("ifc", "multi-scale-icp-to-bim", marks=needs_open3d)],
)
def test_scans_are_registered_to_the_buildings_surfaces(
    driven: tuple[SmallBuilding, SimulatedRun], of: str, variant: str
) -> None:
    building, run = driven
    path: Path = building.path
    surfaces = surfaces_of_ifc(path) if of == "ifc" else surfaces_of_graph(load_bim(path).graph)
    scans = [scan for scan in ScanFolder(run.out_dir / "scans") if scan.index < 40]
    estimate = register_to_bim(scans, surfaces, run.truth.poses[0], ALIGNERS[variant])
    assert len(estimate) == 40
    error = error_in_bim(estimate, run.truth)
    assert error.horizontal.rmse < 0.02 and error.yaw.max < 0.01


def test_errors_are_those_of_the_scans_that_have_a_pose_and_say_how_many_that_are() -> None:
    truth = around_a_block(30.0)
    there = np.ones(len(truth), dtype=bool)
    there[:5] = there[200:250] = False  # not anchored at first, and lost in the middle
    T = pose(3.0, -2.0, 0.1, 0.4)
    part = truth.only(there).transformed(np.linalg.inv(T))
    np.testing.assert_allclose(origin_alignment(part, truth), T, atol=1e-9)
    off = truth.only(there).transformed(pose(0.0, 0.0, 0.1))
    found = _of_trajectory(off, truth)
    assert found["rmse_m"] == pytest.approx(0.1) and found["matched_poses"] == len(truth) - 55
    assert found["times_s"][0] == 0.5  # since the first scan
    rmse, share = _error(off, truth, np.eye(4), int(truth.stamps_ns[100]))
    assert rmse == pytest.approx(0.1) and share == pytest.approx(1 - 50 / (len(truth) - 100))
