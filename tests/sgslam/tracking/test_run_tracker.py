"""What the tracker of a run takes: odometries of a caller, poses for all scans or some, and scans that are refused."""

import functools
from collections.abc import Callable
from copy import deepcopy
from typing import Any, Literal

import numpy as np
import pytest
from boxes import Array, pose, scan
from walks import SCAN_NS, from_file, two_rooms

from data import UserError
from sgslam.config import Config, OdometrySettings
from sgslam.tracking import RunTracker
from sgslam.types import TrackedScan

Given = Literal["exact", "measured"]


class Recorded:
    """One of a caller, in a frame of its own; with the stamps that it got since its state is what it is."""

    def __init__(self, poses: list[Array]) -> None:
        self.poses = poses
        self.stamps: list[int] = []

    def locate(self, stamp_ns: int, points: Array, point_times: Array | None = None) -> Array:
        self.stamps.append(stamp_ns)
        return pose(100.0, -50.0, 3.0, 2.0) @ self.poses[stamp_ns // SCAN_NS]


@pytest.mark.slow
@pytest.mark.parametrize("given", ["exact", "measured"])
def test_an_odometry_of_the_caller_gets_each_scan_once_and_its_poses_are_given_ones(given: Given) -> None:
    """Lists serve as arrays. A restored tracker goes on alike."""
    (poses, scans), config = way(), Config(odometry=OdometrySettings(given=given))
    odometry = Recorded(poses)
    tracker, steps = RunTracker(config, odometry), list[TrackedScan]()
    for k, points in enumerate(scans):
        if k == 25:
            tracker, odometry = deepcopy((tracker, odometry))
        steps += tracker.track(k * SCAN_NS, points, [0.0] * len(points))  # type: ignore[arg-type]
    with pytest.raises(UserError, match="has a T_odom_sensor, unlike those before"):
        tracker.track(len(scans) * SCAN_NS, points, T_odom_sensor=np.eye(4))
    steps += tracker.release()
    assert odometry.stamps == [k * SCAN_NS for k in range(len(scans))]
    found = np.stack([step.T_odom_sensor for step in steps])
    true, most = np.linalg.inv(poses[0]) @ np.stack(poses), 1e-6 if given == "exact" else 0.05
    assert np.linalg.norm((np.linalg.inv(found[0]) @ found - true)[:, :3, 3], axis=1).max() < most


def test_a_pose_that_is_none_is_refused() -> None:
    scans = way()[1]
    tracker = RunTracker(Config(), Recorded([2.0 * np.eye(4)]))
    with pytest.raises(UserError, match="scan at 0 ns: the odometry's pose must be"):
        tracker.track(0, scans[0])


@functools.cache
def way() -> tuple[list[Array], list[Array]]:
    """Poses of a walk in one of two rooms, and scans there."""
    poses = [pose(1.5 + 0.04 * k, 2.0 + 0.01 * k, 1.3, 0.02 * k) for k in range(50)]
    return poses, [scan(two_rooms(), T, seed=k) for k, T in enumerate(poses)]


@pytest.mark.slow
@pytest.mark.parametrize("with_pose", [range(25, 50), [*range(20), *range(35, 50)]])
@pytest.mark.parametrize("given", ["exact", "measured"])
def test_poses_for_some_scans_are_measured_or_refused_and_odom_never_jumps(with_pose: list[int], given: Given) -> None:
    """They begin late or have a gap, 100 m off. A restored tracker goes on alike."""
    (poses, scans), elsewhere = way(), pose(100.0, -50.0, 3.0, 2.0)
    config = Config(odometry=OdometrySettings(given=given))
    trackers, steps, kept = [RunTracker(config)], (list[TrackedScan](), list[TrackedScan]()), list[int]()
    for k, (T, points) in enumerate(zip(poses, scans, strict=True)):
        arguments = points, np.zeros(len(points)), elsewhere @ T if k in with_pose else None
        if given == "exact" and (k in with_pose) != (0 in with_pose):
            with pytest.raises(UserError, match=rf"scan at {k * SCAN_NS} ns.*T_odom_sensor.*odometry.given=measured"):
                trackers[0].track(k * SCAN_NS, *arguments)
            continue
        kept.append(k)
        if k > 20 and len(trackers) == 1:
            trackers.append(from_file(trackers[0]))
        for tracker, own in zip(trackers, steps, strict=False):
            own += tracker.track(k * SCAN_NS, *arguments)
    found, again = ([*own, *tracker.release()] for tracker, own in zip(trackers, steps, strict=True))
    assert [step.raw.stamp_ns // SCAN_NS for step in found] == kept
    assert all(step.health != "lost" for step in found)
    assert given == "exact" or all(step.raw.T_odom_sensor is None for step in found)  # registered, not taken as it is
    T_odom, T_again = (np.stack([step.T_odom_sensor for step in part]) for part in (found, again))
    assert np.array_equal(T_odom[-len(T_again) :], T_again)
    true = np.linalg.inv(poses[kept[0]]) @ np.stack([poses[k] for k in kept])
    assert np.linalg.norm((np.linalg.inv(T_odom[0]) @ T_odom - true)[:, :3, 3], axis=1).max() < 0.08


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("point_times", lambda points: [0.0]),
        ("point_times", lambda points: np.full(len(points), 99.0)),  # milliseconds
        ("step_covariance", lambda points: -np.eye(6)),
        ("T_odom_sensor", lambda points: 2 * np.eye(4)),
        ("T_odom_sensor", lambda points: None),
    ],
)
@pytest.mark.parametrize("given", ["exact", "measured"])
def test_a_refused_scan_may_come_again(name: str, bad: Callable[[Array], Any], given: Given) -> None:
    tracker = RunTracker(Config(odometry=OdometrySettings(given=given)))
    for k, (T, points) in enumerate(zip(*(found[:6] for found in way()), strict=True)):
        good = {"point_times": np.zeros(len(points)), "T_odom_sensor": T}
        if bad(points) is not None or (k > 0 and given == "exact"):
            before, arguments = deepcopy(tracker), {**good, name: bad(points)}
            with pytest.raises(UserError, match=f"scan at {k * SCAN_NS} ns"):
                tracker.track(k * SCAN_NS, points, **arguments)
            np.testing.assert_equal(vars(tracker.motion.given), vars(before.motion.given))
            assert tracker.newest_ns == before.newest_ns
        tracker.track(k * SCAN_NS, points, **good)
    assert len(tracker.release()) == 6
