"""The LiDAR simulator, on a small building whose solids are known exactly."""

import json
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import refused
from numpy.typing import NDArray
from small_ifc import CUPBOARD, DOORS, PIT, ROOMS, Box, SmallBuilding, write_small_ifc

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.scans import ScanFolder
from data.scans.formats import read_points
from data.simulation import Changes, Robot, Sensor, SimulatedRun
from data.simulation.carriers import WHEELED
from data.simulation.simulate import simulate
from data.trajectory import Trajectory

SENSOR = Sensor(azimuths=120, rate=5.0)
Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def run(building: SmallBuilding, tmp_path_factory: pytest.TempPathFactory) -> SimulatedRun:
    out = tmp_path_factory.mktemp("run") / "run"
    return simulate(building.path, "Ground", out, seed=1, min_length=60.0, sensor=SENSOR)


def off_surfaces(points: Array, boxes: tuple[Box, ...]) -> Array:
    """(N,) metres from points (N, 3) to the nearest box's surface."""
    best = np.full(len(points), np.inf)
    for box in boxes:
        low, high = np.array(box[:3]), np.array(box[3:])
        beyond = np.abs(points - (low + high) / 2) - (high - low) / 2
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        best = np.minimum(best, np.where(outside > 0, outside, -beyond.max(axis=1)))
    return best


def plan_distance(xy: Array, boxes: tuple[Box, ...]) -> Array:
    """(N,) metres from xy (N, 2) to the nearest box that is in the way of a robot, seen from above."""
    in_the_way = [b for b in boxes if b[5] > 0.15 and b[2] < 1.6]
    gaps = [np.maximum(np.maximum(np.array(b[:2]) - xy, xy - np.array(b[3:5])), 0) for b in in_the_way]
    return np.asarray(np.min([np.linalg.norm(gap, axis=1) for gap in gaps], axis=0))


def in_room(xy: Array, name: str) -> bool:
    x0, y0, x1, y1 = ROOMS[name]
    return bool(x0 < xy[0] < x1 and y0 < xy[1] < y1)


def points_in_building(run: SimulatedRun, building: SmallBuilding, every: int = 20) -> Array:
    scans = sorted((run.out_dir / "scans").glob("0*"))
    poses = run.truth.poses[::every]
    moved = [read_points(s) @ T[:3, :3].T + T[:3, 3] for s, T in zip(scans[::every], poses, strict=True)]
    return building.from_bim(np.concatenate(moved))


def test_scans_at_the_true_poses_lie_on_the_building(run: SimulatedRun, building: SmallBuilding) -> None:
    """Every surface is seen; leaves of doors are not there; the sensor keeps its distance and height."""
    places, points = building.from_bim(run.truth.positions), points_in_building(run, building, every=5)
    assert plan_distance(places[:, :2], building.solids).min() >= WHEELED.robot.radius
    np.testing.assert_allclose(places[:, 2], 0.8, atol=1e-3)
    off = off_surfaces(points, building.solids)
    assert np.mean(off < 0.08) > 0.99 and np.median(off) < 0.02
    assert all(np.sum(off_surfaces(points, (box,)) < 0.05) > 20 for box in (*building.solids[:3], CUPBOARD))
    leaves = ((door[0] + 0.2, 3.08, 0.2, door[3] - 0.2, 3.12, 1.9) for door in DOORS)
    assert not any(np.any(off_surfaces(points, (leaf,)) < 0.05) for leaf in leaves)


def test_rooms_are_truly_entered_through_the_doors(run: SimulatedRun, building: SmallBuilding) -> None:
    places, seconds = building.from_bim(run.truth.positions), run.truth.stamps_ns / 1e9
    names = [building.rooms[room.id] for room in run.rooms]
    assert set(names) == set(ROOMS) and run.rooms_entered == 3 and [room.name for room in run.rooms] == names
    assert all(a != b and "Hall" in (a, b) for a, b in pairwise(names))
    for room, name in zip(run.rooms, names, strict=True):
        assert in_room(places[np.argmin(np.abs(seconds - room.entered_s)), :2], name)
    in_wall = places[(places[:, 1] > 3.0) & (places[:, 1] < 3.2), 0]
    assert len(in_wall) and all(any(d[0] < x < d[3] for d in DOORS) for x in in_wall)


def test_what_is_written_is_what_was_driven(run: SimulatedRun, building: SmallBuilding) -> None:
    truth = Trajectory.read_tum(run.out_dir / "truth.tum")
    np.testing.assert_array_equal(truth.stamps_ns, run.truth.stamps_ns)
    np.testing.assert_allclose(truth.poses, run.truth.poses, atol=1e-9)
    assert [scan.stamp_ns for scan in ScanFolder(run.out_dir / "scans")] == truth.stamps_ns.tolist()
    written = json.loads((run.out_dir / "run.json").read_text())
    assert [r["id"] for r in written["rooms"]] == [r.id for r in run.rooms]
    assert (written["seed"], written["storey"], written["scans"]) == (1, "Ground", len(truth))


@pytest.mark.parametrize(
    "options",
    [{"slabs": False}, {"spaces": False, "millimetres": True, "elevation": 2.5}, {"pit": True}],
)
def test_models_that_lack_something_can_be_driven(options: dict[str, Any], tmp_path: Path) -> None:
    bare = write_small_ifc(tmp_path / "bare.ifc", **options)
    sensor = Sensor(lowest_deg=-45, highest_deg=45, azimuths=90, rate=5.0)
    run = simulate(bare.path, "ground", tmp_path / "out", 0, 3, 20.0, sensor)
    places, points = bare.from_bim(run.truth.positions), points_in_building(run, bare)
    pit = (*PIT[:2], 0.0, *PIT[3:5], 1.0)
    assert plan_distance(places[:, :2], (*bare.solids, *[pit] * ("pit" in options))).min() >= WHEELED.robot.radius
    np.testing.assert_allclose(places[:, 2], 0.8, atol=1e-3)
    assert run.rooms_entered == 3 and all(any(in_room(p, name) for p in places[:, :2]) for name in ROOMS)
    assert np.mean(off_surfaces(points, bare.solids) < 0.08) > 0.99
    assert all(np.mean(np.abs(points[:, 2] - z) < 0.06) > 0.05 for z in (0.0, 2.6))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"storey": "Attic"}, r"no storey 'Attic'.*'Ground'"),
        ({"carrier": replace(WHEELED, robot=Robot(radius=3.0))}, "no room can be reached"),
        ({"scan_format": "xyz"}, "scan format 'xyz'.*bin"),
    ],
)
def test_mistakes_are_refused(building: SmallBuilding, tmp_path: Path, change: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"building": building.path, "storey": "Ground", "out_dir": tmp_path / "out", **change}
    with pytest.raises(UserError, match=message):
        simulate(**arguments)
    assert list(tmp_path.iterdir()) == []


def test_ranges_of_the_sensor_and_their_noise() -> None:
    square = [[5.0, -50, -50], [5, 50, -50], [5, 50, 50], [5, -50, 50]]  # the plane x = 5
    scene = TriangleScene(np.array([[square[0], square[1], square[2]], [square[0], square[2], square[3]]]))

    def seen(noise: float = 0.0, **limits: Any) -> Array:
        return Sensor(range_noise=noise, **limits).scan(scene, np.eye(4), np.random.default_rng(0))[0].astype(float)

    points = seen(max_range=8.0)
    ranges = np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(points[:, 0], 5.0, atol=1e-4)
    assert ranges.max() <= 8.0 and ranges.max() > 7.9 and len(seen(max_range=4.0)) == 0
    assert 5.5 <= np.linalg.norm(seen(min_range=5.5), axis=1).min() < 5.6
    noisy, true = seen(0.03), seen()  # along the beam only
    errors = np.linalg.norm(noisy, axis=1) - np.linalg.norm(true, axis=1)
    assert np.std(errors) == pytest.approx(0.03, rel=0.03) and abs(np.mean(errors)) < 0.001
    assert np.abs(np.cross(noisy, true)).max() < 0.01


def test_moved_walls_are_scanned_where_they_stand(building: SmallBuilding, tmp_path: Path) -> None:
    changed = simulate(
        building.path, "Ground", tmp_path / "run", seed=4, min_length=20.0, sensor=SENSOR, changes=Changes(moved=0.5)
    )
    listed = json.loads((tmp_path / "run" / "changes.json").read_text())
    assert [c["id"] for c in listed] == [c.id for c in changed.changes] and len(listed) == 3
    offsets = np.array([c["offset_in_bim"] for c in listed])
    sizes = np.linalg.norm(offsets, axis=1)
    assert ((sizes >= 0.1) & (sizes <= 0.3)).all() and {c["kind"] for c in listed} == {"moved"}
    local = np.abs(offsets @ building.T_bim_building[:2, :2])  # a wall moves across: along one axis of the building
    assert (local.min(axis=1) < 1e-6).all()
    off = off_surfaces(points_in_building(changed, building), building.solids)
    assert np.mean(off > 0.06) > 0.1  # a good part of what is seen is not where the plan has it


@pytest.mark.slow
def test_the_command_line(building: SmallBuilding, tmp_path: Path) -> None:
    out, asked = tmp_path / "a" / "out", ["--bim", str(building.path), "--storey", "Ground", "--seed", "3"]
    sizes = ["--min-rooms", "1", "--min-length", "2", "--format", "ply"]
    command = [sys.executable, "-m", "data.simulate", *asked, *sizes, "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(list((out / "scans").glob("*.ply"))) == len(Trajectory.read_tum(out / "truth.tum"))
    new = ["data.simulate", *asked, "--out", tmp_path / "new"]
    for message, words in (
        ("not an empty", ["data.simulate", *asked, "--out", out]),
        ("at most 0.3", [*new, "--displaced-openings", "0.5", "--displaced-by", "1"]),
    ):
        assert message in refused(*words)
