"""The LiDAR simulator, on a small building whose solids are known exactly."""

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from commands import refused
from numpy.typing import NDArray
from small_ifc import CUPBOARD, DOORS, PANE, PIT, ROOMS, WALLS, Box, SmallBuilding, write_small_ifc

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.scans import ScanFolder
from data.scans.formats import read_points
from data.scans.writers import SCAN_WRITERS
from data.simulation import Changes, Robot, SimulatedRun, SpinningSensor
from data.simulation.drive import drive
from data.simulation.occupancy import build_grid
from data.simulation.route import curve_length, plan_tour
from data.simulation.simulate import ROBOT, simulate
from data.simulation.storey_model import load_storey
from data.trajectory import Trajectory

SENSOR = SpinningSensor(azimuths=120, rate=5.0)
INSTITUTE = Path(__file__).parents[3] / "../shared/data/ifc/AC11-Institute-Var-2-IFC.ifc"
Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> SmallBuilding:
    path = tmp_path_factory.mktemp("ifc") / "small.ifc"
    return write_small_ifc(path, site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0)


@pytest.fixture(scope="module")
def run(building: SmallBuilding, tmp_path_factory: pytest.TempPathFactory) -> SimulatedRun:
    out = tmp_path_factory.mktemp("run") / "run"
    return simulate(building.path, "Ground", out, seed=1, min_length=60.0, sensor=SENSOR)


def distance_to_surface(points: Array, boxes: tuple[Box, ...]) -> Array:
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
    moved = [
        read_points(scans[i]).astype(float) @ run.truth.poses[i, :3, :3].T + run.truth.poses[i, :3, 3]
        for i in range(0, len(scans), every)
    ]
    return building.from_bim(np.concatenate(moved))


def motion(run: SimulatedRun) -> tuple[Array, Array, Array]:
    """Speed (N-1,), yaw rate (N-1,), and yaw (N,) from the poses."""
    seconds = np.diff(run.truth.stamps_ns) / 1e9
    yaw = np.unwrap(np.arctan2(run.truth.poses[:, 1, 0], run.truth.poses[:, 0, 0]))
    steps = np.linalg.norm(np.diff(run.truth.positions, axis=0), axis=1)
    return steps / seconds, np.diff(yaw) / seconds, yaw


def test_the_sensor_keeps_its_distance_and_height(run: SimulatedRun, building: SmallBuilding) -> None:
    places = building.from_bim(run.truth.positions)
    assert plan_distance(places[:, :2], building.solids).min() >= ROBOT.radius
    np.testing.assert_allclose(places[:, 2], 0.8, atol=1e-3)


def test_scans_at_the_true_poses_lie_on_the_building(run: SimulatedRun, building: SmallBuilding) -> None:
    distance = distance_to_surface(points_in_building(run, building), building.solids)
    assert np.mean(distance < 0.08) > 0.99
    assert np.median(distance) < 0.02


def test_every_surface_is_seen_and_door_leaves_are_not(run: SimulatedRun, building: SmallBuilding) -> None:
    points = points_in_building(run, building, every=5)
    for box in (*building.solids[:3], CUPBOARD):
        assert np.sum(distance_to_surface(points, (box,)) < 0.05) > 20
    for door in DOORS:
        leaf = (door[0] + 0.2, 3.08, 0.2, door[3] - 0.2, 3.12, 1.9)
        assert np.sum(distance_to_surface(points, (leaf,)) < 0.05) == 0


def test_rooms_are_truly_entered_through_the_doors(run: SimulatedRun, building: SmallBuilding) -> None:
    places, seconds = building.from_bim(run.truth.positions), run.truth.stamps_ns / 1e9
    names = [building.rooms[room.id] for room in run.rooms]
    assert set(names) == set(ROOMS) and run.rooms_entered == 3
    assert [room.name for room in run.rooms] == names
    assert all(a != b and "Hall" in (a, b) for a, b in pairwise(names))
    for room, name in zip(run.rooms, names, strict=True):
        assert in_room(places[np.argmin(np.abs(seconds - room.entered_s)), :2], name)
    in_wall = places[(places[:, 1] > 3.0) & (places[:, 1] < 3.2), 0]
    assert len(in_wall) and all(any(d[0] < x < d[3] for d in DOORS) for x in in_wall)


def test_the_robot_moves_like_a_robot(run: SimulatedRun) -> None:
    speed, yaw_rate, yaw = motion(run)
    assert speed.max() <= ROBOT.speed + 1e-6 and speed.max() > 0.9 * ROBOT.speed
    assert np.abs(np.diff(speed)).max() * SENSOR.rate <= 1.05 * ROBOT.acceleration
    assert np.abs(yaw_rate).max() <= 1.05 * ROBOT.yaw_rate
    assert np.abs(np.diff(yaw_rate)).max() * SENSOR.rate <= 1.6 * ROBOT.yaw_acceleration
    assert speed[0] == 0 and speed[-1] == 0
    assert run.length >= 60 and np.sum(speed) / SENSOR.rate == pytest.approx(run.length, rel=0.01)
    steps = np.diff(run.truth.positions, axis=0)[speed > 0.3]
    heading = ((yaw[:-1] + yaw[1:]) / 2)[speed > 0.3]
    assert np.abs(np.cross(np.c_[np.cos(heading), np.sin(heading), 0 * heading], steps)).max() < 0.01
    assert np.all(np.sum(np.c_[np.cos(heading), np.sin(heading)] * steps[:, :2], axis=1) > 0)
    assert np.cos(yaw[0] - run.start_yaw) == pytest.approx(1.0)


def test_what_is_written_is_what_was_driven(run: SimulatedRun) -> None:
    truth = Trajectory.read_tum(run.out_dir / "truth.tum")
    np.testing.assert_array_equal(truth.stamps_ns, run.truth.stamps_ns)
    np.testing.assert_allclose(truth.poses, run.truth.poses, atol=1e-9)
    assert [scan.stamp_ns for scan in ScanFolder(run.out_dir / "scans")] == truth.stamps_ns.tolist()
    written = json.loads((run.out_dir / "run.json").read_text())
    assert [r["id"] for r in written["rooms"]] == [r.id for r in run.rooms]
    assert (written["seed"], written["storey"], written["scans"]) == (1, "Ground", len(truth))


def test_range_noise_has_the_asked_sigma(building: SmallBuilding, tmp_path: Path) -> None:
    scans = []
    for noise in (0.0, 0.03):
        sensor = SpinningSensor(azimuths=120, rate=1.0, range_noise=noise)
        out = simulate(building.path, "Ground", tmp_path / str(noise), 2, 1, 5.0, sensor).out_dir
        scans.append(np.concatenate([read_points(p) for p in sorted((out / "scans").glob("*.bin"))]))
    true, noisy = (np.linalg.norm(s, axis=1) for s in scans)
    assert np.std(noisy - true) == pytest.approx(0.03, rel=0.03)
    assert abs(np.mean(noisy - true)) < 0.001
    across = scans[1] - scans[0] * (noisy / true)[:, None]
    assert np.abs(across).max() < 1e-4  # along the beam only


def test_the_seed_decides_every_byte(building: SmallBuilding, tmp_path: Path) -> None:
    def files(name: str, seed: int) -> dict[str, bytes]:
        sensor = SpinningSensor(beams=4, azimuths=60, rate=1.0)
        out = simulate(building.path, "Ground", tmp_path / name, seed, 2, 10.0, sensor).out_dir
        return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file()}

    first, again, other = files("first", 5), files("again", 5), files("other", 6)
    assert first == again
    assert first["truth.tum"] != other["truth.tum"]


def test_spaces_serve_as_floor_and_ceiling_of_a_model_without(tmp_path: Path) -> None:
    bare = write_small_ifc(tmp_path / "bare.ifc", slabs=False)
    sensor = SpinningSensor(lowest_deg=-45, highest_deg=45, azimuths=90, rate=5.0)
    points = points_in_building(simulate(bare.path, "Ground", tmp_path / "out", 0, 3, 20.0, sensor), bare)
    assert np.mean(distance_to_surface(points, bare.solids) < 0.08) > 0.99
    for z in (0.0, 2.6):
        assert np.mean(np.abs(points[:, 2] - z) < 0.06) > 0.05


def test_a_storey_without_spaces_in_millimetres(tmp_path: Path) -> None:
    bare = write_small_ifc(tmp_path / "bare.ifc", spaces=False, millimetres=True, elevation=2.5)
    run = simulate(bare.path, "ground", tmp_path / "out", 0, 3, 20.0, SENSOR)
    assert run.rooms_entered == 3
    places = bare.from_bim(run.truth.positions)
    np.testing.assert_allclose(places[:, 2], 0.8, atol=1e-3)
    assert plan_distance(places[:, :2], bare.solids).min() >= ROBOT.radius
    assert {name for name in ROOMS if any(in_room(p[:2], name) for p in places)} == set(ROOMS)


def test_nothing_drives_where_there_is_no_floor(tmp_path: Path) -> None:
    holed = write_small_ifc(tmp_path / "pit.ifc", pit=True)
    run = simulate(holed.path, "Ground", tmp_path / "out", 0, 3, 60.0, SpinningSensor(beams=1, azimuths=4))
    pit = (*PIT[:2], 0.0, *PIT[3:5], 1.0)
    assert plan_distance(run.truth.positions[:, :2], (pit,)).min() >= ROBOT.radius


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"storey": "Attic"}, r"no storey 'Attic'.*'Ground'"),
        ({"storey": ""}, r"no storey was named .--storey.; it has: .*'Ground'"),
        ({"robot": Robot(radius=3.0)}, "no room can be reached"),
        ({"scan_format": "xyz"}, "scan format 'xyz'.*bin"),
        ({"sensor_height": 2.6}, "no room can be reached"),  # in the ceiling
        ({"ifc": "missing.ifc"}, "no such file"),
    ],
)
def test_mistakes_are_refused(building: SmallBuilding, tmp_path: Path, change: dict[str, object], message: str) -> None:
    arguments = {"ifc": building.path, "storey": "Ground", "out_dir": tmp_path / "out", **change}
    with pytest.raises(UserError, match=message):
        simulate(**arguments)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_use_is_refused(run: SimulatedRun, building: SmallBuilding) -> None:
    with pytest.raises(UserError, match="not an empty folder"):
        simulate(building.path, "Ground", run.out_dir)


@pytest.mark.parametrize(
    "make",
    [
        lambda: SpinningSensor(beams=0),
        lambda: SpinningSensor(min_range=5, max_range=4),
        lambda: SpinningSensor(range_noise=float("nan")),
        lambda: SpinningSensor(lowest_deg=20, highest_deg=10),
        lambda: Robot(speed=0),
        lambda: Robot(acceleration=-1),
    ],
)
def test_sensors_and_robots_that_cannot_be(make) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(UserError):
        make()


def test_ranges_beyond_the_sensors_are_left_out() -> None:
    square = [[5.0, -50, -50], [5, 50, -50], [5, 50, 50], [5, -50, 50]]  # the plane x = 5
    scene = TriangleScene(np.array([[square[0], square[1], square[2]], [square[0], square[2], square[3]]]))
    rng = np.random.default_rng(0)
    points = SpinningSensor(range_noise=0, max_range=8.0).scan(scene, np.eye(4), rng)
    np.testing.assert_allclose(points[:, 0], 5.0, atol=1e-4)
    ranges = np.linalg.norm(points, axis=1)
    assert ranges.max() <= 8.0 and ranges.max() > 7.9
    assert len(SpinningSensor(max_range=4.0).scan(scene, np.eye(4), rng)) == 0
    far = SpinningSensor(range_noise=0, min_range=5.5).scan(scene, np.eye(4), rng)
    nearest = np.linalg.norm(far, axis=1).min()
    assert 5.5 <= nearest < 5.6


def test_ranges_are_exact_far_from_the_origin() -> None:
    offset = np.array([691_000.123, 5_334_000.456, 520.0])  # as in map coordinates
    wall = np.array([[[5.0, -9, -9], [5, 9, -9], [5, 0, 9]]]) + offset
    ranges = TriangleScene(wall).distances(offset, np.array([[1.0, 0, 0], [0.8, 0.6, 0], [-1, 0, 0]]))
    np.testing.assert_allclose(ranges, [5.0, 6.25, np.inf], atol=1e-4)


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.3, -3.0])
def test_a_turn_on_the_spot_reaches_the_way(angle: float) -> None:
    leg = np.column_stack([np.linspace(0, 2, 201), np.zeros(201)])
    stamps, poses = drive([leg], -angle, ROBOT, 100.0)
    np.testing.assert_allclose(poses[0], [0, 0, -angle], atol=1e-12)
    np.testing.assert_allclose(poses[-1], [2, 0, 0], atol=1e-9)
    rate = np.diff(poses[:, 2]) / np.diff(stamps)
    assert np.abs(rate).max() <= ROBOT.yaw_rate + 1e-6
    assert np.abs(np.diff(rate)).max() * 100 <= ROBOT.yaw_acceleration + 1e-6


@pytest.mark.parametrize("scan_format", sorted(SCAN_WRITERS))
def test_every_format_is_read_back(scan_format: str, tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    SCAN_WRITERS[scan_format](tmp_path / f"a.{scan_format}", points)
    np.testing.assert_array_equal(read_points(tmp_path / f"a.{scan_format}"), points)
    SCAN_WRITERS[scan_format](tmp_path / f"none.{scan_format}", points[:0])
    assert len(read_points(tmp_path / f"none.{scan_format}")) == 0


def test_how_far_walls_stand_off_their_places_is_written(building: SmallBuilding, tmp_path: Path) -> None:
    run = simulate(
        building.path, "Ground", tmp_path / "run", seed=4, min_length=20.0, sensor=SENSOR, effects=("tolerance",)
    )
    listed = json.loads((tmp_path / "run" / "tolerances.json").read_text())
    sizes = np.linalg.norm([c["offset_in_bim"] for c in listed], axis=1)
    assert len(listed) > 4 and sizes.min() > 0 and sizes.max() < 0.08 and not run.changes
    off = distance_to_surface(points_in_building(run, building), building.solids)
    assert 0.003 < np.median(off) < 0.04 and not (tmp_path / "run" / "changes.json").exists()


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
    points = points_in_building(changed, building)
    off = distance_to_surface(points, building.solids)
    assert np.mean(off > 0.06) > 0.1  # a good part of what is seen is not where the plan has it
    again = load_storey(building.path, "Ground", Changes(moved=0.5), seed=4)
    assert again.changes == changed.changes
    assert load_storey(building.path, "Ground", Changes(moved=0.5), seed=5).changes != changed.changes


def test_there_and_back_is_the_same_way_twice(building: SmallBuilding, tmp_path: Path) -> None:
    once = simulate(building.path, "Ground", tmp_path / "once", seed=1, min_length=10.0, sensor=SENSOR)
    twice = simulate(building.path, "Ground", tmp_path / "twice", seed=1, min_length=10.0, sensor=SENSOR, and_back=True)
    assert np.isclose(twice.length, 2 * once.length)
    np.testing.assert_allclose(twice.truth.positions[: len(once.truth) - 3], once.truth.positions[:-3], atol=1e-6)
    np.testing.assert_allclose(twice.truth.positions[-1], once.truth.positions[0], atol=0.02)


def test_the_window_goes_with_its_wall_and_an_absent_wall_is_open(building: SmallBuilding) -> None:
    plain, bare = (load_storey(building.path, "Ground", c) for c in (None, Changes(absent=1.0)))
    assert len(bare.changes) == len(WALLS) and {c.kind for c in bare.changes} == {"absent"}
    pane = building.T_bim_building[:2, :2] @ [(PANE[0] + PANE[3]) / 2, (PANE[1] + PANE[4]) / 2]
    centre = np.array([*(pane + building.T_bim_building[:2, 3]), building.T_bim_building[2, 3] + 1.5])
    inward = building.T_bim_building[:3, :3] @ [0.0, -1.0, 0.0]
    seen = [TriangleScene(s.solid).distances(centre + inward, -inward[None])[0] for s in (plain, bare)]
    assert abs(seen[0] - 0.98) < 1e-3 and seen[1] == np.inf
    with pytest.raises(UserError, match="0 to 1"):
        Changes(moved=0.7, absent=0.7)


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "data.simulate", *arguments], capture_output=True, text=True)


@pytest.mark.slow
def test_the_command_line(building: SmallBuilding, tmp_path: Path) -> None:
    out, asked = tmp_path / "a" / "out", ["--bim", str(building.path), "--storey", "Ground", "--seed", "3"]
    sizes = ["--min-rooms", "1", "--min-length", "2", "--speed", "0.5", "--format", "ply"]
    done = command(*asked, *sizes, "--out", str(out))
    assert done.returncode == 0, done.stderr
    assert len(list((out / "scans").glob("*.ply"))) == len(Trajectory.read_tum(out / "truth.tum"))
    assert "not an empty" in refused("data.simulate", *asked, "--out", out)
    (tmp_path / "file").touch()
    assert "give another --out" in refused("data.simulate", *asked, *sizes, "--out", tmp_path / "file" / "out")


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.skipif(not INSTITUTE.exists(), reason=f"{INSTITUTE} is absent")
def test_the_institutes_ground_floor_can_be_driven() -> None:
    storey = load_storey(INSTITUTE, "Erdgeschoss")
    grid = build_grid(storey, TriangleScene(storey.solid), 1.6)
    for seed in range(3):
        legs = plan_tour(grid, ROBOT.radius, 8, 120.0, np.random.default_rng(seed))
        rooms = np.unique(grid.room_at(np.concatenate(legs)))
        assert sum(map(curve_length, legs)) >= 120 and np.sum(rooms >= 0) >= 8
        assert grid.clearance_at(np.concatenate(legs)).min() >= ROBOT.radius
        assert "Flur EG Eingang" in {grid.rooms[k].long_name for k in rooms}
