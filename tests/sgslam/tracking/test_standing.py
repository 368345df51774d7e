"""A robot that stands still for long: its map neither grows nor drifts, and a moving one's is as fine as ever."""

import numpy as np
import pytest
from boxes import Array
from drives import small_drive

from sgslam.config import KeyframeSettings
from sgslam.mapping import KeyframeRule
from sgslam.slam import SceneGraphSlam

NOISE = 0.02  # m along the beam
STILL = 400  # scans


@pytest.fixture(scope="module")
def places() -> Array:
    """T_map_sensor of a walk, an hour at 10 scans a second at its end, and the walk back."""
    way = np.tile(np.eye(4), (100, 1, 1))
    way[:, 0, 3] = np.arange(100) * 0.08
    hour = np.repeat(way[-1:], 36_000, axis=0)
    hour[:, :2, 3] += np.random.default_rng(0).normal(0.0, 0.003, (len(hour), 2))
    return np.concatenate([way, hour, way[::-1]])


def test_keyframes_of_an_hours_standing_are_few(places: Array) -> None:
    rule = KeyframeRule(KeyframeSettings())
    taken = np.array([rule.wants(place) for place in places])
    assert taken[100:-100].sum() < 12
    # as soon as it moves on they come as they did before
    assert taken[-99:].sum() == pytest.approx(taken[1:100].sum(), abs=1)


@pytest.mark.long
def test_the_graph_stands_still_with_the_robot() -> None:
    drive = small_drive()
    _, seen = drive.scans[0]
    rng, slam = np.random.default_rng(1), SceneGraphSlam(drive.bim)
    found, sizes = [], []
    for i in range(STILL):
        ranges = np.linalg.norm(seen, axis=1, keepdims=True)
        noisy = seen * (1 + rng.normal(0.0, NOISE, ranges.shape) / ranges)
        update = slam.add_scan(i * 100_000_000, noisy)
        found.append(update.T_map_sensor[:3, 3])
        if i in (STILL // 2, STILL - 1):
            sizes.append((update.keyframes, slam._map.backend.log.graph().size()))
    part = STILL // 4
    assert np.linalg.norm(np.mean(found[-part:], axis=0) - np.mean(found[:part], axis=0)) < 0.005
    assert np.linalg.norm(found, axis=1).max() < 0.04
    assert sizes[1][0] <= sizes[0][0] + 1  # in the second half one keyframe more
    result = slam.finish()
    assert np.abs(result.trajectory_map.positions).max() < 0.04
    assert len(result.trajectory) == STILL
