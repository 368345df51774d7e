"""What a run leaves, in the forms of other programs: each is read back by a library that is not ours."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import evo.tools.file_interface as evo
import gtsam
import networkx
import numpy as np
import pytest
import shapely
import trimesh
from commands import refused
from drives import Drive, fed, small_drive, small_run

from data import Door, Floor, Keyframe, Room, SceneGraph, WallSurface
from data.common.errors import UserError
from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from data.trajectory.formats import write_euroc, write_kitti
from sgslam.backend import FactorLog, write_pose_graph
from sgslam.backend.factor_log import Entry
from sgslam.cli.export import export, main
from sgslam.export.dsg import dsg
from sgslam.export.graphml import graphml
from sgslam.mapping.cloud_map import VoxelMap
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report import RunFolder
from sgslam.slam import SceneGraphSlam

NAMES = [
    "map.ply", "report.pdf", *(["run.mcap"] if find_spec("mcap") else []), "scene_graph.graphml",
    "scene_graph_dsg.json", "trajectory.kitti", "trajectory_euroc.csv", "trajectory_times.txt",
]  # fmt: skip


def command(*words: object) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "sgslam.cli.export", *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return small_drive()


@pytest.fixture(scope="module")
def out(drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an anchored run in a building kilometres from zero, with all that is exported without its model."""
    folder = tmp_path_factory.mktemp("out") / "run"
    small_run(with_bim=True)[1].save(folder)
    before = {path.name for path in folder.iterdir()}
    done = command("--out", folder, "--format", "all")
    assert done.returncode == 0, done.stderr
    assert sorted({path.name for path in folder.iterdir()} - before) == NAMES
    assert all(name in done.stdout for name in [*NAMES, "pose_graph.g2o"])
    return folder


def test_trajectories_are_those_that_evo_reads(out: Path) -> None:
    written = Trajectory.read_tum(out / "trajectory.tum")
    kitti = evo.read_kitti_poses_file(str(out / "trajectory.kitti"))
    np.testing.assert_allclose(kitti.poses_se3, written.poses, atol=1e-9)
    times = np.loadtxt(out / "trajectory_times.txt")
    np.testing.assert_allclose(times, written.stamps_ns / 1e9, rtol=0, atol=1e-6)
    euroc = evo.read_euroc_csv_trajectory(str(out / "trajectory_euroc.csv"))
    np.testing.assert_allclose(euroc.poses_se3, written.poses, atol=1e-9)
    np.testing.assert_allclose(euroc.timestamps, written.stamps_ns / 1e9, atol=1e-6)


def test_stamps_of_today_keep_their_nanoseconds(tmp_path: Path) -> None:
    stamps = np.array([1_763_730_000_123_456_789, 1_763_730_000_223_456_790])
    trajectory = Trajectory(stamps, np.tile(np.eye(4), (2, 1, 1)))
    write_euroc(trajectory, tmp_path / "e")
    assert [int(line.split(",")[0]) for line in (tmp_path / "e").read_text().splitlines()[1:]] == stamps.tolist()
    write_kitti(trajectory, tmp_path / "k", tmp_path / "t")
    assert (tmp_path / "t").read_text().split() == ["1763730000.123456789", "1763730000.223456790"]


def test_the_point_cloud_map_lies_on_the_planned_walls(drive: Drive, out: Path) -> None:
    points = np.asarray(trimesh.load(out / "map.ply").vertices)
    assert len(points) > 3000
    assert len(np.unique(np.floor(points / 0.01).astype(int), axis=0)) > 0.95 * len(points)
    high = points[(points[:, 2] > 44.0) & (points[:, 2] < 45.0)]  # of the storey's 43 m to 46 m
    away = np.full(len(high), np.inf)
    for wall in drive.bim.graph.wall_surfaces:
        offset = (high[:, :2] - wall.centroid) @ wall.normal
        along = (high[:, :2] - wall.centroid) @ [-wall.normal[1], wall.normal[0]]
        on = np.abs(along) < (wall.length or 0.0) / 2 + 0.1
        away[on] = np.minimum(away[on], np.abs(offset[on]))
    assert np.median(away) < 0.02 and np.mean(away < 0.1) > 0.8


def test_a_coarser_map_has_fewer_points_and_other_settings_are_refused(out: Path) -> None:
    fine = len(trimesh.load(out / "map.ply").vertices)
    export(out, ["ply"], voxel=0.2)
    assert len(trimesh.load(out / "map.ply").vertices) < 0.6 * fine
    for words, message in (("ply --voxel nan", "--voxel nan"), ("ifc", "--bim")):
        with pytest.raises(UserError, match=message):
            main(["--out", str(out), "--format", *words.split()])
    assert "'obj'" in refused("sgslam.cli.export", "--out", out, "--format", "obj")


def test_points_of_a_voxel_become_their_mean() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-3.0, 3.0, (4000, 3)) + np.array([500_000.0, 4_000_000.0, 100.0])
    grown = VoxelMap(1.0, points[0].round())
    for part in np.array_split(points, 7):
        grown.add(part)
        if len(part) % 2:
            grown.points()  # asking in between changes nothing
    cells = np.floor(points - points[0].round()).astype(int)
    means = [points[(cells == cell).all(axis=1)].mean(axis=0) for cell in np.unique(cells, axis=0)]
    np.testing.assert_allclose(grown.points(), means, atol=1e-6)


def test_spark_dsg_loads_the_scene_graph(drive: Drive, out: Path) -> None:
    spark_dsg = pytest.importorskip("spark_dsg", reason="spark-dsg has no wheel for this machine")
    loaded = spark_dsg.DynamicSceneGraph.load(str(out / "scene_graph_dsg.json"))
    run = RunFolder.read(out)
    s = run.s_graph
    counts = {name: loaded.get_layer(name).num_nodes() for name in ("ROOMS", "FLOORS", "BUILDINGS", "OBJECTS")}
    objects = len(s.wall_surfaces) + len(s.doors)
    assert counts == {"ROOMS": len(s.rooms), "FLOORS": 1, "BUILDINGS": 1, "OBJECTS": objects}
    assert loaded.get_layer(2, "a").num_nodes() == len(s.keyframes)
    labels = loaded.get_labelspace(2, 0)
    for node in loaded.get_layer("OBJECTS").nodes:
        identity = node.attributes.metadata.get()["id"]
        assert labels.get_category(node.attributes.semantic_label) == ("door" if identity[0] == "d" else "wall")
        room = s.surface_by_id[identity].room if identity in s.surface_by_id else None
        if room is not None:
            above = loaded.get_node(node.get_parent()).attributes
            assert above.metadata.get()["id"] == room
            assert above.name in drive.names.values()
    wall = max(s.wall_surfaces, key=lambda w: w.length or 0.0)
    (found,) = (n for n in loaded.get_layer("OBJECTS").nodes if n.attributes.metadata.get()["id"] == wall.id)
    box, corners = found.attributes.bounding_box, run.corners(wall)
    np.testing.assert_allclose(box.world_P_center, corners.mean(axis=0), rtol=1e-6)
    assert sorted(box.dimensions)[::-1] == pytest.approx([wall.length, np.ptp(corners[:, 2]), 0.0], rel=1e-2)
    middle = np.linalg.inv(box.world_R_center) @ (corners - corners.mean(axis=0)).T
    assert np.abs(middle).max(axis=1) == pytest.approx(np.array(box.dimensions) / 2, abs=0.02)
    agents = sorted(loaded.get_layer(2, "a").nodes, key=lambda n: n.attributes.metadata.get()["id"][1:].zfill(5))
    assert len(agents[1].siblings()) == 2
    positions = [node.attributes.position for node in agents]
    np.testing.assert_allclose(positions, run.keyframe_poses[:, :3, 3], rtol=1e-12)


def test_networkx_loads_the_scene_graph(drive: Drive, out: Path) -> None:
    loaded, run = networkx.read_graphml(out / "scene_graph.graphml"), RunFolder.read(out)
    kinds = networkx.get_node_attributes(loaded, "kind")
    counts = {kind: list(kinds.values()).count(kind) for kind in set(kinds.values())}
    s = run.s_graph
    assert counts == {
        "floor": 1, "room": len(s.rooms), "wall_surface": len(s.wall_surfaces), "door": len(s.doors),
        "keyframe": len(s.keyframes),
    }  # fmt: skip
    assert networkx.is_connected(loaded)
    for wall in s.wall_surfaces:
        facing = [n for n in loaded[wall.id] if loaded[wall.id][n]["kind"] == "faces"]
        assert facing == ([] if wall.room is None else [wall.room])
    # rooms, or parts of them, stand where the plan has those that they were matched to, and bear their names
    planned = {room.name: room for room in drive.bim.graph.rooms}
    for room in s.rooms:
        node = loaded.nodes[room.id]
        assert shapely.contains_xy(shapely.Polygon(planned[node["name"]].polygon), node["x"], node["y"])
        assert np.array(json.loads(node["polygon"])).shape[1] == 3


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("metrics.json", "[]", "no run's folder"), ("metrics.json", '{"T_bim_map": [0, 0, 0]}', "no run's folder"),
        ("matches.json", "[]", "no run's folder"), ("deviations.json", "\x00", "no run's folder"),
        ("s_graph.json", "{", "s_graph.json"), ("trajectory.tum", "1 2 3\n", "trajectory.tum, line 1"),
        ("keyframe_clouds.bin", "SGKC", "keyframe_clouds.bin"), ("config.yaml", "clouds: [", "config.yaml"),
    ],
)  # fmt: skip
def test_damaged_files_are_told_by_their_name(out: Path, tmp_path: Path, name: str, content: str, message: str) -> None:
    for path in out.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / name).unlink()
    (tmp_path / name).write_text(content)
    with pytest.raises(UserError, match=message):
        export(tmp_path, ["kitti", "ply"])


def test_a_keyframe_without_a_pose_is_told(out: Path, tmp_path: Path) -> None:
    for path in out.glob("*.json"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    graph = json.loads((tmp_path / "s_graph.json").read_text())
    graph["keyframes"][1]["pose"] = [0.0] * 7
    (tmp_path / "s_graph.json").write_text(json.dumps(graph))
    with pytest.raises(UserError, match=r"s_graph.json: a keyframe's pose"):
        RunFolder.read(tmp_path)


def test_storeys_stairs_and_names_of_any_letters(tmp_path: Path) -> None:
    spark_dsg = pytest.importorskip("spark_dsg", reason="spark-dsg has no wheel for this machine")
    floors = (Floor("floor-0", "Erdgeschoß", 0.0), Floor("floor-1", "1 <\x01>", 3.0))
    rooms = tuple(Room(f"r{i}", (float(i), 0.0), f"floor-{i}", f"{i}\x0b & 部屋") for i in range(2))
    walls = (WallSurface("w0", None, (0.0, 1.0), (0.0, 1.0)), WallSurface("w1", "r1", (1.0, 0.0), (1.0, 0.0), 2.0))
    doors = (Door("d0", ("r0",), (0.5, 0.0)), Door("d1", (), (9.0, 9.0)), Door("d2", ("r0", "r1"), (0.0, 0.0)))
    keyframes = (
        Keyframe("k0", 0, (0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0), "floor-0", "r0", ("w0",)),
        Keyframe("k1", 1, (0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0)),  # on the stair
    )
    s = SceneGraph("map", rooms, walls, doors, floors, keyframes)
    run = RunFolder(tmp_path, s, None, None, {}, [])
    (tmp_path / "g").write_bytes(graphml(run))
    read = networkx.read_graphml(tmp_path / "g")
    assert set(read) == {"floor-0", "floor-1", "r0", "r1", "w0", "w1", "d0", "d1", "d2", "k0", "k1"}
    assert read.nodes["r1"]["name"] == "1 & 部屋" and read.nodes["r1"]["z"] == 3.0
    assert read.nodes["floor-1"]["name"] == "1 <>"
    (tmp_path / "d.json").write_text(json.dumps(dsg(run)))
    loaded = spark_dsg.DynamicSceneGraph.load(str(tmp_path / "d.json"))
    above = {
        node.attributes.metadata.get()["id"]: loaded.get_node(node.get_parent()).attributes.metadata.get().get("id")
        for node in loaded.nodes if node.has_parent()
    }  # fmt: skip
    assert above == {
        "floor-0": None, "floor-1": None, "r0": "floor-0", "r1": "floor-1", "w0": None, "w1": "r1", "d0": "r0",
        "d1": None, "d2": "r0", "k0": "r0", "k1": None,
    }  # fmt: skip


def test_gtsam_loads_the_pose_graph(out: Path) -> None:
    graph, values = gtsam.readG2o(str(out / "pose_graph.g2o"), True)
    run = RunFolder.read(out)
    assert values.size() == len(run.s_graph.keyframes) and graph.size() >= values.size() - 1  # and loops
    poses = np.stack([values.atPose3(i).matrix() for i in range(values.size())])
    np.testing.assert_allclose(poses, run.keyframe_poses, atol=1e-6)
    for i in range(graph.size()):
        factor = graph.at(i)
        first, second = factor.keys()
        step = np.linalg.inv(poses[first]) @ poses[second]
        np.testing.assert_allclose(factor.measured().matrix(), step, atol=0.1)


def test_information_is_in_the_order_and_the_units_of_g2o(tmp_path: Path) -> None:
    # rotation first, in radians; g2o has translation first, and half the angle
    covariance = np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]) ** 2
    robust = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Huber.Create(1.3), gtsam.noiseModel.Gaussian.Covariance(covariance)
    )
    log, x = FactorLog(), [gtsam.symbol("x", i) for i in range(2)]
    turn = gtsam.Pose3(gtsam.Rot3.Rz(0.5), np.array([1.0, 2.0, 3.0]))
    log.add(2, "odometry", (1,), Entry(gtsam.BetweenFactorPose3(*x, turn, robust), "test", "test"))
    log.add(2, "start", (0,), Entry(gtsam.PriorFactorPose3(x[0], turn, robust), "test", "test"))
    assert write_pose_graph(tmp_path / "g", log, np.tile(np.eye(4), (2, 1, 1))) == 1
    line = (tmp_path / "g").read_text().splitlines()[2].split()
    assert line[:3] == ["EDGE_SE3:QUAT", "0", "1"]
    np.testing.assert_allclose(xyzquat_to_poses([float(word) for word in line[3:10]]), turn.matrix(), atol=1e-12)
    upper = np.zeros((6, 6))
    upper[np.triu_indices(6)] = [float(word) for word in line[10:]]
    sigmas = np.array([0.1, 0.2, 0.3, 0.01 / 2, 0.02 / 2, 0.03 / 2])
    np.testing.assert_allclose(upper, np.diag(1 / sigmas**2), rtol=1e-9, atol=1e-9)


def test_a_run_that_was_not_anchored_is_exported_in_the_maps_frame(drive: Drive, tmp_path: Path) -> None:
    fed(SceneGraphSlam(), drive.scans[:40]).finish().save(tmp_path)
    export(tmp_path, ["all"], Path("x.ifc"))
    assert np.abs(trimesh.load(tmp_path / "map.ply").vertices).max() < 30.0
    assert networkx.read_graphml(tmp_path / "scene_graph.graphml").graph["frame"] == "map"
    (tmp_path / CLOUDS).unlink()
    with pytest.raises(UserError, match=CLOUDS):
        export(tmp_path, ["ply"])
    with pytest.raises(UserError, match="not anchored"):
        export(tmp_path, ["ifc"], Path("x.ifc"))
