"""Level surfaces in scans cast in rooms that are known exactly, by sensors of many kinds."""

import numpy as np
import pytest
from boxes import Array, Box, pose, room, scan, scene_of

from data.simulation import SpinningSensor
from sgslam.geometry.frames import transform_planes, transform_points
from sgslam.perception import LevelObservation, extract_levels
from sgslam.surfels import SurfelMap
from sgslam.tracking.level_frame import add_seen

WIDE = SpinningSensor(beams=32, lowest_deg=-45, highest_deg=45)
LOW = SpinningSensor(lowest_deg=-25)


def levels_in(boxes: list[Box], way: list[Array], sensor: SpinningSensor | None = None) -> list[LevelObservation]:
    """What a few scans on a way show, in the frame of the last one."""
    surfels, scene = SurfelMap(), scene_of(boxes)
    for seed, T in enumerate(way):
        add_seen(surfels, scan(scene, T, sensor, seed), T)
    return extract_levels(*surfels.surfels(), way[-1])


def walk(height: float, pitch: float = 0.0, roll: float = 0.0) -> list[Array]:
    return [pose(0.1 * k, 0.05 * k, height, 0.1 * k, pitch, roll) for k in range(4)]


def heights(found: list[LevelObservation], T: Array, is_floor: bool) -> Array:
    """Heights (m) above the sensor's foot on the ground, of floors or of ceilings, lowest first."""
    planes = [transform_planes(T, own.plane) for own in found if own.is_floor == is_floor]
    return np.sort([-(p[3] + p[:2] @ T[:2, 3]) / p[2] for p in planes])


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.2, -0.1), (-0.6, 0.3), (0.0, np.pi)])
def test_floor_and_ceiling_are_found_by_a_sensor_at_any_tilt(tilt: tuple[float, float]) -> None:
    way = walk(1.3, *tilt)
    found = levels_in(room(-5, -4, 5, 4, height=2.7), way, WIDE)
    floors, ceilings = (heights(found, way[-1], side) for side in (True, False))
    np.testing.assert_allclose(floors, [0.0], atol=0.01)
    np.testing.assert_allclose(ceilings, [2.7], atol=0.01)
    for own in found:
        assert own.area > 10 and own.sigma_offset < 0.01
        assert own.plane[3] > 0, "the normal points to the side that was seen"
        assert abs(own.plane[:3] @ own.centre + own.plane[3]) < 0.02, "the centre is on the surface"


def test_a_platform_and_a_table_are_surfaces_of_their_own() -> None:
    boxes = [*room(-5, -5, 5, 5), (1.5, -2.0, 0.0, 4.9, 2.0, 0.3), (-3.0, 1.0, 0.0, -1.0, 2.5, 0.75)]
    way = walk(1.5)
    found = levels_in(boxes, way, WIDE)
    np.testing.assert_allclose(heights(found, way[-1], True), [0.0, 0.3, 0.75], atol=0.02)
    areas = [own.area for own in found if own.is_floor]
    assert areas[0] == max(areas), "the floor is the largest"


def test_a_small_shelf_and_a_slope_are_no_level_surfaces() -> None:
    shelf = [*room(-5, -5, 5, 5), (2.0, 0.0, 0.0, 2.4, 0.6, 0.5)]
    way = walk(1.2)
    np.testing.assert_allclose(heights(levels_in(shelf, way, WIDE), way[-1], True), [0.0], atol=0.02)
    surfels, scene, tilt = SurfelMap(), scene_of(room(-5, -5, 5, 5)), pose(0, 0, 0, 0, np.radians(15))
    for seed, T in enumerate(way):
        add_seen(surfels, scan(scene, T, WIDE, seed), tilt @ T)
    found = extract_levels(*surfels.surfels(), np.eye(4))
    assert sum(own.area for own in found) < 10, "of 200 m2"


def test_out_of_sight_is_not_found() -> None:
    upwards = SpinningSensor(lowest_deg=0.5, highest_deg=30)
    way = walk(0.8)
    found = levels_in(room(-3, -3, 3, 3), way, upwards)
    assert not any(own.is_floor for own in found)
    assert not extract_levels(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.eye(4))


def test_errors_are_as_large_as_they_are_taken_to_be() -> None:
    """With the back end's floor under the sigmas, over many places."""
    ratios = []
    for seed in range(12):
        start = pose(0.3 * seed - 1.5, 0.2 * seed - 1, 1.4, 0.5 * seed)
        way = [start @ pose(0.1 * k, 0, 0) for k in range(4)]
        for own in levels_in(room(-6, -5, 6, 5), way, LOW):
            if own.is_floor:
                off = heights([own], way[-1], True)[0]
                ratios.append(off / np.hypot(own.sigma_offset, 0.01))
                place = transform_points(way[-1], own.centre)
                assert abs(place[2]) < 0.02
    assert len(ratios) >= 10
    assert np.sqrt(np.mean(np.square(ratios))) < 1.2
