"""Which sights show a wall askew, whatever the keyframes' own errors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sgslam.backend.wall_outliers import wall_outliers
from sgslam.mapping.wall_map import SeenWall

WALLS = (0.0, np.pi / 2, np.pi, -np.pi / 2, 0.3)  # headings of normals, map frame


def rotations(yaws: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(np.outer(yaws, [0.0, 0.0, 1.0])).as_matrix()


def sights(true: np.ndarray, wrong: dict[tuple[int, int], float], sigma: float = 0.002) -> list[SeenWall]:
    """All walls from keyframes of these yaws; of (keyframe, wall) turned by so many radians."""
    found = []
    for k, yaw in enumerate(true):
        for w, heading in enumerate(WALLS):
            at = heading - yaw + wrong.get((k, w), 0.0)
            plane = np.array([np.cos(at), np.sin(at), 0.0, 1.0])
            found.append(SeenWall(k, w, plane, np.zeros((2, 3)), (0.1, 2.0), sigma, 0.003))
    return found


@pytest.mark.parametrize("own", [0.0, 0.2])
def test_one_sight_is_askew_and_a_keyframe_that_is_turned_has_none(own: float) -> None:
    true = np.linspace(0, 3, 30)
    believed = true + own * (np.arange(30) == 7)
    seen = sights(true, {(7, 4): np.radians(4), (9, 1): np.radians(1)})
    found = wall_outliers(seen, rotations(believed))
    assert [(s.keyframe, s.wall) for s, out in zip(seen, found, strict=True) if out] == [(7, 4)]


def test_what_was_seen_badly_may_be_off() -> None:
    seen = sights(np.zeros(20), {(7, 4): np.radians(4)}, sigma=0.02)
    assert not wall_outliers(seen, rotations(np.zeros(20))).any()


def test_several_sights_of_a_keyframe_that_are_turned_tell_of_the_keyframe() -> None:
    """It sees two walls again that were mapped long ago, turned by the drift since, and three that are new."""
    seen = sights(np.zeros(20), {(7, 3): np.radians(5), (7, 4): np.radians(5)})
    assert not wall_outliers(seen, rotations(np.zeros(20))).any()


def test_of_a_map_that_is_bent_nobody_knows() -> None:
    """Where the estimates turn as an odometry drifts that nothing corrected yet."""
    true, rng = np.zeros(40), np.random.default_rng(0)
    wrong = {(k, w): rng.normal(0, 0.2) for k in range(40) for w in range(5)}
    assert not wall_outliers(sights(true, wrong), rotations(true)).any()
    assert wall_outliers([], rotations(true)).shape == (0,)
