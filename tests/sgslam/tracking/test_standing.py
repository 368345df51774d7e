"""A robot that stands still for long: its map neither grows nor drifts, and a moving one's is as fine as ever."""

import numpy as np
import pytest
from drives import small_drive

from sgslam.config import KeyframeSettings
from sgslam.mapping import KeyframeRule
from sgslam.slam import SceneGraphSlam


def test_keyframes_of_an_hours_standing_are_few() -> None:
    """After a walk, and before the walk back."""
    way = np.tile(np.eye(4), (100, 1, 1))
    way[:, 0, 3] = np.arange(100) * 0.08
    hour = np.repeat(way[-1:], 36_000, axis=0)
    hour[:, :2, 3] += np.random.default_rng(0).normal(0.0, 0.003, (len(hour), 2))
    rule = KeyframeRule(KeyframeSettings())
    taken = np.array([rule.wants(place) for place in np.concatenate([way, hour, way[::-1]])])
    assert taken[100:-100].sum() < 12
    # as soon as it moves on they come as they did before
    assert taken[-99:].sum() == pytest.approx(taken[1:100].sum(), abs=1)


@pytest.mark.long
def test_the_graph_stands_still_with_the_robot() -> None:
    drive = small_drive()
    (_, seen), rng, slam, found, keyframes = drive.scans[0], np.random.default_rng(1), SceneGraphSlam(drive.bim), [], []
    for k in range(400):
        noise = rng.normal(0.0, 0.02, (len(seen), 1)) / np.linalg.norm(seen, axis=1, keepdims=True)
        update = slam.add_scan(k * 100_000_000, seen * (1 + noise))
        found.append(update.T_map_sensor[:3, 3])
        keyframes.append(update.keyframes)
    assert np.linalg.norm(np.mean(found[-100:], axis=0) - np.mean(found[:100], axis=0)) < 0.005
    assert np.linalg.norm(found, axis=1).max() < 0.04
    assert keyframes[-1] <= keyframes[200] + 1
    trajectory = slam.finish().trajectory_map
    assert len(trajectory) == 400 and np.abs(trajectory.positions).max() < 0.04
