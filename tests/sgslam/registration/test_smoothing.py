"""All scans of a run registered again in one smoothing: what is seen later mends what was wrong before."""

import numpy as np
import pytest
from boxes import Array, pose, scan
from numpy.typing import NDArray
from walks import through_the_door, two_rooms

from data.simulation import SpinningSensor
from sgslam.config import TrackingSettings
from sgslam.registration import Motion
from sgslam.registration.sampling import thinned
from sgslam.registration.smoothing import smoothed

AT = 0.2 * np.arange(50)  # s, of the scans


@pytest.fixture(scope="module")
def walk() -> tuple[Array, list[Array]]:
    """True poses (50, 4, 4) from one room into another, and the scans' points."""
    truth, sensor = through_the_door(), SpinningSensor(beams=16, lowest_deg=-30, highest_deg=30)
    return truth, [scan(two_rooms(), T, sensor, seed=k) for k, T in enumerate(truth)]


def smoothed_poses(clouds: list[Array], start: Array, known: NDArray[np.bool_] | None = None) -> Array:
    """(N, 4, 4) the poses of snapshots, from those they start with (N, 4, 4)."""
    settings, known = TrackingSettings(), np.ones(len(clouds), bool) if known is None else known
    used = [thinned(cloud, None, second, 0.1, settings)[0] for cloud, second in zip(clouds, AT, strict=True)]
    motion = smoothed(used, Motion(AT, start.copy()), known, settings)
    return np.stack([motion.at(second) for second in AT])


def off(poses: Array, truth: Array) -> Array:
    """(N,) metres, but for what all have in common: the map's frame is that of the poses at the start."""
    error = poses[:, :3, 3] - truth[:, :3, 3]
    return np.asarray(np.linalg.norm(error - np.median(error, axis=0), axis=1))


def test_scattered_poses_settle_where_they_agree(walk: tuple[Array, list[Array]]) -> None:
    truth, clouds = walk
    rng = np.random.default_rng(0)
    start = np.stack([T @ pose(*rng.normal(0, 0.03, 3), yaw=rng.normal(0, 0.01)) for T in truth])
    found = off(smoothed_poses(clouds, start), truth)
    assert np.median(found) < 0.4 * np.median(off(start, truth)) and found.max() < 0.05


def test_a_height_that_nothing_shows_follows_from_before_and_after(walk: tuple[Array, list[Array]]) -> None:
    truth, start, clouds = walk[0], walk[0].copy(), list(walk[1])
    for k in range(20, 30):
        z = clouds[k][:, 2] + truth[k, 2, 3]
        clouds[k] = clouds[k][(z > 0.9) & (z < 1.9)]
    start[20:30, 2, 3] += 0.3 * np.sin(np.linspace(0, np.pi, 10))
    assert off(start, truth).max() > 0.25
    assert off(smoothed_poses(clouds, start), truth).max() < 0.06


def test_a_lost_scan_makes_no_part_of_the_map_and_is_found(walk: tuple[Array, list[Array]]) -> None:
    truth, start = walk[0], walk[0].copy()
    start[25] = truth[25] @ pose(0.3, 0.2, 0.0, yaw=0.1)
    assert off(smoothed_poses(walk[1], start, np.arange(50) != 25), truth)[25] < 0.05


def test_scans_without_points_follow_the_motion(walk: tuple[Array, list[Array]]) -> None:
    truth, start, clouds = walk[0], walk[0].copy(), list(walk[1])
    start[25:28, :3, 3] += 0.3
    clouds[25:28] = [np.empty((0, 3))] * 3
    assert off(smoothed_poses(clouds, start), truth).max() < 0.06
