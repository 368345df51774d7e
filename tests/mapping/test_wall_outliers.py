"""Wall outliers: observations at a wrong angle, whatever the errors of the keyframes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sgslam.backend.wall_outliers import wall_outliers
from sgslam.mapping import SeenWall

WALLS = (0.0, np.pi / 2, np.pi, -np.pi / 2, 0.3)  # headings of normals, map frame


def rotations(yaws: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(np.outer(yaws, [0.0, 0.0, 1.0])).as_matrix()


def observations(true: np.ndarray, wrong: dict[tuple[int, int], float], sigma: float = 0.002) -> list[SeenWall]:
    """All walls seen from keyframes with these yaws; `wrong` gives the error (rad) of a (keyframe, wall)."""
    found = []
    for k, yaw in enumerate(true):
        for w, heading in enumerate(WALLS):
            at = heading - yaw + wrong.get((k, w), 0.0)
            plane = np.array([np.cos(at), np.sin(at), 0.0, 1.0])
            found.append(SeenWall(k, w, plane, np.zeros((2, 3)), (0.1, 2.0), sigma, 0.003))
    return found


@pytest.mark.parametrize("own", [0.0, 0.2])
def test_one_observation_is_an_outlier_and_a_rotated_keyframe_has_none(own: float) -> None:
    true = np.linspace(0, 3, 30)
    believed = true + own * (np.arange(30) == 7)
    seen = observations(true, {(7, 4): np.radians(4), (9, 1): np.radians(1)})
    found = wall_outliers(seen, rotations(believed))
    assert [(s.keyframe, s.wall) for s, out in zip(seen, found, strict=True) if out] == [(7, 4)]


def test_an_uncertain_observation_is_no_outlier() -> None:
    seen = observations(np.zeros(20), {(7, 4): np.radians(4)}, sigma=0.02)
    assert not wall_outliers(seen, rotations(np.zeros(20))).any()


def test_several_rotated_observations_of_one_keyframe_are_no_outliers() -> None:
    """It sees two walls again that were mapped long ago, turned by the drift since, and three that are new."""
    seen = observations(np.zeros(20), {(7, 3): np.radians(5), (7, 4): np.radians(5)})
    assert not wall_outliers(seen, rotations(np.zeros(20))).any()


def test_a_map_that_has_drifted_has_no_outliers() -> None:
    """The estimates rotate with an odometry whose drift was not corrected yet."""
    true, rng = np.zeros(40), np.random.default_rng(0)
    wrong = {(k, w): rng.normal(0, 0.2) for k in range(40) for w in range(5)}
    assert not wall_outliers(observations(true, wrong), rotations(true)).any()
    assert wall_outliers([], rotations(true)).shape == (0,)
