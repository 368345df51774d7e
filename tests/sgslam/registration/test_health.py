"""How good a scan is: in rooms and corridors, and its limits from both sides; what is just at a limit is within it."""

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from boxes import Box, pose, room, scan, scene_of
from walks import CORRIDOR, FURNISHED, SCAN_NS, furnished, straight, ways_off

from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.registration.health import judged
from sgslam.registration.window import Solved
from sgslam.types import Registration

Driven = tuple[list[Registration], dict[str, Any]]  # the results and the state
SURE = 1e-6 * np.eye(6)


def solved(found: int = 1000, close: int = 1000, off: float = 0.0, turned: float = 0.0) -> Solved:
    """A window whose last knot is so many metres and radians off the predicted one; 3 mm and mrad are its sigma."""
    predicted, information = np.tile(np.eye(4), (2, 1, 1)), 1e6 * np.eye(12)
    knots = np.stack([np.eye(4), pose(off, 0, 0, turned)])
    planes = np.zeros(1000, np.int32)
    return Solved(
        np.array([0.0, 0.1]), knots, predicted, information, 0.9 * information, planes, found, close, 0.01, 3, True, 0.1
    )


def health(window: Solved, relative: float = 1.0, was_lost: bool = False, **settings: Any) -> str:
    return judged(window, SURE, relative, was_lost, TrackingSettings(**settings))[0]


@pytest.mark.parametrize(
    ("found", "close", "within", "beyond", "was_lost"),
    [
        (450, 440, 0.4, 0.399, False),  # much less that is known than before
        (450, 440, 0.85, 0.849, True),  # found again only where it fits as usual
        (1000, 700, 0.4, 0.3, False),
    ],
)
def test_a_scan_is_lost_by_its_share(found: int, close: int, within: float, beyond: float, was_lost: bool) -> None:
    assert health(solved(found, close), within, was_lost) == "good"
    assert health(solved(found, close), beyond, was_lost) == "lost"
    assert health(solved(1000, 699), 1.0, was_lost) == "lost"  # the points contradict surfaces


@pytest.mark.parametrize(
    ("off", "turned", "expected"),
    [(0.0244, 0.0, "good"), (0.0246, 0.0, "lost"), (0.0, 0.0244, "good"), (0.0, 0.0246, "lost"), (0.02, 0.02, "lost")],
)
def test_a_scan_is_lost_where_its_pose_contradicts_the_prediction(off: float, turned: float, expected: str) -> None:
    assert health(solved(off=off, turned=turned)) == expected  # squares of 7.75 sigmas are 60


@pytest.mark.parametrize(("axis", "limit"), [(0, 0.03), (2, 0.03), (3, 0.1), (5, 0.1)])
def test_a_direction_that_is_not_constrained_degrades_a_scan(axis: int, limit: float) -> None:
    """A sensor that was lost is not found by a pose that may be anywhere along some direction."""
    covariance = SURE.copy()
    for share, lost, expected in ((0.99, 0, "good"), (0.99, 1, "good"), (1.01, 0, "degraded"), (1.01, 1, "lost")):
        covariance[axis, axis] = (share * limit) ** 2
        found, weak = judged(solved(), covariance, 1.0, bool(lost), TrackingSettings())
        assert found == expected
        assert np.abs(weak) == pytest.approx(np.eye(6)[[axis] if found == "degraded" else []])
    settings = TrackingSettings(degraded_rotation=0.25, degraded_translation=0.25)  # squares without rounding
    covariance[axis, axis] = 0.25**2
    assert judged(solved(), covariance, 1.0, False, settings)[0] == "good"


def test_points_are_truer_than_their_weights_where_they_tell_something() -> None:
    """They tell nothing of the height, which is as uncertain as it was predicted."""
    predicted, measured = 1e2 * np.eye(12), np.diag(np.tile([1e6, 1e6, 1e6, 1e6, 1e6, 0.0], 2))
    window = replace(
        solved(), information=predicted + measured, measured=measured, plane_of=np.arange(1000, dtype=np.int32)
    )
    weighted, true = (np.diag(C) for C in window.covariances_in_sensor(1, steady=True))
    assert 0.05 < window.variance_factor < 0.2
    assert true / weighted == pytest.approx([window.variance_factor] * 5 + [1.0], rel=1e-2)
    assert true[5] == pytest.approx(1e-2)
    of_few_planes = replace(window, plane_of=np.repeat(np.arange(20, dtype=np.int32), 50))
    assert of_few_planes.variance_factor > 2 * window.variance_factor


@pytest.mark.parametrize("yaw", [0.0, 0.5])
@pytest.mark.parametrize(
    ("more", "spurious", "expected"),
    [
        ([], 3.0, "degraded"),
        ([], 0.0, "good"),  # errors of the normals feign that the walls show the place along them
        ([(5, -1.2, 0, 5.2, 1.2, 2.6)], 3.0, "good"),  # its end is in sight
    ],
)
def test_along_a_bare_corridor_a_scan_is_degraded(more: list[Box], spurious: float, expected: str, yaw: float) -> None:
    settings = TrackingSettings(spurious=spurious, degraded_translation=0.2)  # m; measured 0.1 and 0.57 along the walls
    odometry, scene = ContinuousTimeOdometry(settings), scene_of([*CORRIDOR, *more])
    for k in range(8):
        found = odometry.register(k * SCAN_NS, scan(scene, pose(0.05 * k, 0.0, 1.2, yaw), seed=k))
    assert found.health == expected
    along = np.abs(found.unconstrained @ [0, 0, 0, np.cos(yaw), -np.sin(yaw), 0])
    assert along == pytest.approx([1.0] if expected == "degraded" else [], abs=0.01)


@pytest.fixture(scope="module")
def driven() -> Driven:
    """Of an odometry that is lost after a steady drive."""
    odometry, poses = ContinuousTimeOdometry(TrackingSettings()), straight(25)
    found = [odometry.register(SCAN_NS * k, scan(furnished(), T, seed=k)) for k, T in enumerate(poses)]
    assert {result.health for result in found} == {"good"}
    assert ways_off(found, poses).max() < 0.02  # m; measured 0.005 at the end
    odometry.level(np.array([0.0, 0.0, 1.0]))
    covered = np.random.default_rng(0).uniform(0.4, 0.8, (2000, 3))
    assert odometry.register(25 * SCAN_NS, covered).health == "lost"
    return found, odometry


@pytest.mark.parametrize(("x", "y", "yaw", "near"), [(2.5, 2.9, -1.2, True), (3.3, 1.6, -1.2, True), (12, 2, 0, False)])
def test_a_lost_sensor_is_found_again_near_by_only(driven: Driven, x: float, y: float, yaw: float, near: bool) -> None:
    lost, other = deepcopy(driven[1]), ContinuousTimeOdometry(TrackingSettings())
    scene = scene_of([*FURNISHED, *room(11, 0, 14, 9), (12, 5, 0, 13, 6, 1.2)])
    after = [pose(x + 0.03 * k, y, 0.9, yaw + 0.02 * k, 0.1, 0.1) for k in range(8)]
    scans = [scan(scene, T, seed=50 + k) for k, T in enumerate(after)]
    for k, points in enumerate(scans[:7], 25):
        other.register(k * SCAN_NS, points)
    assert lost.rejoin(other) is near
    found = lost.register(32 * SCAN_NS, scans[7])
    assert (found.health == "good") is near
    assert not near or ways_off([driven[0][0], found], [straight(1)[0], after[7]])[1] < 0.05  # m; measured 0.01
