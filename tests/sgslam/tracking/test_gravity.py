"""The vertical from surfaces: under any mount, in a building of boxes; None where it cannot be told."""

import functools
from dataclasses import dataclass

import numpy as np
import pytest
from boxes import Array, pose, room, scan, scene_of
from scipy.spatial.transform import Rotation
from walks import HANGING, through_the_door, two_rooms

from data.simulation import SpinningSensor
from sgslam.surfels import SurfelMap
from sgslam.tracking.gravity import Gravity, estimate_gravity
from sgslam.tracking.level_frame import add_seen

EXPECTED = np.array([0.0, 0.0, 1.0])
SENSORS = {
    "16 rings": SpinningSensor(16, -15, 15, 300),
    "32 rings": SpinningSensor(32, -45, 45, 150),
    "dome": SpinningSensor(40, -7, 52, 150),
}
LYING = Rotation.from_euler("y", 90, degrees=True).as_matrix()  # z forward


@dataclass(frozen=True)
class Seen:
    """Surfels in the frame of the first pose: positions and normals (N, 3), numbers of points (N,), the sensor's
    positions (M, 3); `up` (3,) is the truth."""

    surfels: tuple[Array, Array, Array]
    places: Array
    up: Array

    def estimated(self, expected: Array = EXPECTED, is_stated: bool = False) -> Gravity | None:
        return estimate_gravity(*self.surfels, self.places, expected, is_stated)

    def off_deg(self, found: Gravity) -> float:
        """Between the vertical found and the true one."""
        return float(np.degrees(np.arccos(np.clip(found.up_in_odom @ self.up, -1.0, 1.0))))


def seen_from(poses: Array, clouds: list[Array]) -> Seen:
    surfels, in_first = SurfelMap(), np.linalg.inv(poses[0]) @ poses
    for points, T in zip(clouds, in_first, strict=True):
        add_seen(surfels, points, T)
    return Seen(surfels.surfels(), in_first[:, :3, 3], poses[0, 2, :3].copy())


def tilted(degrees: float, rng: np.random.Generator) -> Array:
    """(3, 3) a mount's rotation about a random level axis."""
    angle = rng.uniform(-np.pi, np.pi)
    return Rotation.from_rotvec(np.radians(degrees) * np.array([np.cos(angle), np.sin(angle), 0.0])).as_matrix()


def carried(mount: Array, sensor: str, seed: int = 0) -> Seen:
    """By one who sways and bobs on the way through a door in five seconds; `mount` (3, 3) is R_carrier_sensor."""
    rng, poses = np.random.default_rng(seed), through_the_door()
    phase = 2 * np.pi * (np.linspace(0.0, 5.0, len(poses))[:, None] + rng.random(3))
    sway = Rotation.from_euler("xyz", np.radians([3.0, 3.0, 4.0]) * np.sin(phase)).as_matrix()
    poses[:, :3, :3] = poses[:, :3, :3] @ sway @ mount
    poses[:, 2, 3] += 0.03 * np.sin(2 * phase[:, 0])
    return seen_from(poses, [scan(two_rooms(), T, SENSORS[sensor], 100 * seed + k) for k, T in enumerate(poses)])


@functools.cache
def lone_room(x: float, y: float, z: float) -> Seen:
    """A closed bare room, by a sensor in its middle that does not move and looks to all sides."""
    scene, T = scene_of(room(0, 0, x, y, z)), pose(x / 2, y / 2, z / 2, pitch=0.1)
    clouds = [scan(scene, T, SpinningSensor(60, -85, 85, 120), k) for k in range(5)]
    return seen_from(np.tile(T, (5, 1, 1)), clouds)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("degrees", [0.0, 12.0, 25.0, 40.0])
def test_a_tilted_mount_needs_no_flag(sensor: str, degrees: float) -> None:
    scenes = [carried(tilted(degrees, np.random.default_rng(seed)), sensor, seed) for seed in range(2)]
    found = [(s, g) for s in scenes if (g := s.estimated()) is not None]
    assert found and max(s.off_deg(g) for s, g in found) < 1.0  # measured 0.02 to 0.42
    assert all(np.radians(s.off_deg(g)) < 4 * g.sigma < np.radians(4.0) for s, g in found)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("mount", [HANGING, LYING], ids=["hanging", "lying"])
def test_which_end_is_up_is_sure_with_a_stated_mount_only(sensor: str, mount: Array) -> None:
    s = carried(mount, sensor)
    found, stated, roughly = s.estimated(), s.estimated(s.up), s.estimated(s.up + 0.1)
    assert mount is HANGING or found is None or not found.sign_sure or not found.axis_sure
    assert stated is not None and stated.sign_sure and s.off_deg(stated) < 1.5
    assert roughly is not None and s.off_deg(roughly) < 1.5


@pytest.mark.parametrize("tilt_deg", [0.0, 12.0, 30.0])
def test_in_a_cube_the_axis_near_the_expected_one_is_taken_but_not_sure(tilt_deg: float) -> None:
    s = lone_room(3.0, 3.0, 3.0)
    across, tilt = np.cross(s.up, [0.6, 0.8, 0.0]), np.radians(tilt_deg)
    across /= np.linalg.norm(across)
    found, stated = s.estimated(np.cos(tilt) * s.up + np.sin(tilt) * across), s.estimated(s.up + 0.05, True)
    assert found is not None and s.off_deg(found) < 1.5 and (not found.axis_sure or tilt_deg == 0.0)
    assert stated is not None and s.off_deg(stated) < 1.5
    for expected in (across, s.up + across):  # between two axes
        unsure = s.estimated(expected)
        assert unsure is None or not unsure.axis_sure


def test_a_bare_hall_has_one_vertical_but_no_sign() -> None:
    s = lone_room(9.0, 7.0, 2.8)
    found, lying = s.estimated(s.up + np.array([0.4, 0.3, 0.0])), s.estimated(np.cross(s.up, [0.6, 0.8, 0.0]))
    assert found is not None and s.off_deg(found) < 1.5
    assert lying is not None and not lying.sign_sure


def test_few_surfaces_and_those_of_no_building_tell_nothing() -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        normals = rng.normal(size=(500, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        places = rng.uniform(-5, 5, (500, 3))
        assert estimate_gravity(places, normals, np.ones(500), np.zeros((5, 3)), EXPECTED) is None
    s = carried(np.eye(3), "32 rings")
    for most, told in ((20, False), (400, True)):
        some = [part[:: len(part) // most] for part in s.surfels]
        assert (estimate_gravity(*some, s.places, EXPECTED) is not None) == told


def test_another_frame_gives_the_same_vertical() -> None:
    s = carried(tilted(25.0, np.random.default_rng(0)), "32 rings")
    R, t = Rotation.random(random_state=1).as_matrix(), np.array([100.0, -40.0, 7.0])
    positions, normals, weights = s.surfels
    here = s.estimated()
    there = estimate_gravity(positions @ R.T + t, normals @ R.T, weights, s.places @ R.T + t, R[:, 2])
    assert here is not None and there is not None
    np.testing.assert_allclose(there.up_in_odom, R @ here.up_in_odom, atol=1e-3)
