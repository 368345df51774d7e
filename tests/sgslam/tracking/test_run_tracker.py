"""What the tracker of a run takes: odometries of a caller, poses for all scans or some, and scans that are refused."""

import functools
from copy import deepcopy
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import pytest
from boxes import Array, pose, scan
from carried_off import carried_off
from test_gravity import two_rooms

from data import UserError
from sgslam.config import Config, OdometrySettings
from sgslam.geometry.frames import inverse
from sgslam.odometry import Odometry, make_odometry
from sgslam.registration import Registration
from sgslam.tracking import CarriedElsewhere, RunTracker, TrackedScan
from sgslam.tracking.run_tracker import TrackingStep

PERIOD_NS = 10**8


class Recorded:
    """The odometry of the settings, as a caller passes it, with the stamps that it got since its state is what it
    is."""

    def __init__(self) -> None:
        config = Config()
        self.stamps: list[int] = []
        self._odometry: Odometry = make_odometry(config.odometry, config.tracking)

    def register(self, stamp_ns: int, points: Array, point_times: Array | None = None) -> Registration:
        self.stamps.append(stamp_ns)
        return self._odometry.register(stamp_ns, points, point_times)

    def rejoin(self, other: Odometry) -> bool:
        return False

    def state(self) -> dict[str, Any]:
        return {"stamps": self.stamps, "odometry": self._odometry.state()}

    def restore(self, state: Any) -> None:
        self.stamps = state["stamps"]
        self._odometry.restore(state["odometry"])

    def __getattr__(self, name: str) -> Any:
        return getattr(self._odometry, name)


class Stateless(Recorded):
    """One that cannot forget its scans."""

    def state(self) -> dict[str, Any]:
        raise NotImplementedError


def steps_of(tracker: RunTracker) -> list[TrackingStep]:
    """Of the scans of a sensor that is carried off."""
    steps = [step for stamp, points in carried_off() for step in tracker.track(stamp, points, np.zeros(len(points)))]
    return [*steps, *tracker.release()]


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Recorded, Stateless])
def test_an_odometry_of_the_caller_never_gets_an_old_scan(kind: type[Recorded]) -> None:
    """After the sensor was carried elsewhere, it tracks as the one of the settings does: from the beginning."""
    odometry = kind()
    steps = steps_of(RunTracker(Config(), odometry))
    assert all(a < b for a, b in pairwise(odometry.stamps))
    begins = [step.since_ns for step in steps if isinstance(step, CarriedElsewhere)]
    assert begins == ([odometry.stamps[0]] if kind is Recorded else []) and odometry.stamps[-1] == 57 * PERIOD_NS
    there = [step for step in steps[-30:] if isinstance(step, TrackedScan)] if begins else []
    moved = [float(np.linalg.norm((inverse(a.T_odom_sensor) @ b.T_odom_sensor)[:3, 3])) for a, b in pairwise(there)]
    assert all(metres < 0.06 for metres in moved) and len(there) in (0, 30)


@functools.cache
def way() -> tuple[list[Array], list[Array]]:
    """Poses of a walk in one of two rooms, and scans there."""
    poses = [pose(1.5 + 0.04 * k, 2.0 + 0.01 * k, 1.3, 0.02 * k) for k in range(50)]
    return poses, [scan(two_rooms(), T, seed=k) for k, T in enumerate(poses)]


WITH_POSE = {
    "begin late": range(25, 50), "end early": range(25), "gap": [*range(20), *range(35, 50)],
    "every third": range(0, 50, 3),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("which", WITH_POSE)
@pytest.mark.parametrize("given", ["exact", "measured"])
def test_poses_for_some_scans_are_measured_or_refused_and_odom_never_jumps(
    which: str, given: Literal["exact", "measured"]
) -> None:
    """Those given are in a frame that is 100 m away."""
    poses, scans = way()
    tracker, steps = RunTracker(Config(odometry=OdometrySettings(given=given))), []
    elsewhere, kept = pose(100.0, -50.0, 3.0, 2.0), list[int]()
    for k, (T, points) in enumerate(zip(poses, scans, strict=True)):
        T_odom_sensor = elsewhere @ T if k in WITH_POSE[which] else None
        differs = given == "exact" and (k in WITH_POSE[which]) != (0 in WITH_POSE[which])
        if differs:
            with pytest.raises(UserError, match=rf"scan at {k * PERIOD_NS} ns.*T_odom_sensor.*odometry.given=measured"):
                tracker.track(k * PERIOD_NS, points, np.zeros(len(points)), T_odom_sensor)
        else:
            steps += tracker.track(k * PERIOD_NS, points, np.zeros(len(points)), T_odom_sensor)
            kept.append(k)
    found = [step for step in [*steps, *tracker.release()] if isinstance(step, TrackedScan)]
    assert [step.raw.stamp_ns // PERIOD_NS for step in found] == kept
    for k, step in zip(kept, found, strict=True):
        true = inverse(poses[kept[0]]) @ poses[k]
        assert np.linalg.norm((inverse(found[0].T_odom_sensor) @ step.T_odom_sensor - true)[:3, 3]) < 0.08
        assert step.health != "lost"


BAD: dict[str, dict[str, Any]] = {
    "times": {"point_times": np.array([0.0])}, "milliseconds": {"point_times": [99.0]},
    "covariance": {"step_covariance": -np.eye(6)}, "pose": {"T_odom_sensor": 2 * np.eye(4)},
    "no pose": {"T_odom_sensor": None},
}  # fmt: skip


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("given", ["exact", "measured"])
def test_a_refused_scan_changes_nothing_and_may_come_again(bad: str, given: Literal["exact", "measured"]) -> None:
    poses, scans = (found[:6] for found in way())
    tracker = RunTracker(Config(odometry=OdometrySettings(given=given)))
    for k, (T, points) in enumerate(zip(poses, scans, strict=True)):
        if not (bad == "no pose" and (k == 0 or given == "measured")):
            before = deepcopy(tracker.state())
            arguments = {"point_times": np.zeros(len(points)), "T_odom_sensor": T, **BAD[bad]}
            if bad == "milliseconds":
                arguments["point_times"] = np.full(len(points), 99.0)
            with pytest.raises(UserError, match=f"scan at {k * PERIOD_NS} ns"):
                tracker.track(k * PERIOD_NS, points, **arguments)
            np.testing.assert_equal(tracker.state()["given"], before["given"])
            assert tracker.newest_ns == before["newest_ns"]
        tracker.track(k * PERIOD_NS, points, np.zeros(len(points)), T)
    assert len([step for step in tracker.release() if isinstance(step, TrackedScan)]) == 6


@pytest.mark.slow
def test_lists_serve_as_arrays() -> None:
    """Also where the sensor is carried elsewhere."""
    tracker, lists = RunTracker(Config()), RunTracker(Config())
    steps = []
    for stamp, points in carried_off():
        steps += lists.track(stamp, points, [0.0] * len(points))  # type: ignore[arg-type]
        assert lists.times_of(points, [0.0] * len(points)) is not None  # type: ignore[arg-type]
    found, expected = [*steps, *lists.release()], steps_of(tracker)
    assert len(found) == len(expected) and any(isinstance(step, CarriedElsewhere) for step in found)
    for a, b in zip(found, expected, strict=True):
        if isinstance(a, TrackedScan) and isinstance(b, TrackedScan):
            assert np.array_equal(a.T_odom_sensor, b.T_odom_sensor)
