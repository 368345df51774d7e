"""Several storeys in one run: floors of the map, and which storeys of the plan they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import off

from data import SceneGraph
from data.generation import DEMO_STOREYS, write_demo_building
from data.plans import Bim, load_bim
from data.scans import ScanFolder
from data.simulation import Robot, Sensor, SimulatedRun
from data.simulation.carriers import WHEELED
from data.simulation.simulate import simulate
from sgslam.result import Result
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
    sensor = Sensor(azimuths=450)
    carrier = replace(WHEELED, robot=Robot(yaw_rate=1.2, yaw_acceleration=2.0))
    storeys = (GROUND, UPPER, GROUND)
    return simulate(building, storeys, building.parent / "drive", 1, 1, 6.0, sensor, carrier)


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
