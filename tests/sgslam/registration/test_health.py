"""Health of scans of a synthetic room: a steady drive is good, and gives the same bits again."""

import numpy as np
import pytest
from boxes import Array, pose, room, scan, scene_of

from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.registration import Registration

_FURNISHED = [*room(0, 0, 7, 5), (5, 3.5, 0, 6, 4.5, 1.4), (1, 4, 0, 1.6, 5, 2.0)]


def _poses(count: int) -> list[Array]:
    return [pose(1.5 + 0.05 * k, 2.0 + 0.01 * k, 0.8, 0.02 * k) for k in range(count)]


def _registered(scans: list[Array]) -> list[Registration]:
    odometry = ContinuousTimeOdometry(TrackingSettings())
    return [odometry.register(100_000_000 * k, points) for k, points in enumerate(scans)]


@pytest.mark.parametrize("seed", range(2))
def test_a_steady_drive_is_good_and_true(seed: int) -> None:
    scene, poses = scene_of(_FURNISHED), _poses(25)
    found = _registered([scan(scene, T, seed=100 * seed + k) for k, T in enumerate(poses)])
    assert {result.health for result in found} == {"good"}
    true = np.linalg.inv(poses[0]) @ poses[-1]
    assert np.linalg.norm(found[-1].T_odom_sensor[:3, 3] - true[:3, 3]) < 0.02  # m; measured 0.005


def test_the_same_scans_give_the_same_bits() -> None:
    scene = scene_of(_FURNISHED)
    scans = [scan(scene, T, seed=k) for k, T in enumerate(_poses(6))]
    first, again = _registered(scans), _registered(scans)
    assert all(np.array_equal(a.T_odom_sensor, b.T_odom_sensor) for a, b in zip(first, again, strict=True))


@pytest.mark.parametrize(
    ("x", "y", "yaw", "is_near"),
    [(2.5, 2.9, -1.2, True), (3.3, 1.6, -1.2, True), (12.5, 2.0, 0.4, False)],
)
def test_a_lost_sensor_is_found_again_near_by_but_not_in_another_room(
    x: float, y: float, yaw: float, is_near: bool
) -> None:
    scene = scene_of([*_FURNISHED, *room(11, 0, 14, 9), (12, 5, 0, 13, 6, 1.2)])
    lost, other = ContinuousTimeOdometry(TrackingSettings()), ContinuousTimeOdometry(TrackingSettings())
    for k, T in enumerate(_poses(25)):
        lost.register(100_000_000 * k, scan(scene, T, seed=k))
    lost.level(np.array([0.0, 0.0, 1.0]))
    after = [pose(x + 0.03 * k, y, 0.9, yaw + 0.02 * k, 0.1, 0.1) for k in range(8)]
    scans = [scan(scene, T, seed=50 + k) for k, T in enumerate(after)]
    covered = np.random.default_rng(0).uniform(0.4, 0.8, (2000, 3))
    assert lost.register(2_500_000_000, covered).health == "lost"
    for k, points in enumerate(scans[:7]):
        other.register(2_500_000_000 + 100_000_000 * k, points)
    assert lost.rejoin(other) is is_near
    found = lost.register(3_200_000_000, scans[7])
    assert (found.health == "good") is is_near
    if is_near:
        true = np.linalg.inv(_poses(1)[0]) @ after[7]
        assert np.linalg.norm(found.T_odom_sensor[:3, 3] - true[:3, 3]) < 0.05  # m; measured 0.01
