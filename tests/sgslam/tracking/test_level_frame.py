"""Where up is: by the surfaces of the first seconds, under any mount."""

import logging
from dataclasses import dataclass

import numpy as np
import pytest
from boxes import Array, pose, scan
from scipy.spatial.transform import Rotation
from walks import surfels_of, through_the_door, two_rooms

from data.geometry.raycast import TriangleScene
from data.simulation import Sensor
from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.perception.gravity import Gravity, find_gravity
from sgslam.tracking.level_frame import LevelFrame
from sgslam.types import RawScan, TrackedScan

NS = 1_000_000_000
EXPECTED = np.array([0.0, 0.0, 1.0])
SENSORS = {
    "16 rings": Sensor(16, -15, 15, 300),
    "32 rings": Sensor(32, -45, 45, 150),
    "dome": Sensor(40, -7, 52, 150),
}
Degrees = tuple[float, float, float]


def turn(roll: float = 0.0, pitch: float = 0.0) -> Array:
    """(3, 3) R_upright_sensor of a mount in degrees."""
    return Rotation.from_euler("ZYX", [0.0, pitch, roll], degrees=True).as_matrix()


HANGING, LYING = turn(roll=180.0), turn(pitch=90.0)  # z downwards, forward


@dataclass(frozen=True)
class Seen:
    """Surfels in the frame of the first pose: positions and normals (N, 3), numbers of points (N,), the sensor's
    positions (M, 3); `up` (3,) is the truth."""

    surfels: tuple[Array, Array, Array]
    places: Array
    up: Array

    def found(self, expected: Array = EXPECTED, is_stated: bool = False) -> Gravity | None:
        return find_gravity(self.surfels, self.places, expected, is_stated)

    def off_deg(self, found: Gravity, either_end: bool = False) -> float:
        """Between the vertical found and the true one."""
        off = float(np.degrees(np.arccos(np.clip(found.up @ self.up, -1.0, 1.0))))
        return min(off, 180.0 - off) if either_end else off


def seen_from(scene: TriangleScene, poses: Array, sensor: Sensor, seed: int = 0) -> Seen:
    T = np.linalg.inv(poses[0])
    surfels = surfels_of(scene, poses, sensor, T, seed).surfels()
    return Seen(surfels, (T @ poses)[:, :3, 3], poses[0, 2, :3].copy())


def carried(mount: Array, sensor: str, seed: int = 0) -> Seen:
    """By one who sways and bobs on the way through a door in five seconds; `mount` (3, 3) is R_carrier_sensor."""
    rng, poses = np.random.default_rng(seed), through_the_door()
    phase = 2 * np.pi * (np.linspace(0.0, 5.0, len(poses))[:, None] + rng.random(3))
    sway = Rotation.from_euler("xyz", np.radians([3.0, 3.0, 4.0]) * np.sin(phase)).as_matrix()
    poses[:, :3, :3] = poses[:, :3, :3] @ sway @ mount
    poses[:, 2, 3] += 0.03 * np.sin(2 * phase[:, 0])
    return seen_from(two_rooms(), poses, SENSORS[sensor], 100 * seed)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("degrees", [0.0, 12.0, 25.0, 40.0])
def test_a_tilted_mount_needs_no_flag(sensor: str, degrees: float) -> None:
    scenes = [carried(mount, sensor, k) for k, mount in enumerate([turn(roll=degrees), turn(pitch=-degrees)])]
    found = [(s, g) for s in scenes if (g := s.found()) is not None]
    assert found and max(s.off_deg(g) for s, g in found) < 1.0  # measured 0.02 to 0.42


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("mount", [HANGING, LYING], ids=["hanging", "lying"])
def test_up_is_the_end_of_the_axis_nearer_to_the_mount(sensor: str, mount: Array) -> None:
    s = carried(mount, sensor)
    usual, stated, roughly = s.found(), s.found(s.up, True), s.found((s.up + 0.1) / np.linalg.norm(s.up + 0.1), True)
    assert usual is None or not usual.is_sure or (s.off_deg(usual, True) < 1.5 and usual.up @ EXPECTED > 0)
    assert mount is LYING or (usual is not None and s.off_deg(usual) > 178.5)
    assert stated is not None and stated.is_sure and s.off_deg(stated) < 1.5
    assert roughly is not None and s.off_deg(roughly) < 1.5


def test_few_surfaces_tell_nothing() -> None:
    s = carried(np.eye(3), "32 rings")
    for most, told in ((20, False), (400, True)):
        positions, normals, counts = (part[:: len(part) // most] for part in s.surfels)
        assert (find_gravity((positions, normals, counts), s.places, EXPECTED, False) is not None) == told


def settled(R_upright_sensor: Array, mount: Degrees | None, measured: Array | None = None) -> LevelFrame:
    """After six seconds in which the sensor stands, or hangs, still in one of two rooms."""
    settings = TrackingSettings(mount=mount)
    frame, odometry, scans = LevelFrame(settings), ContinuousTimeOdometry(settings), []
    for k in range(13):
        points = scan(two_rooms(), pose(2.5, 2.0, 1.3), seed=k) @ R_upright_sensor
        found = odometry.register(k * NS // 2, points, None)
        scans.append(TrackedScan(RawScan(k * NS // 2, points, None, None), found, found.T_odom_sensor))
        frame.add(scans, measured)
    frame.settle(scans)
    return frame


@pytest.mark.parametrize(
    ("angles", "mount", "warned", "right"),
    [
        ((0.0, 0.0), None, False, True),
        ((0.0, 12.0), None, False, True),
        ((0.0, 90.0), None, True, None),  # which end is up is never sure
        ((0.0, 90.0), (0.0, 90.0, 0.0), False, True),
        ((180.0, 0.0), None, False, False),  # a mount that is not stated is taken for upright
        ((180.0, 0.0), (180.0, 0.0, 0.0), False, True),
        ((0.0, 0.0), (0.0, 40.0, 0.0), True, True),  # the wrong mount is stated
    ],
)
def test_up_is_found_or_the_mount_is_asked_for(
    angles: Array, mount: Degrees | None, warned: bool, right: bool | None, caplog: pytest.LogCaptureFixture
) -> None:
    R = turn(*angles)
    frame = settled(R, mount)
    assert any("--mount" in record.message for record in caplog.records) == warned
    assert (frame.advice is not None) == (warned and mount is not None)
    assert frame.is_way_up_assumed == (mount is None)
    assert right is None or (frame.likely_up @ R[2] > np.cos(np.radians(1.0))) == right


def test_what_an_accelerometer_shows_counts_for_the_sign(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        frame = settled(HANGING, None, np.array([0.05, 0.0, -1.0]) / np.hypot(0.05, 1.0))
    assert frame.sure and frame.likely_up[2] < -0.9995  # the axis is that of the surfaces
    assert not frame.is_way_up_assumed and "--mount" not in caplog.text
