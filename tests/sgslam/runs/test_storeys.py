"""Several storeys in one run: floors of the map, and which storeys of the plan they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from boxes import Box, pose, room, scan, triangles_of
from drives import off

from data import SceneGraph, UserError
from data.generation.demo_building import DEMO_STOREYS, write_demo_building
from data.geometry.raycast import TriangleScene
from data.plans import Bim, load_bim
from data.scans import ScanFolder
from data.simulation import Robot, SimulatedRun, SpinningSensor
from data.simulation.simulate import simulate
from sgslam.anchoring import floor_named
from sgslam.anchoring.storey_hypotheses import assignments
from sgslam.config import Config
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.session import Checkpoints, PriorMap, Result
from sgslam.slam import SceneGraphSlam

GROUND, UPPER = DEMO_STOREYS


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("building") / "demo.ifc"
    write_demo_building(path)
    return path


@pytest.fixture(scope="module")
def drive(building: Path) -> SimulatedRun:
    """Up the stair, and down again."""
    sensor = SpinningSensor(azimuths=450)
    robot = Robot(yaw_rate=1.2, yaw_acceleration=2.0)
    storeys = (GROUND, UPPER, GROUND)
    return simulate(building, storeys, building.parent / "drive", 1, 1, 6.0, sensor, robot)


@pytest.fixture(scope="module")
def bim(building: Path) -> Bim:
    return load_bim(building, building.parent / "cache")


@pytest.fixture(scope="module")
def run(drive: SimulatedRun, bim: Bim) -> tuple[SceneGraphSlam, Result]:
    slam = SceneGraphSlam(bim, storey=GROUND)
    for one in ScanFolder(drive.out_dir / "scans"):
        slam.add_scan(one.stamp_ns, one.points)
    return slam, slam.finish()


@pytest.fixture(scope="module")
def result(run: tuple[SceneGraphSlam, Result]) -> Result:
    return run[1]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("share", "within"), [(0.9, 0.06), (0.7, 0.65)])
def test_a_storey_is_anchored_where_the_odometry_slips_on_the_stairs(
    share: float, within: float, drive: SimulatedRun, bim: Bim
) -> None:
    """The odometry tells a share of the climb of 3.2 m. With nine tenths the storey follows from the height. With seven
    no storey does, and it needs an answer of its own: it was 0.96 m off, and is halfway to an odometry that is sure."""
    slam, truth = SceneGraphSlam(bim), drive.truth
    for one in ScanFolder(drive.out_dir / "scans"):
        told = truth.at(np.array([one.stamp_ns]))[0]
        told[2, 3] *= share
        slam.add_scan(one.stamp_ns, one.points, T_odom_sensor=told)
    result = slam.finish()
    assert result.anchored and result.matches is not None and len(set(result.matches["floors"].values())) == 2
    upstairs = truth.at(result.trajectory.stamps_ns)[:, 2, 3] > 3.9
    assert upstairs.sum() > 30
    assert np.median(np.abs(off(result.trajectory, truth))[upstairs, 2]) < within


@pytest.mark.slow
def test_a_climbed_storey_is_a_floor_of_its_own(drive: SimulatedRun, result: Result, tmp_path: Path) -> None:
    ground, upper = result.s_graph.floors
    assert ground.elevation is not None and upper.elevation is not None
    assert upper.elevation - ground.elevation == pytest.approx(3.2, abs=0.3)
    height = dict(zip(drive.truth.stamps_ns.tolist(), drive.truth.positions[:, 2].tolist(), strict=True))
    for keyframe in result.s_graph.keyframes:
        z = height[keyframe.stamp_ns]
        if keyframe.floor is not None:
            assert abs(z - (0.8 if keyframe.floor == ground.id else 4.0)) < 0.65  # it is noticed four steps later
        else:
            assert not keyframe.observes and keyframe.room is None
    assert any(keyframe.floor is None for keyframe in result.s_graph.keyframes)
    assert {r.floor for r in result.s_graph.rooms} == {ground.id, upper.id}
    rooms = result.s_graph.room_by_id
    assert result.s_graph.keyframes[-1].floor == ground.id  # it came back
    result.s_graph.save(tmp_path / "s.json")
    assert SceneGraph.load(tmp_path / "s.json") == result.s_graph
    assert all(w.room is None or rooms[w.room].floor == w.floor for w in result.s_graph.wall_surfaces)


@pytest.mark.long
@pytest.mark.slow
def test_who_enters_a_known_map_upstairs_is_found_upstairs(
    drive: SimulatedRun, run: tuple[SceneGraphSlam, Result], tmp_path: Path
) -> None:
    slam, result = run
    Checkpoints(tmp_path, {}).write(slam, {}, finished=True)
    result.clouds.copy_to(tmp_path / CLOUDS)
    second = SceneGraphSlam(prior=PriorMap.load(tmp_path, Config()))  # without the building
    away = np.inf
    for one in ScanFolder(drive.out_dir / "scans"):
        T_bim_sensor = drive.truth.at(np.array([one.stamp_ns]))[0]
        if T_bim_sensor[2, 3] > 3.99 and second.T_prior_map is None:
            update = second.add_scan(one.stamp_ns, one.points)
            if second.T_prior_map is not None and result.T_bim_map is not None:
                placed = result.T_bim_map @ second.T_prior_map @ update.T_map_sensor
                away = float(np.linalg.norm((placed - T_bim_sensor)[:3, 3]))
    assert away < 0.1


@pytest.mark.slow
def test_every_floor_is_placed_on_its_storey(drive: SimulatedRun, result: Result, bim: Bim) -> None:
    assert result.anchored and result.matches is not None
    names = {floor.id: floor.name for floor in bim.graph.floors}
    assert {k: names[v] for k, v in result.matches["floors"].items()} == {"floor-0": GROUND, "floor-1": UPPER}
    planned, seen = bim.graph.room_by_id, result.s_graph.room_by_id
    for s_id, a_id, confidence in result.matches["rooms"]:
        assert planned[a_id].floor == result.matches["floors"][seen[s_id].floor]
        assert 0 < confidence <= 1
    # six drives: median 0.008 to 0.030, RMSE 0.026 to 0.098, nearly all of it the height on the stair, where hardly
    # anything level is seen; plan view 0.005 to 0.011
    apart = off(result.trajectory, drive.truth)
    error = np.linalg.norm(apart, axis=1)
    assert np.median(error) < 0.05 and np.sqrt(np.mean(error**2)) < 0.2
    assert np.sqrt(np.mean(np.sum(apart[:, :2] ** 2, axis=1))) < 0.02
    for deviation in result.deviations:
        if deviation["s_id"] is not None and deviation["a_id"] is not None:
            floor = result.s_graph.surface_by_id[deviation["s_id"]].floor
            assert bim.graph.surface_by_id[deviation["a_id"]].floor == result.matches["floors"][floor]


LEVEL = Config.model_validate({"tracking": {"mount": (0, 0, 0)}})  # a corridor as high as wide has no vertical


def corridor(rise: float, length: float) -> TriangleScene:
    """25 m long, with pillars, higher from 12 m on, after a ramp of so many metres or a step."""
    pillars: list[Box] = [(x, y, 0.0, x + 0.4, y + 0.4, 3.5) for x in range(2, 24, 3) for y in (-2.0, 1.6)]
    boxes = [*room(0.0, -2.0, 25.0, 2.0, height=3.5), *pillars, (12.0, -2.0, 0.0, 25.0, 2.0, rise)]
    a, b, c, d = (12.0 - length, -2.0, 0.0), (12.0, -2.0, rise), (12.0, 2.0, rise), (12.0 - length, 2.0, 0.0)
    return TriangleScene(np.concatenate([triangles_of(boxes), np.array([[a, b, c], [a, c, d]])]))


@pytest.mark.long
@pytest.mark.parametrize(("rise", "length"), [(0.15, 0.4), (0.5, 0.4), (0.4, 4.0)])
def test_a_step_or_a_ramp_within_a_storey_makes_no_floor(rise: float, length: float) -> None:
    scene, slam, truth = corridor(rise, length), SceneGraphSlam(config=LEVEL), []
    for k, x in enumerate(np.arange(3.0, 21.0, 0.1)):
        ground = rise * np.clip((x - 12.0 + length) / length, 0.0, 1.0)
        truth.append(0.8 + ground)
        slam.add_scan(10**8 * k, scan(scene, pose(x, 0.2, 0.8 + ground), SpinningSensor(azimuths=450), k))
    result = slam.finish()
    assert len(result.s_graph.floors) == 1
    assert result.s_graph.keyframes[-1].floor == "floor-0"
    risen = result.trajectory.positions[:, 2] - np.array(truth)[result.trajectory.stamps_ns // 10**8] + truth[0]
    assert np.abs(risen).mean() < 0.03  # over four seeds at most 0.01


def test_a_storey_that_there_is_not_is_refused(bim: Bim) -> None:
    assert floor_named(bim.graph, "upper FLOOR").name == UPPER
    with pytest.raises(UserError, match="storey attic: no such storey; there are: Ground floor, Upper floor"):
        SceneGraphSlam(bim, storey="attic")


def test_a_climb_that_the_plan_does_not_have_leaves_no_assignment(bim: Bim) -> None:
    upper = next(f for f in bim.graph.floors if f.name == UPPER)
    raised = replace(bim.graph, floors=tuple(replace(f, elevation=50.0) if f is upper else f for f in bim.graph.floors))
    assert assignments({0: 0.0, 1: 3.2}, raised.floors, None) == []
