"""What a run leaves, in the forms of other programs: each is read back by a library that is not ours."""

import base64
import json
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import evo.tools.file_interface as evo
import gtsam
import jsonschema
import networkx
import numpy as np
import pytest
import trimesh
from commands import called, refused
from drives import fed, small_drive
from shared_runs import written_once

from data import Door, Floor, Keyframe, Room, SceneGraph, WallSurface
from data.common.errors import UserError
from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from data.trajectory.formats import write_euroc, write_kitti
from sgslam.backend import FactorLog, write_pose_graph
from sgslam.backend.factor_log import Entry
from sgslam.cli.export import export
from sgslam.export.dsg import dsg
from sgslam.export.foxglove import FILE as MCAP
from sgslam.export.foxglove import write_mcap
from sgslam.export.graphml import graphml
from sgslam.mapping.cloud_map import VoxelMap
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report import RunFolder
from sgslam.slam import SceneGraphSlam

NAMES = {
    *("map.ply", "report.pdf", "scene_graph.graphml", "scene_graph_dsg.json"),
    *("trajectory.kitti", "trajectory_euroc.csv", "trajectory_times.txt"),
    *([MCAP] if find_spec("mcap") else []),
}
needs_mcap = pytest.mark.skipif(find_spec("mcap") is None, reason="mcap is not installed")


@pytest.fixture(scope="session")
def out(anchored_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The anchored run's folder, with all that is exported without its model."""

    def write(folder: Path) -> None:
        for path in (anchored_run / "out").iterdir():
            (folder / path.name).symlink_to(path)
        before = {path.name for path in folder.iterdir()}
        done = called("sgslam.cli.export", "--out", folder, "--format", "all")
        assert done.returncode == 0, done.stderr
        assert {path.name for path in folder.iterdir()} - before == NAMES
        assert all(name in done.stdout for name in [*NAMES, "pose_graph.g2o"])

    return written_once(tmp_path_factory, "exported_run", write)


@pytest.fixture(scope="module")
def map_only(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short run without a plan."""
    folder = tmp_path_factory.mktemp("map_only")
    fed(SceneGraphSlam(), small_drive().scans[:40]).finish().save(folder)
    return folder


def test_trajectories_are_those_that_evo_reads(out: Path) -> None:
    written = Trajectory.read_tum(out / "trajectory.tum")
    kitti = evo.read_kitti_poses_file(str(out / "trajectory.kitti"))
    euroc = evo.read_euroc_csv_trajectory(str(out / "trajectory_euroc.csv"))
    for read in (kitti, euroc):
        np.testing.assert_allclose(read.poses_se3, written.poses, atol=1e-9)
    for times in (np.loadtxt(out / "trajectory_times.txt"), euroc.timestamps):
        np.testing.assert_allclose(times, written.stamps_ns / 1e9, rtol=0, atol=1e-6)


def test_stamps_of_today_keep_their_nanoseconds(tmp_path: Path) -> None:
    stamps = np.array([1_763_730_000_123_456_789, 1_763_730_000_223_456_790])
    trajectory = Trajectory(stamps, np.tile(np.eye(4), (2, 1, 1)))
    write_euroc(trajectory, tmp_path / "euroc")
    write_kitti(trajectory, tmp_path / "kitti", tmp_path / "times")
    lines = [line for line in (tmp_path / "euroc").read_text().splitlines() if not line.startswith("#")]
    assert [int(line.split(",")[0]) for line in lines] == stamps.tolist()
    seconds = (tmp_path / "times").read_text().split()
    assert [int(word.replace(".", "").ljust(19, "0")) for word in seconds] == stamps.tolist()


def test_the_cloud_lies_on_the_buildings_walls(out: Path) -> None:
    points = np.asarray(trimesh.load(out / "map.ply").vertices)
    run = RunFolder.read(out)
    assert run.a_graph is not None and len(points) > 1000
    planes = np.array([(*w.normal, -np.dot(w.normal, w.centroid)) for w in run.a_graph.wall_surfaces])
    near = np.abs(points[:, :2] @ planes[:, :2].T + planes[:, 2]).min(axis=1) < 0.05
    assert near.mean() > 0.5


def test_points_of_a_voxel_become_their_mean() -> None:
    origin = np.array([500_000.0, 4_000_000.0, 100.0])
    points = origin + np.random.default_rng(0).uniform(-3.0, 3.0, (4000, 3))
    grown = VoxelMap(1.0, origin)
    for part in np.array_split(points, 7):
        grown.add(part)
        grown.points()  # asking in between changes nothing
    cells = np.floor(points - origin).astype(int)
    means = [points[(cells == cell).all(axis=1)].mean(axis=0) for cell in np.unique(cells, axis=0)]
    np.testing.assert_allclose(grown.points(), means, atol=1e-6)


def test_spark_dsg_loads_the_scene_graph(out: Path) -> None:
    spark_dsg = pytest.importorskip("spark_dsg", reason="spark-dsg has no wheel for this machine")
    loaded, run = spark_dsg.DynamicSceneGraph.load(str(out / "scene_graph_dsg.json")), RunFolder.read(out)
    s, named = run.s_graph, {}
    for node in loaded.nodes:
        named[node.attributes.metadata.get().get("id")] = node
    assert {own.id for own in (*s.rooms, *s.wall_surfaces, *s.doors, *s.floors, *s.keyframes)} <= named.keys()
    for wall in s.wall_surfaces:
        parent = named[wall.id].get_parent() if named[wall.id].has_parent() else None
        above = loaded.get_node(parent).attributes.metadata.get().get("id") if parent is not None else None
        assert above == wall.room
        box, corners = named[wall.id].attributes.bounding_box, run.corners(wall)
        np.testing.assert_allclose(box.world_P_center, corners.mean(axis=0), rtol=1e-6)
    for keyframe, T in zip(s.keyframes, run.keyframe_poses, strict=True):
        np.testing.assert_allclose(named[keyframe.id].attributes.position, T[:3, 3], rtol=1e-12)


def test_networkx_loads_the_scene_graph(out: Path) -> None:
    loaded, run = networkx.read_graphml(out / "scene_graph.graphml"), RunFolder.read(out)
    s = run.s_graph
    assert run.a_graph is not None and networkx.is_connected(loaded)
    assert set(loaded) == {own.id for own in (*s.rooms, *s.wall_surfaces, *s.doors, *s.floors, *s.keyframes)}
    for wall in s.wall_surfaces:
        facing = [n for n in loaded[wall.id] if loaded[wall.id][n]["kind"] == "faces"]
        assert facing == ([] if wall.room is None else [wall.room])
    matched = {s_id: a_id for s_id, a_id, _ in run.matches["rooms"]}
    for room in s.rooms:
        if room.id in matched:
            assert loaded.nodes[room.id]["name"] == run.a_graph.room_by_id[matched[room.id]].name


def test_storeys_stairs_and_names_of_any_letters(tmp_path: Path) -> None:
    floors = (Floor("floor-0", "Erdgeschoß", 0.0), Floor("floor-1", "1 <\x01>", 3.0))
    rooms = tuple(Room(f"r{i}", (float(i), 0.0), f"floor-{i}", f"{i}\x0b & 部屋") for i in range(2))
    walls = (WallSurface("w0", None, (0.0, 1.0), (0.0, 1.0)), WallSurface("w1", "r1", (1.0, 0.0), (1.0, 0.0), 2.0))
    doors = (Door("d0", ("r0",), (0.5, 0.0)), Door("d1", (), (9.0, 9.0)), Door("d2", ("r0", "r1"), (0.0, 0.0)))
    keyframes = (
        Keyframe("k0", 0, (0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0), "floor-0", "r0", ("w0",)),
        Keyframe("k1", 1, (0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0)),  # on the stair
    )
    run = RunFolder(tmp_path, SceneGraph("map", rooms, walls, doors, floors, keyframes), None, None, {}, [])
    (tmp_path / "g").write_bytes(graphml(run))
    read = networkx.read_graphml(tmp_path / "g")
    assert set(read) == {"floor-0", "floor-1", "r0", "r1", "w0", "w1", "d0", "d1", "d2", "k0", "k1"}
    assert read.nodes["r1"]["name"] == "1 & 部屋" and read.nodes["floor-1"]["name"] == "1 <>"
    spark_dsg = pytest.importorskip("spark_dsg", reason="spark-dsg has no wheel for this machine")
    (tmp_path / "d.json").write_text(json.dumps(dsg(run)))
    loaded = spark_dsg.DynamicSceneGraph.load(str(tmp_path / "d.json"))
    above = {
        node.attributes.metadata.get()["id"]: loaded.get_node(node.get_parent()).attributes.metadata.get().get("id")
        for node in loaded.nodes
        if node.has_parent()
    }
    inside = {"r0": "floor-0", "r1": "floor-1", "w1": "r1", "d0": "r0", "d2": "r0", "k0": "r0"}
    assert above == dict.fromkeys(("floor-0", "floor-1", "w0", "d1", "k1")) | inside


def test_gtsam_loads_the_pose_graph(out: Path) -> None:
    graph, values = gtsam.readG2o(str(out / "pose_graph.g2o"), True)
    run = RunFolder.read(out)
    assert values.size() == len(run.s_graph.keyframes) and graph.size() >= values.size() - 1  # and loops
    poses = np.stack([values.atPose3(i).matrix() for i in range(values.size())])
    np.testing.assert_allclose(poses, run.keyframe_poses, atol=1e-6)
    for i in range(graph.size()):
        first, second = graph.at(i).keys()
        step = np.linalg.inv(poses[first]) @ poses[second]
        np.testing.assert_allclose(graph.at(i).measured().matrix(), step, atol=0.1)


def test_information_is_in_the_order_and_the_units_of_g2o(tmp_path: Path) -> None:
    # rotation first, in radians; g2o has translation first, and half the angle
    covariance = np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]) ** 2
    huber = gtsam.noiseModel.mEstimator.Huber.Create(1.3)
    robust = gtsam.noiseModel.Robust.Create(huber, gtsam.noiseModel.Gaussian.Covariance(covariance))
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


def messages(path: Path) -> Iterator[tuple[str, int, dict[str, Any]]]:
    """Topic, stamp and content of each message; each content is what its schema says."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None and (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            content = json.loads(message.data)
            jsonschema.validate(content, json.loads(schema.data))
            yield channel.topic, message.log_time, content


def placed(primitive: dict[str, Any]) -> Any:
    """(N, 3) the points of a line or of triangles, in the frame of their entity."""
    points = np.array([[point[axis] for axis in "xyz"] for point in primitive["points"]])
    return points + [primitive["pose"]["position"][axis] for axis in "xyz"]


@needs_mcap
def test_foxglove_shows_poses_cloud_walls_and_rooms_where_they_are(out: Path) -> None:
    trajectory, run = Trajectory.read_tum(out / "trajectory.tum"), RunFolder.read(out)
    told: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    for topic, stamp, content in messages(out / MCAP):
        told.setdefault(topic, []).append((stamp, content))
    assert told.keys() == {"/tf", "/trajectory", "/map/cloud", "/map", "/plan"}
    assert [stamp for stamp, _ in told["/trajectory"]] == trajectory.stamps_ns.tolist()
    assert {pose["frame_id"] for _, pose in told["/trajectory"]} == {"bim"}
    sevens = [[*p["pose"]["position"].values(), *p["pose"]["orientation"].values()] for _, p in told["/trajectory"]]
    np.testing.assert_allclose(xyzquat_to_poses(np.array(sevens)), trajectory.poses, atol=1e-9)
    ((_, cloud),) = told["/map/cloud"]
    points = np.frombuffer(base64.b64decode(cloud["data"]), "<f4").reshape(-1, cloud["point_stride"] // 4)
    points = points.astype(float) + list(cloud["pose"]["position"].values())
    np.testing.assert_allclose(points, trimesh.load(out / "map.ply").vertices, atol=1e-3)
    s, a = run.s_graph, run.a_graph
    assert a is not None
    mapped, planned = ({e["id"]: e for e in told[topic][0][1]["entities"]} for topic in ("/map", "/plan"))
    assert mapped.keys() == {"path", *(w.id for w in s.wall_surfaces), *(r.id for r in s.rooms)}
    assert planned.keys() == {*(w.id for w in a.wall_surfaces), *(r.id for r in a.rooms)}
    for wall in s.wall_surfaces:
        (drawn,) = mapped[wall.id]["triangles"]
        np.testing.assert_allclose(placed(drawn), run.corners(wall)[[0, 1, 3, 2]], atol=1e-3)
    for s_id, a_id, _ in run.matches["wall_surfaces"]:
        assert {"key": "planned", "value": a_id} in mapped[s_id]["metadata"]


@needs_mcap
def test_of_a_run_that_was_not_anchored_all_is_in_the_maps_frame(map_only: Path, tmp_path: Path) -> None:
    for path in map_only.iterdir():
        (tmp_path / path.name).symlink_to(path)
    export(tmp_path, ["all"], Path("x.ifc"))
    assert np.abs(trimesh.load(tmp_path / "map.ply").vertices).max() < 30.0
    assert networkx.read_graphml(tmp_path / "scene_graph.graphml").graph["frame"] == "map"
    frames = {content["parent_frame_id"] for topic, _, content in messages(tmp_path / MCAP) if topic == "/tf"}
    assert frames == {"map"}
    run = RunFolder.read(tmp_path)
    early = Trajectory(np.array([-1, 1]), np.tile(np.eye(4), (2, 1, 1)))
    for trajectory in (early, early.only(np.zeros(2, bool))):
        with pytest.raises(UserError, match="no poses, or stamps before 1970"):
            write_mcap(tmp_path / "early.mcap", run, trajectory, np.empty((0, 3)))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("metrics.json", "[]", "no run's folder"),
        ("metrics.json", '{"T_bim_map": [0, 0, 0]}', "no run's folder"),
        ("matches.json", "[]", "no run's folder"),
        ("deviations.json", "\x00", "no run's folder"),
        ("s_graph.json", "{", "s_graph.json"),
        ("trajectory.tum", "1 2 3\n", "trajectory.tum, line 1"),
        (CLOUDS, "SGKC", CLOUDS),
        (CLOUDS, None, CLOUDS),
        ("config.yaml", "clouds: [", "config.yaml"),
        ("pose_graph.g2o", None, "pose_graph.g2o is missing"),
        ("metrics.json", '{"T_bim_map": null}', "was not anchored"),
    ],
)
def test_damaged_folders_are_refused(map_only: Path, tmp_path: Path, name: str, content: str, message: str) -> None:
    for path in map_only.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / name).unlink()
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(UserError, match=message):
        export(tmp_path, ["kitti", "ply", "g2o", "ifc"], tmp_path / "x.ifc")


def test_what_cannot_be_exported_is_told(map_only: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("sgslam.cli.export", "--out", map_only, "--format")
    assert "--bim" in refused(*words, "ifc") and "--voxel" in refused(*words, "ply", "--voxel", "0")
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    assert "pip install 'sgslam[foxglove]'" in refused(*words, "mcap")
