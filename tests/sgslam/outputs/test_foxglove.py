"""A run as MCAP for Foxglove, read back by mcap's own reader."""

import base64
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import trimesh
from commands import called, refused
from drives import fed, small_drive, small_run

from data.common.errors import UserError
from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from sgslam.cli.export import export
from sgslam.export.foxglove import FILE, write_mcap
from sgslam.report import RunFolder
from sgslam.slam import SceneGraphSlam

pytest.importorskip("mcap", reason="mcap is not installed: pip install 'sgslam[foxglove]'")
MAP, PLAN, CLOUD, POSES, TRANSFORMS = "/map", "/plan", "/map/cloud", "/trajectory", "/tf"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an anchored run, in a building kilometres from zero, as `sgslam export` leaves it."""
    folder = tmp_path_factory.mktemp("out")
    small_run(with_bim=True)[1].save(folder)
    done = called("sgslam.cli.export", "--out", folder, "--format", "mcap", "ply")
    assert done.returncode == 0 and FILE in done.stdout, done.stderr
    return folder


def read(path: Path) -> Iterator[tuple[str, int, str, dict[str, Any]]]:
    """Topic, stamp, name of the schema and content of each message; each content is what its schema says."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None and (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            content, form = json.loads(message.data), json.loads(schema.data)
            jsonschema.validate(content, form)
            assert form["title"] == schema.name
            yield channel.topic, message.log_time, schema.name, content


def contents(path: Path, topic: str) -> list[dict[str, Any]]:
    return [content for name, _, _, content in read(path) if name == topic]


def pose_of(position: dict[str, float], orientation: dict[str, float]) -> Any:
    return xyzquat_to_poses(np.array([*position.values(), *orientation.values()]))


def placed(primitive: dict[str, Any]) -> Any:
    """(N, 3) the points of a line or of triangles, in the frame of their entity."""
    points = np.array([[point[axis] for axis in "xyz"] for point in primitive["points"]])
    return points + [primitive["pose"]["position"][axis] for axis in "xyz"]


def test_each_topic_has_foxgloves_schema(out: Path) -> None:
    found = {(topic, name) for topic, _, name, _ in read(out / FILE)}
    assert found == {
        (TRANSFORMS, "foxglove.FrameTransform"), (POSES, "foxglove.PoseInFrame"), (CLOUD, "foxglove.PointCloud"),
        (MAP, "foxglove.SceneUpdate"), (PLAN, "foxglove.SceneUpdate"),
    }  # fmt: skip


def test_poses_and_transforms_are_those_of_the_trajectory(out: Path) -> None:
    trajectory, run = Trajectory.read_tum(out / "trajectory.tum"), RunFolder.read(out)
    poses = contents(out / FILE, POSES)
    assert {pose["frame_id"] for pose in poses} == {"bim"}
    stamps = [pose["timestamp"]["sec"] * 10**9 + pose["timestamp"]["nsec"] for pose in poses]
    assert stamps == trajectory.stamps_ns.tolist() == [ns for topic, ns, *_ in read(out / FILE) if topic == POSES]
    np.testing.assert_allclose([pose_of(**p["pose"]) for p in poses], trajectory.poses, atol=1e-9)
    by_child: dict[str, list[Any]] = {}
    for told in contents(out / FILE, TRANSFORMS):
        by_child.setdefault(told["child_frame_id"], []).append(pose_of(told["translation"], told["rotation"]))
    np.testing.assert_allclose(by_child["sensor"], trajectory.poses, atol=1e-9)
    np.testing.assert_allclose(by_child["map"], [run.T_bim_map], atol=1e-9)


def test_the_cloud_is_that_of_the_other_formats(out: Path) -> None:
    (cloud,) = contents(out / FILE, CLOUD)
    points = np.frombuffer(base64.b64decode(cloud["data"]), "<f4").reshape(-1, cloud["point_stride"] // 4)
    points = points.astype(float) + list(cloud["pose"]["position"].values())
    np.testing.assert_allclose(points, trimesh.load(out / "map.ply").vertices, atol=1e-3)
    assert [field["name"] for field in cloud["fields"]] == ["x", "y", "z"]


def test_walls_and_rooms_of_map_and_plan_stand_where_they_are(out: Path) -> None:
    run = RunFolder.read(out)
    assert run.a_graph is not None
    ((map_scene,), (plan_scene,)) = (contents(out / FILE, topic) for topic in (MAP, PLAN))
    mapped, planned = ({e["id"]: e for e in scene["entities"]} for scene in (map_scene, plan_scene))
    s, a = run.s_graph, run.a_graph
    assert set(mapped) == {"path", *(w.id for w in s.wall_surfaces), *(r.id for r in s.rooms)}
    assert set(planned) == {*(w.id for w in a.wall_surfaces), *(r.id for r in a.rooms)}
    for wall in s.wall_surfaces:
        (drawn,) = mapped[wall.id]["triangles"]
        assert sorted(drawn["indices"]) == [0, 0, 1, 2, 2, 3]
        corners = run.corners(wall)
        np.testing.assert_allclose(placed(drawn), corners[[0, 1, 3, 2]], atol=1e-3)
    pairs = [(s_id, a_id) for s_id, a_id, _ in run.matches["wall_surfaces"]]
    assert pairs
    for s_id, a_id in pairs:
        assert {"key": "planned", "value": a_id} in mapped[s_id]["metadata"]
        middle = placed(mapped[s_id]["triangles"][0]).mean(axis=0)
        normal = a.surface_by_id[a_id].normal
        corners = placed(planned[a_id]["triangles"][0])
        assert abs((middle - corners[0])[:2] @ normal) < 0.05
    names = {e["texts"][0]["text"] for e in mapped.values() if e["texts"]}
    assert names and names <= {room.name for room in a.rooms}


def test_a_run_that_was_not_anchored_has_no_plan_and_is_in_the_maps_frame(tmp_path: Path) -> None:
    fed(SceneGraphSlam(), small_drive().scans[:40]).finish().save(tmp_path)
    export(tmp_path, ["mcap"])
    assert {topic for topic, *_ in read(tmp_path / FILE)} == {TRANSFORMS, POSES, CLOUD, MAP}
    assert {told["parent_frame_id"] for told in contents(tmp_path / FILE, TRANSFORMS)} == {"map"}


def test_what_cannot_be_written_is_told(out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = RunFolder.read(out)
    early = Trajectory(np.array([-1, 1]), np.tile(np.eye(4), (2, 1, 1)))
    for trajectory in (early, Trajectory(np.empty(0, np.int64), np.empty((0, 4, 4)))):
        with pytest.raises(UserError, match="no poses, or stamps before 1970"):
            write_mcap(tmp_path / FILE, run, trajectory, np.empty((0, 3)))
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    assert "pip install 'sgslam[foxglove]'" in refused("sgslam.cli.export", "--out", out, "--format", "mcap")
    assert not list(tmp_path.iterdir())
