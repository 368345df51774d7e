"""A building's mesh as an A-graph, and a drive in it; sections of bodies that are not closed."""

from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from commands import called

from data.common.errors import UserError
from data.generation.buildings import generate_plan
from data.generation.level_building import HEIGHT, plan_triangles, write_plan_mesh
from data.plans.mesh_plan import read_mesh
from data.scans.formats import read_points
from data.scene_graph import Room, SceneGraph
from data.simulation import Changes, Sensor
from data.simulation.simulate import simulate

BOXES = (  # two rooms of 4 x 4 m side by side and a doorway between them, under a lintel; a hole at the floor's edge
    (-0.2, -0.2, -0.2, 8.4, 4.2, 0.0), (-0.2, -0.2, 0.0, 8.4, 0.0, 2.6), (-0.2, 4.0, 0.0, 8.4, 4.2, 2.6),
    (-0.2, 0.0, 0.0, 0.0, 4.0, 2.6), (8.2, 0.0, 0.0, 8.4, 1.5, 2.6), (8.2, 2.5, 0.0, 8.4, 4.0, 2.6),
    (4.0, 0.0, 0.0, 4.2, 1.5, 2.6), (4.0, 2.5, 0.0, 4.2, 4.0, 2.6), (4.0, 1.5, 2.1, 4.2, 2.5, 2.6),
)  # fmt: skip


def two_rooms(height: float = 0.0) -> trimesh.Trimesh:
    boxes = [trimesh.creation.box(bounds=np.reshape(b, (2, 3)) + np.array([0.0, 0.0, height])) for b in BOXES]
    return trimesh.util.concatenate(boxes)


@pytest.fixture(scope="module")
def stl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mesh") / "rooms.stl"
    two_rooms().export(path)
    return path


def test_rooms_walls_and_door_of_a_mesh(stl: Path) -> None:
    graph = read_mesh(stl).graph
    assert [f.elevation for f in graph.floors] == [0.0]
    centroids = np.array([r.centroid for r in graph.rooms])
    np.testing.assert_allclose(centroids[0], [2.0, 2.0], atol=0.01)
    np.testing.assert_allclose(centroids[1], [6.2, 2.0], atol=0.15)  # reaches through the hole to the floor's edge
    assert [len(graph.surfaces_of_room[r.id]) for r in graph.rooms] == [4, 4]
    west = next(w for w in graph.surfaces_of_room[graph.rooms[0].id] if w.normal[0] > 0.9)
    np.testing.assert_allclose([*west.centroid, west.length], [0.0, 2.0, 4.0], atol=1e-3)
    assert west.plane is not None and np.allclose(np.array(west.plane) @ [0.0, 1.0, 1.0, 1.0], 0.0, atol=1e-3)
    inner = [d for d in graph.doors if len(d.rooms) == 2]
    assert len(inner) == 1 and np.allclose(inner[0].centroid, [4.1, 2.0], atol=0.01)


def test_two_storeys_are_separated(tmp_path: Path) -> None:
    both = trimesh.util.concatenate([two_rooms(), two_rooms(3.0)])
    both.export(tmp_path / "tower.stl")
    graph = read_mesh(tmp_path / "tower.stl").graph
    assert [f.elevation for f in graph.floors] == [0.0, 3.0]
    assert [len(graph.on_floor(f.id).rooms) for f in graph.floors] == [2, 2]
    assert max(w.height[1] for w in graph.on_floor(graph.floors[0].id).wall_surfaces if w.height) < 3.0


def test_a_generated_building_is_read_as_it_was_drawn(tmp_path: Path) -> None:
    drawn = generate_plan("skewed", 1).graph
    write_plan_mesh(drawn, tmp_path / "building.stl")
    read = read_mesh(tmp_path / "building.stl").graph
    outlines = [shapely.Polygon(room.polygon) for room in drawn.rooms if room.polygon]
    assert len(read.rooms) == len(outlines)
    assert all(any(own.contains(shapely.Point(room.centroid)) for room in read.rooms) for own in outlines)
    inner = [door for door in drawn.doors if len(door.rooms) == 2]
    assert len(read.doors) == pytest.approx(len(inner), abs=1)
    assert all(wall.height == pytest.approx((0.0, HEIGHT)) for wall in read.wall_surfaces if wall.room)
    levels = [(v.room, v.is_floor, v.height(*v.polygon[0])) for v in read.level_surfaces]
    assert len(levels) == 2 * len(read.rooms) and {room for room, _, _ in levels} == set(read.room_by_id)
    assert all(z == pytest.approx(0.0 if is_floor else HEIGHT, abs=1e-6) for _, is_floor, z in levels)
    with pytest.raises(UserError, match="without rooms"):
        plan_triangles(SceneGraph("bim", (Room("r", (0.0, 0.0)),), ()))


def test_a_robot_drives_and_scans_in_the_mesh_and_a_command_reads_it(stl: Path, tmp_path: Path) -> None:
    sensor = Sensor(azimuths=120, rate=5.0, range_noise=0.0)
    run = simulate(stl, "", tmp_path / "run", seed=1, min_length=15.0, sensor=sensor)
    assert run.rooms_entered == 2 and np.allclose(run.truth.positions[:, 2], 0.8)
    T = run.truth.poses[0]
    points = read_points(tmp_path / "run" / "scans" / "000000.bin") @ T[:3, :3].T + T[:3, 3]
    assert np.abs(trimesh.proximity.closest_point_naive(two_rooms(), points)[1]).max() < 0.01
    for changes in (Changes(moved=0.3), Changes(openings_displaced=0.3), Changes(columns_absent=0.3)):
        with pytest.raises(UserError, match="no single walls, openings or columns"):
            simulate(stl, "", tmp_path / "moved", changes=changes)
    with pytest.raises(UserError, match=r"no level 'attic'.*level 0\.00"):
        simulate(stl, "attic", tmp_path / "attic")
    done = called("data.plans.mesh_plan", "--mesh", stl, "--out", tmp_path / "a.json")
    assert done.returncode == 0 and "2 rooms" in done.stdout, done.stderr
    assert len(SceneGraph.load(tmp_path / "a.json").rooms) == 2
