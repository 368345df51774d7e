"""Walls, floors and ceilings of scans cast in rooms that are known exactly, by sensors of many kinds."""

import numpy as np
import pytest
from boxes import Array, Box, pose, room, scan, scene_of
from walks import HERE, surfels_of

from data.simulation import Sensor
from sgslam.config import BackendSettings, Config, SurfaceSettings
from sgslam.geometry.frames import transform_planes
from sgslam.perception import (
    LevelObservation,
    WallObservation,
    extract_levels,
    extract_walls,
    keyframe_scan,
    sort_into_columns,
)
from sgslam.perception.column_scan import contour
from sgslam.perception.gravity import refined_up
from sgslam.perception.keyframe_scan import KeyframeScan
from sgslam.perception.level_extraction import CELL
from sgslam.surfels import SurfelMap

ROOM = (-3.0, -2.0, 4.0, 2.5)  # lowest x y, highest x y
PLANES = np.array([[1, 0, 0, 3.0], [-1, 0, 0, 4.0], [0, 1, 0, 2.0], [0, -1, 0, 2.5]])
LARGE = room(-5, -5, 5, 5)
WIDE = Sensor(beams=32, lowest_deg=-45, highest_deg=45)  # sees floor and ceiling close by
UP = np.array([0.0, 0.0, 1.0])
Place = tuple[int, float, float, float]
Levels = list[LevelObservation]


def walls_of(points: Array, height: float) -> list[WallObservation]:
    settings = SurfaceSettings()
    above = sort_into_columns(points + np.array([0, 0, height]), settings.columns)
    return extract_walls(above, contour(above, settings.high_band), settings)


def walls_in(boxes: list[Box], T: Array, sensor: Sensor | None = None, seed: int = 0) -> list[WallObservation]:
    """What is extracted from one scan of a level sensor; x y of the observations from the sensor."""
    return walls_of(scan(scene_of(boxes), T, sensor, seed), float(T[2, 3]))


def in_scene(observation: WallObservation, T: Array) -> tuple[Array, Array]:
    """The plane (4,) and the ends (2, 2) in the scene's frame."""
    T = T.copy()
    T[2, 3] = 0.0  # z of an observation is above the floor already
    ends = np.column_stack([observation.ends, [0, 0]]) @ T[:3, :3].T + T[:3, 3]
    return transform_planes(T, observation.plane), ends[:, :2]


def place(observation: WallObservation, T: Array) -> Place:
    """Which of the room's walls it is; how far off, in radians, and in metres at its middle; how long, in metres."""
    plane, ends = in_scene(observation, T)
    which = int(np.argmax(PLANES[:, :3] @ plane[:3]))
    angle = float(np.arccos(np.clip(PLANES[which, :3] @ plane[:3], -1, 1)))
    middle = np.array([*ends.mean(axis=0), 0.0, 1.0])
    # the plane's own height there; the ends say nothing of the plane
    offset = float((plane - PLANES[which])[[0, 1, 3]] @ middle[[0, 1, 3]])
    return which, angle, abs(offset), float(np.hypot(*(ends[1] - ends[0])))


def check_all(found: list[Place], angle_deg: float = 0.35, most: float = 0.01, shortest: float = 1.0) -> None:
    """All four walls are there; noise may split one, and short pieces are less exact."""
    assert {which for which, _, _, length in found if length > shortest} == {0, 1, 2, 3}
    for _, angle, offset, length in found:
        assert angle < np.radians(angle_deg if length > 1.0 else 3.0) and offset < (most if length > 1.0 else 0.05)


@pytest.mark.parametrize(("beams", "spacing"), [(128, 0.35), (64, 0.5), (16, 2.0), (5, 7.0), (4, 8.0), (3, 15.0)])
def test_walls_are_found_however_far_apart_the_rings_are(beams: int, spacing: float) -> None:
    T, half = pose(0.7, -0.4, 0.8, 0.3), spacing * (beams - 1) / 2
    sensor = Sensor(beams=beams, lowest_deg=-half, highest_deg=half, azimuths=900)
    found = [place(observation, T) for observation in walls_in(room(*ROOM), T, sensor)]
    check_all(found, 1.0, 0.02, 0.0)
    assert sum(length for *_, length in found) > 18


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.4, 2.8, 4.9])
def test_the_walls_of_a_room_are_found_at_any_heading_and_a_table_is_none(yaw: float) -> None:
    T, seed = pose(0.7, -0.4, 0.8, yaw), int(10 * yaw)
    found, table = walls_in(room(*ROOM), T, seed=seed), (1.8, -0.6, 0.0, 2.6, 0.8, 0.75)
    check_all([place(own, T) for own in found])
    check_all([place(own, T) for own in walls_in([*room(*ROOM), table], T, seed=seed)])
    for own in found:
        assert own.plane[3] > 0  # the normal points to the sensor
        assert 0.1 < own.heights[0] < 0.7 and 1.2 < own.heights[1] < 2.3
        axis = 1 if place(own, T)[0] < 2 else 0
        ends = np.sort(in_scene(own, T)[1][:, axis])
        assert yaw != 0.4 or ends == pytest.approx([ROOM[axis], ROOM[axis + 2]], abs=0.15)  # not split


def test_errors_are_as_large_as_the_graph_takes_them_to_be() -> None:
    """Sigmas with the back end's floors under them, over many scans, are neither far too small nor too large."""
    graph, ratios = BackendSettings(), []
    for seed in range(30):
        T = pose(0.7 + 0.02 * seed, -0.4, 0.8, 0.2 * seed)
        for own in walls_in(room(*ROOM), T, seed=seed):
            _, angle, offset, _ = place(own, T)
            bent = np.sqrt(12) * graph.sigma_wall / np.linalg.norm(np.diff(own.ends, axis=0))
            sigmas = np.hypot(own.sigma_normal, bent), np.hypot(own.sigma_offset, graph.sigma_wall)
            ratios.append((angle / sigmas[0], offset / sigmas[1]))
    assert len(ratios) >= 120
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert rms.min() > 0.1 and rms.max() < 1.2 and np.quantile(ratios, 0.95, axis=0).max() < 2.5


@pytest.mark.parametrize("height", [2.0, 2.3, 2.6])
def test_floor_and_ceiling_are_no_walls(height: float) -> None:
    T = pose(0.5, 0.2, 0.8, 0.3)
    found = walls_in(room(*ROOM, height=height), T, WIDE)
    assert 4 <= len(found) <= 6
    assert all(abs(own.plane[2]) < 0.02 and place(own, T)[2] < 0.01 for own in found)
    short = Sensor(beams=32, lowest_deg=-45, highest_deg=45, max_range=8.0)  # sees nothing else
    assert walls_in(room(-30, -30, 30, 30, height=height), pose(0, 0), short) == []


@pytest.mark.parametrize(("depth", "kept"), [(0.15, False), (0.0, True)])
def test_a_window_behind_its_parapet_is_dropped_and_one_flush_with_its_wall_is_kept(depth: float, kept: bool) -> None:
    """In the wall at y = 2.5, from x = -1.5 to 2."""
    (x0, _, x1, y), T = ROOM, pose(0.2, -0.3, 0.8, 0.5)
    boxes = [box for box in room(*ROOM) if not (box[1] == y and box[4] > y)]
    boxes += [(x0, y, 0, x1, y + 0.4, 0.85), (x0, y, 2.2, x1, y + 0.4, 2.6), (x0, y, 0.85, -1.5, y + 0.4, 2.2)]
    boxes += [(2.0, y, 0.85, x1, y + 0.4, 2.2), (-1.5, y + depth, 0.85, 2.0, y + 0.4, 2.2)]
    found = [place(own, T) for own in walls_in(boxes, T)]
    assert all(offset < 0.012 for _, _, offset, _ in found) and {which for which, *_ in found} >= {0, 1, 2}
    assert not kept or any(which == 3 and length > 1.0 for which, _, _, length in found)


def levels_in(boxes: list[Box], way: list[Array], sensor: Sensor = WIDE, T: Array = HERE) -> Levels:
    """What a few scans on a way show, in the frame of the last one; as if the scene were moved by a pose."""
    return extract_levels(*surfels_of(scene_of(boxes), way, sensor, T).surfels(), T @ way[-1])


def walk(height: float, pitch: float = 0.0, roll: float = 0.0) -> list[Array]:
    return [pose(0.1 * k, 0.05 * k, height, 0.1 * k, pitch, roll) for k in range(4)]


def heights(found: Levels, T: Array, is_floor: bool = True) -> Array:
    """Heights (m) above the sensor's foot on the ground, of floors or of ceilings, lowest first."""
    planes = [transform_planes(T, own.plane) for own in found if own.is_floor == is_floor]
    return np.sort([-(p[3] + p[:2] @ T[:2, 3]) / p[2] for p in planes])


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.2, -0.1), (-0.6, 0.3), (0.0, np.pi)])
def test_floor_and_ceiling_are_found_by_a_sensor_at_any_tilt(tilt: tuple[float, float]) -> None:
    way = walk(1.3, *tilt)
    found = levels_in(room(-5, -4, 5, 4, height=2.7), way)
    for is_floor, height in ((True, 0.0), (False, 2.7)):
        assert heights(found, way[-1], is_floor) == pytest.approx([height], abs=0.01)
    for own in found:
        assert CELL**2 * len(own.places) > 10 and own.sigma_offset < 0.01
        assert own.plane[3] > 0, "the normal points to the side that was seen"
        assert np.abs(own.places @ own.plane[:3] + own.plane[3]).max() < 0.05, "it was seen on the surface"


@pytest.mark.parametrize(
    ("things", "expected"),
    [
        ([(1.5, -2.0, 0.0, 4.9, 2.0, 0.3), (-3.0, 1.0, 0.0, -1.0, 2.5, 0.75)], [0.0, 0.3, 0.75]),  # platform and table
        ([(2.0, 0.0, 0.0, 2.4, 0.6, 0.5)], [0.0]),  # a small shelf
    ],
)
def test_large_things_are_surfaces_of_their_own(things: list[Box], expected: list[float]) -> None:
    way = walk(1.4)
    found = levels_in([*LARGE, *things], way)
    assert heights(found, way[-1]) == pytest.approx(expected, abs=0.02)
    areas = [len(own.places) for own in found if own.is_floor]
    assert areas[0] == max(areas), "the floor is the largest"


def looked(scans: list[Array], poses: list[Array], height: float) -> KeyframeScan:
    """From the last of some poses, whose scan comes once more; the others are before it."""
    surfels = SurfelMap()
    for points, T_odom_sensor in zip(scans, poses, strict=True):
        surfels.add_scan(points, T_odom_sensor)
    return keyframe_scan(scans[-1], surfels.surfels(), poses[-1], poses[-1][2, :3], height, Config())


def angles_deg(a: Array, b: Array) -> Array:
    return np.asarray(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))


@pytest.mark.parametrize("roll_deg", [0.0, 3.0, -8.0])
def test_surfaces_are_found_though_the_tracked_attitude_tilts_and_right_its_vertical(roll_deg: float) -> None:
    scene, tilt = scene_of([*room(0, 0, 7, 5), (3, 2, 0, 3.5, 2.5, 1)]), pose(0, 0, 0, roll=np.radians(roll_deg))
    poses = [pose(2.0 + 0.2 * k, 1.5, 1.2, yaw=0.1 * k, pitch=0.02 * k) for k in range(6)]
    scans, T = [scan(scene, T, seed=k) for k, T in enumerate(poses)], poses[-1]
    found = looked(scans, [tilt @ T for T in poses], 1.2)
    assert angles_deg(T[:3, :3] @ found.up, UP) < 0.5 + 0.05 * abs(roll_deg)
    assert found.sigma_up < np.radians(1.5)
    walls = transform_planes(T, np.stack([wall.plane for wall in found.walls]))
    assert len(walls) >= 4
    assert np.abs(walls[:, 2]).max() < np.radians(2.0)  # upright in the room, not in `odom`
    floors = transform_planes(T, np.stack([level.plane for level in found.levels if level.is_floor]))
    assert np.abs(floors[:, 3]).min() < 0.03 and angles_deg(floors[:, :3], UP).max() < 1.5
    alone = keyframe_scan(scans[0], SurfelMap().surfels(), poses[0], poses[0][2, :3], 1.2, Config())
    assert alone.sigma_up == np.inf and len(alone.walls) >= 4 and not alone.levels  # no scans before it


def test_where_no_surface_is_upright_or_level_the_tracked_attitude_stays() -> None:
    normals = np.random.default_rng(0).normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert refined_up(UP, normals, np.ones(400)) is None
    assert refined_up(UP, np.eye(3).repeat(9, axis=0), np.ones(27)) is None  # few
    assert refined_up(UP, np.eye(3).repeat(10, axis=0), np.ones(30)) is not None
