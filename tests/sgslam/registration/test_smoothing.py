"""All scans of a run registered again in one smoothing: what is seen later mends what was wrong before."""

import numpy as np
import pytest
from boxes import Box, pose, room, scan, scene_of
from numpy.typing import NDArray

from data.simulation import SpinningSensor
from sgslam.config import TrackingSettings
from sgslam.registration import Motion
from sgslam.registration.sampling import TimedPoints, thinned
from sgslam.registration.smoothing import smoothed

Floats = NDArray[np.float64]
PERIOD = 0.2  # s
SENSOR = SpinningSensor(beams=16, lowest_deg=-30, highest_deg=30)
WALLS_ONLY = slice(20, 30)  # scans, in the test of those that see nothing level


WALL: list[Box] = [(4.9, 0, 0, 5.0, 2.5, 2.6), (4.9, 3.4, 0, 5.0, 6, 2.6), (4.9, 2.5, 2.1, 5.0, 3.4, 2.6)]  # a door


@pytest.fixture(scope="module")
def walk() -> tuple[Floats, list[Floats]]:
    """True poses (50, 4, 4) from one room into another, and the scans' points."""
    x = np.linspace(2.0, 7.0, 50)
    y = 2.95 + 0.8 * np.sin((x - 4.95) / 1.5)
    truth = np.stack([pose(a, b, 1.3, yaw=c) for a, b, c in zip(x, y, np.gradient(y, x), strict=True)])
    scene = scene_of([*room(0, 0, 10, 6), *WALL])
    return truth, [scan(scene, T, SENSOR, seed=k) for k, T in enumerate(truth)]


def used(clouds: list[Floats]) -> list[TimedPoints]:
    """As snapshots, one each period."""
    return [thinned(cloud, None, k * PERIOD, 0.1, TrackingSettings())[0] for k, cloud in enumerate(clouds)]


def smoothed_poses(clouds: list[Floats], start: Floats, known: NDArray[np.bool_] | None = None) -> Floats:
    """(N, 4, 4) the poses of scans, from those they start with (N, 4, 4)."""
    at = np.arange(len(clouds)) * PERIOD
    known = np.ones(len(clouds), bool) if known is None else known
    motion = smoothed(used(clouds), Motion(at, start.copy()), known, TrackingSettings())
    return np.stack([motion.at(second) for second in at])


def off(poses: Floats, truth: Floats) -> Floats:
    """(N,) metres, but for what all have in common: the map's frame is that of the poses at the start."""
    error = poses[:, :3, 3] - truth[:, :3, 3]
    return np.asarray(np.linalg.norm(error - np.median(error, axis=0), axis=1))


@pytest.mark.parametrize("seed", range(3))
def test_scattered_poses_settle_where_they_agree(walk: tuple[Floats, list[Floats]], seed: int) -> None:
    truth, clouds = walk
    rng = np.random.default_rng(seed)
    start = np.stack([T @ pose(*rng.normal(0, 0.03, 3), yaw=rng.normal(0, 0.01)) for T in truth])
    found = smoothed_poses(clouds, start)
    assert np.median(off(found, truth)) < 0.4 * np.median(off(start, truth))
    assert off(found, truth).max() < 0.05


def test_a_height_that_nothing_shows_follows_from_before_and_after(walk: tuple[Floats, list[Floats]]) -> None:
    truth, clouds = walk
    clouds, start = list(clouds), truth.copy()
    for k in range(*WALLS_ONLY.indices(len(truth))):
        z = clouds[k][:, 2] + truth[k, 2, 3]
        clouds[k] = clouds[k][(z > 0.9) & (z < 1.9)]
    start[WALLS_ONLY, 2, 3] += 0.3 * np.sin(np.linspace(0, np.pi, 10))
    found = smoothed_poses(clouds, start)
    assert off(start, truth).max() > 0.25
    assert off(found, truth).max() < 0.06


def test_a_lost_scan_makes_no_part_of_the_map_and_is_found(walk: tuple[Floats, list[Floats]]) -> None:
    truth, clouds = walk
    start, known = truth.copy(), np.ones(len(truth), bool)
    start[25] = truth[25] @ pose(0.3, 0.2, 0.0, yaw=0.1)
    known[25] = False
    found = smoothed_poses(clouds, start, known)
    assert off(found, truth)[25] < 0.05


def test_scans_without_points_follow_the_motion(walk: tuple[Floats, list[Floats]]) -> None:
    truth, clouds = walk
    start = truth.copy()
    start[25:28, :3, 3] += 0.3
    empty = [np.empty((0, 3)) if 25 <= k < 28 else cloud for k, cloud in enumerate(clouds)]
    found = smoothed_poses(empty, start)
    assert np.isfinite(found).all()
    assert off(found, truth).max() < 0.06
