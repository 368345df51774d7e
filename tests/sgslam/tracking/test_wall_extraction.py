"""Walls of single scans, cast in rooms that are known exactly."""

import numpy as np
import pytest
from boxes import Array, Box, pose, room, scan, scene_of

from data.simulation import SpinningSensor
from sgslam.config import BackendSettings, SurfaceSettings
from sgslam.geometry.frames import transform_planes
from sgslam.perception import WallObservation, extract_walls, sort_into_columns
from sgslam.perception.column_scan import contour

SETTINGS, GRAPH = SurfaceSettings(), BackendSettings()
ROOM = (-3.0, -2.0, 4.0, 2.5)  # lowest x y, highest x y
PLANES = np.array([[1, 0, 0, 3.0], [-1, 0, 0, 4.0], [0, 1, 0, 2.0], [0, -1, 0, 2.5]])
WIDE = SpinningSensor(beams=32, lowest_deg=-45, highest_deg=45)  # sees floor and ceiling close by


def walls_of(points: Array, height: float) -> list[WallObservation]:
    above = sort_into_columns(points + np.array([0, 0, height]), SETTINGS.columns)
    return extract_walls(above, contour(above, SETTINGS.high_band), SETTINGS)


def walls_in(boxes: list[Box], T: Array, sensor: SpinningSensor | None = None, seed: int = 0) -> list[WallObservation]:
    """What is extracted from one scan of a level sensor; x y of the observations from the sensor."""
    return walls_of(scan(scene_of(boxes), T, sensor, seed), float(T[2, 3]))


def in_scene(observation: WallObservation, T: Array) -> tuple[Array, Array]:
    """The plane (4,) and the ends (2, 2) in the scene's frame."""
    T = T.copy()
    T[2, 3] = 0.0  # z of an observation is above the floor already
    ends = np.column_stack([observation.ends, [0, 0]]) @ T[:3, :3].T + T[:3, 3]
    return transform_planes(T, observation.plane), ends[:, :2]


def place(observation: WallObservation, T: Array) -> tuple[int, float, float, float]:
    """Which of the room's walls it is; how far off, in radians, and in metres at its middle; how long, in metres."""
    plane, ends = in_scene(observation, T)
    which = int(np.argmax(PLANES[:, :3] @ plane[:3]))
    angle = float(np.arccos(np.clip(PLANES[which, :3] @ plane[:3], -1, 1)))
    middle = ends.mean(axis=0)
    # the plane's own height there; the ends say nothing of the plane
    offset = float(plane[:2] @ middle + plane[3] - (PLANES[which, :2] @ middle + PLANES[which, 3]))
    return which, angle, abs(offset), float(np.hypot(*(ends[1] - ends[0])))


@pytest.mark.parametrize(("beams", "spacing"), [(128, 0.35), (64, 0.5), (16, 2.0), (5, 7.0), (4, 8.0), (3, 15.0)])
def test_walls_are_found_however_far_apart_the_rings_are(beams: int, spacing: float) -> None:
    T, half = pose(0.7, -0.4, 0.8, 0.3), spacing * (beams - 1) / 2
    sensor = SpinningSensor(beams=beams, lowest_deg=-half, highest_deg=half, azimuths=900)
    found = [place(observation, T) for observation in walls_in(room(*ROOM), T, sensor)]
    assert {which for which, *_ in found} == {0, 1, 2, 3} and sum(length for *_, length in found) > 18
    assert all(angle < np.radians(1.0) and offset < 0.02 for _, angle, offset, length in found if length > 1.0)


@pytest.mark.parametrize("spacing", [0.5, 2.0, 8.0])
def test_floors_and_slopes_are_no_walls_however_far_apart_the_rings_are(spacing: float) -> None:
    beams = round(32 / spacing) + 1
    sensor = SpinningSensor(beams=beams, lowest_deg=-40.0, highest_deg=-8.0, azimuths=900)
    assert walls_in([(-30.0, -30.0, -0.2, 30.0, 30.0, 0.0)], pose(0.0, 0.0, 0.8), sensor) == []


@pytest.mark.slow
@pytest.mark.parametrize("yaw", np.arange(0.0, 6.28, 0.7))
def test_the_walls_of_a_room_are_found_at_any_heading(yaw: float) -> None:
    T = pose(0.7, -0.4, 0.8, yaw)
    long = np.zeros(4, dtype=int)
    for observation in walls_in(room(*ROOM), T, seed=int(10 * yaw)):
        which, angle, offset, length = place(observation, T)
        assert observation.plane[3] > 0  # the normal points to the sensor
        if length > 1.0:  # noise may split a wall
            long[which] += 1
            assert angle < np.radians(0.35) and offset < 0.01
        assert angle < np.radians(3) and offset < 0.05
    assert long.min() >= 1


def test_extents_are_those_of_the_walls() -> None:
    T = pose(0.7, -0.4, 0.8, 0.4)
    for observation in walls_in(room(*ROOM), T):
        _, ends = in_scene(observation, T)
        which, _, _, _ = place(observation, T)
        axis = 1 if which < 2 else 0
        np.testing.assert_allclose(np.sort(ends[:, axis]), [ROOM[axis], ROOM[axis + 2]], atol=0.15)
        assert 0.1 < observation.heights[0] < 0.7 and 1.2 < observation.heights[1] < 2.3


def test_errors_are_as_large_as_the_graph_takes_them_to_be() -> None:
    """Sigmas with the back end's floors under them, over many scans, are neither far too small nor too large."""
    angles, offsets = [], []
    for seed in range(30):
        T = pose(0.7 + 0.02 * seed, -0.4, 0.8, 0.2 * seed)
        for observation in walls_in(room(*ROOM), T, seed=seed):
            _, angle, offset, _ = place(observation, T)
            bent = np.sqrt(12) * GRAPH.sigma_wall / np.linalg.norm(np.diff(observation.ends, axis=0))
            angles.append(angle / np.hypot(observation.sigma_normal, bent))
            offsets.append(offset / np.hypot(observation.sigma_offset, GRAPH.sigma_offset))
    assert len(angles) >= 120
    for ratio in (angles, offsets):
        assert 0.1 < np.sqrt(np.mean(np.square(ratio))) < 1.2
        assert np.quantile(ratio, 0.95) < 2.5


@pytest.mark.parametrize("height", [2.0, 2.3, 2.6])
def test_floor_and_ceiling_are_no_walls(height: float) -> None:
    T = pose(0.5, 0.2, 0.8, 0.3)
    found = walls_in(room(*ROOM, height=height), T, WIDE)
    assert 4 <= len(found) <= 6
    for observation in found:
        assert abs(observation.plane[2]) < 0.02
        assert place(observation, T)[2] < 0.01


def test_an_empty_hall_with_only_floor_and_ceiling_in_reach_has_no_walls() -> None:
    sensor = SpinningSensor(beams=32, lowest_deg=-45, highest_deg=45, max_range=8.0)
    assert walls_in(room(-30, -30, 30, 30, height=2.4), pose(0, 0), sensor) == []


def test_a_table_is_no_wall_and_hides_none() -> None:
    T = pose(0.0, 0.0, 0.8, 1.0)
    table: Box = (1.5, -0.6, 0.0, 2.3, 0.8, 0.75)
    found = [place(o, T) for o in walls_in([*room(*ROOM), table], T)]
    assert {which for which, _, _, _ in found} == {0, 1, 2, 3}
    assert all(angle < np.radians(0.3) and offset < 0.01 for _, angle, offset, length in found if length > 1.0)
    assert all(angle < np.radians(3) and offset < 0.05 for _, angle, offset, _ in found)


def niche(depth: float) -> list[Box]:
    """The room with a window over the parapet of its wall at y = 2.5, `depth` behind it."""
    x0, _, x1, y1 = ROOM
    low, high = -1.5, 2.0  # of the window along x
    others = [box for box in room(*ROOM) if not (box[1] == y1 and box[4] > y1)]
    wall: list[Box] = [(x0, y1, 0, x1, y1 + 0.4, 0.85), (x0, y1, 2.2, x1, y1 + 0.4, 2.6)]
    wall += [(x0, y1, 0.85, low, y1 + 0.4, 2.2), (high, y1, 0.85, x1, y1 + 0.4, 2.2)]
    return [*others, *wall, (low, y1 + depth, 0.85, high, y1 + 0.4, 2.2)]


def test_a_window_behind_its_parapet_is_dropped() -> None:
    T = pose(0.2, -0.3, 0.8, 0.5)
    found = [place(o, T) for o in walls_in(niche(0.15), T)]
    assert all(offset < 0.012 for _, _, offset, _ in found)
    assert {which for which, _, _, _ in found} >= {0, 1, 2}


def test_a_window_flush_with_its_wall_is_kept() -> None:
    T = pose(0.2, -0.3, 0.8, 0.5)
    assert [which for which, _, _, length in (place(o, T) for o in walls_in(niche(0.0), T)) if length > 1.0].count(3)


def test_two_sides_of_a_partition_face_apart() -> None:
    """A free-standing wall 10 cm thick, seen from one side and then from the other."""
    boxes = [*room(-4, -4, 4, 4), (-2.0, -0.05, 0.0, 2.0, 0.05, 2.6)]
    for y in (1.5, -1.5):
        T = pose(0.1, y, 0.8, 0.3)
        planes = [in_scene(o, T)[0] for o in walls_in(boxes, T)]
        sides = [plane for plane in planes if abs(plane[1]) > 0.9 and plane[3] < 0.5]
        assert len(sides) == 1
        np.testing.assert_allclose(sides[0], [0, np.sign(y), 0, -0.05], atol=0.012)


@pytest.mark.parametrize("count", [0, 1, 4])
def test_too_few_points_give_nothing(count: int) -> None:
    points = np.random.default_rng(0).uniform(1, 2, (count, 3))
    assert walls_of(points, 0.8) == []
