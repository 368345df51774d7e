"""Registration in continuous time, on scans of a sensor in a hand."""

from dataclasses import replace
from pathlib import Path

import boxes
import numpy as np
import pytest

from data.generation.demo_building import DEMO_STOREY, write_demo_building
from data.scans import Scan, ScanFolder
from data.simulation.carriers import HANDHELD, Shaken
from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from sgslam.config import Config, TrackingSettings
from sgslam.geometry.frames import inverse
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.odometry.timed import TimedOdometry
from sgslam.registration import Motion, Registration
from sgslam.tracking import CarriedElsewhere, RunTracker, TrackedScan

SECONDS = 12.0


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Scan], Trajectory]:
    folder = tmp_path_factory.mktemp("hand")
    write_demo_building(folder / "demo.ifc")
    simulate(
        folder / "demo.ifc", DEMO_STOREY, folder / "drive", 3, 2, 12.0, carrier=HANDHELD, seconds=SECONDS,
    )  # fmt: skip
    return list(ScanFolder(folder / "drive" / "scans")), Trajectory.read_tum(folder / "drive" / "truth.tum")


def tracked(scans: list[Scan], with_times: bool = True) -> list[Registration]:
    odometry = ContinuousTimeOdometry(TrackingSettings())
    return [odometry.register(s.stamp_ns, s.points, s.point_times if with_times else None) for s in scans]


def second_errors(found: list[Registration], truth: Trajectory) -> np.ndarray:
    """(N,) metres of the motion over ten scans."""
    poses = np.stack([f.T_odom_sensor for f in found])
    moved, true = inverse(poses[:-10]) @ poses[10:], inverse(truth.poses[:-10]) @ truth.poses[10:]
    return np.linalg.norm((inverse(true) @ moved)[:, :3, 3], axis=1)


def test_a_hand_is_followed_to_centimetres(drive: tuple[list[Scan], Trajectory]) -> None:
    scans, truth = drive
    found = tracked(scans)
    # over the drives of nine seeds it was 0.004 to 0.020, and 0.033 to 0.048 without the points' times
    assert np.median(second_errors(found, truth)) < 0.025
    assert {f.health for f in found} <= {"good", "degraded"}


def test_without_the_points_times_a_hand_is_followed_worse(drive: tuple[list[Scan], Trajectory]) -> None:
    scans, truth = drive
    told, untold = (np.median(second_errors(tracked(scans, times), truth)) for times in (True, False))
    assert told < untold


def test_a_sensor_that_turns_as_it_begins_is_followed(drive: tuple[list[Scan], Trajectory]) -> None:
    """The first scan is bent by an unknown motion, and the second one's attitude is known to a degree."""
    scans, truth = drive
    errors = []
    for begin in range(0, 110, 5):
        second = tracked(scans[begin : begin + 2])[1].T_odom_sensor
        off = second[:3, :3].T @ (inverse(truth.poses[begin]) @ truth.poses[begin + 1])[:3, :3]
        errors.append(np.degrees(np.arccos(np.clip((np.trace(off) - 1) / 2, -1.0, 1.0))))
    assert max(errors) < 2.0  # it was 0.8; 17 where the first scan's motion swung to and fro


def test_results_that_are_held_back_are_those_of_the_right_times(drive: tuple[list[Scan], Trajectory]) -> None:
    scans, _ = drive
    odometry = TimedOdometry(lambda: ContinuousTimeOdometry(TrackingSettings()), "auto")
    odometry.hold()
    for count, scan in enumerate(scans, 1):
        odometry.register(scan.stamp_ns, scan.points)
        assert len(odometry.held) == count
        if odometry.kind is not None:
            break
    assert odometry.kind == "order"
    rolling = TimedOdometry(lambda: ContinuousTimeOdometry(TrackingSettings()), "order")
    alone = [rolling.register(scan.stamp_ns, scan.points).T_odom_sensor for scan in scans[:count]]
    np.testing.assert_array_equal([found.T_odom_sensor for found in odometry.release()], alone)


def test_scans_are_put_right(drive: tuple[list[Scan], Trajectory]) -> None:
    """Points on their true places, but for the noise of the ranges."""
    scans, truth = drive
    found = tracked(scans)[-1]
    scan, T_bim_odom = scans[-1], truth.poses[len(scans) - 1] @ inverse(found.T_odom_sensor)
    assert scan.point_times is not None
    late = scan.point_times > 0.09
    T_true_end = truth.at(np.array([scan.stamp_ns + 95_000_000]))[0]
    at_stamp = T_bim_odom @ found.T_odom_sensor
    put_right = found.undistorted(scan.points)[late] @ at_stamp[:3, :3].T + at_stamp[:3, 3]
    true = scan.points[late] @ T_true_end[:3, :3].T + T_true_end[:3, 3]
    raw = scan.points[late] @ at_stamp[:3, :3].T + at_stamp[:3, 3]
    assert np.median(np.linalg.norm(put_right - true, axis=1)) < np.median(np.linalg.norm(raw - true, axis=1))


def test_one_that_is_restored_goes_on_alike(drive: tuple[list[Scan], Trajectory]) -> None:
    scans, _ = drive
    whole, again = (ContinuousTimeOdometry(TrackingSettings()) for _ in range(2))
    for scan in scans[:12]:
        whole.register(scan.stamp_ns, scan.points, scan.point_times)
    again.restore({name: value for name, value in whole.state().items()})
    assert again.surfels[0].tobytes() == whole.surfels[0].tobytes()


def test_a_scan_of_nothing_known_is_lost(drive: tuple[list[Scan], Trajectory]) -> None:
    """Points all about, instead of the next scan."""
    scans, _ = drive
    odometry = ContinuousTimeOdometry(TrackingSettings())
    for scan in scans[:20]:
        odometry.register(scan.stamp_ns, scan.points, scan.point_times)
    clutter = np.random.default_rng(0).uniform(-2, 2, (5000, 3))
    found = odometry.register(scans[20].stamp_ns, clutter, None)
    assert found.health == "lost"


@pytest.mark.parametrize("seed", range(3))
def test_a_sensor_between_high_walls_keeps_its_height(seed: int) -> None:
    """No scan sees floor or ceiling: without the direction of gravity, the height drifts."""
    shaft = boxes.scene_of([*boxes.room(0, 0, 6, 4, 60.0), (5, 3, 0, 6, 4, 60), (0, 1.5, 0, 0.5, 2.5, 60)])
    poses = [boxes.pose(1.5 + 0.03 * k, 2.0, 30.0, 0.02 * k) for k in range(100)]
    scans = [boxes.scan(shaft, T, seed=1000 * seed + k) for k, T in enumerate(poses)]
    off = {}
    for told in (True, False):
        odometry = ContinuousTimeOdometry(TrackingSettings())
        found = [odometry.register(0, scans[0])]
        if told:
            odometry.level(np.array([0.0, 0.0, 1.0]))
        found += [odometry.register(100_000_000 * k, scans[k]) for k in range(1, 100)]
        off[told] = max(abs(result.T_odom_sensor[2, 3]) for result in found)
    assert off[True] < 0.3 and off[True] < off[False]  # m; over five seeds 0.09 to 0.24, and 0.32 to 0.37


def test_looking_back_the_first_scans_are_found_in_the_later_map() -> None:
    """As if the sensor had slid by a metre in the first second, while its map was of a few scans."""
    scene = boxes.scene_of([*boxes.room(0, 0, 8, 5), (5, 0, 0, 5.3, 3, 1.2)])
    true = np.array([0.05, 0.02, 0.0]) * np.arange(45)[:, None]
    odometry, results = ContinuousTimeOdometry(TrackingSettings()), []
    odometry.level(np.array([0.0, 0.0, 1.0]))
    for k in range(45):
        points = boxes.scan(scene, boxes.pose(1.5 + true[k, 0], 2.0 + true[k, 1], 1.0), seed=k)
        results.append(odometry.register(k * 100_000_000, points))
    for k in range(10):
        T = results[k].T_odom_sensor.copy()
        T[0, 3] += 1.0 - k / 10
        results[k] = replace(results[k], T_odom_sensor=T, motion=Motion(results[k].motion.seconds, T[None]))
    found = odometry.look_back(results)
    places = np.stack([r.T_odom_sensor[:3, 3] for r in found])
    assert np.abs(places - places[-1] - (true - true[-1])).max() < 0.03
    assert found[30:] == results[30:]  # the frame is that of the later scans


def test_too_few_scans_are_not_looked_back_at() -> None:
    odometry = ContinuousTimeOdometry(TrackingSettings())
    scene = boxes.scene_of(boxes.room(0, 0, 6, 4))
    results = [odometry.register(k * 100_000_000, boxes.scan(scene, boxes.pose(2, 2), seed=k)) for k in range(33)]
    assert odometry.look_back(results) is results


def test_covariances_stay_symmetric(drive: tuple[list[Scan], Trajectory]) -> None:
    """What is not symmetric in a prior grows from window to window, until a run breaks off."""
    scans, _ = drive
    odometry = ContinuousTimeOdometry(TrackingSettings())
    for scan in scans:
        odometry.register(scan.stamp_ns, scan.points, scan.point_times)
        for belief in odometry._beliefs:
            assert np.array_equal(belief.covariance, belief.covariance.T)


@pytest.mark.parametrize(
    ("pause", "waits", "is_new_part"), [(0.9, False, False), (1.3, True, False), (1.7, True, False), (2.1, False, True)]
)
def test_a_pause_in_the_scans_counts_as_lost(
    drive: tuple[list[Scan], Trajectory], pause: float, waits: bool, is_new_part: bool
) -> None:
    """Even if the sensor seems to stand where it stood: it may be in another room that looks the same."""
    tracker, scan = RunTracker(Config()), replace(drive[0][40], point_times=None)
    stamps = [*(k / 10 for k in range(110)), *(10.9 + pause + k / 10 for k in range(20))]
    steps = [step for second in stamps for step in tracker.track(round(second * 1e9), scan.points)]
    parts = [step.since_ns / 1e9 for step in steps if isinstance(step, CarriedElsewhere)]
    assert parts == ([pytest.approx(10.9 + pause, abs=0.15)] if is_new_part else [])
    assert any(isinstance(step, TrackedScan) and step.unconfirmed for step in steps) == waits


def test_scans_that_always_come_rarely_are_no_pauses(drive: tuple[list[Scan], Trajectory]) -> None:
    standing = [replace(drive[0][40], stamp_ns=round(k * 2.5e9)) for k in range(8)]
    assert all(result.health != "lost" for result in tracked(standing, with_times=False))


def covered(scan: Scan) -> Scan:
    """The scan of a sensor under a cap."""
    ranges = np.linalg.norm(scan.points, axis=1, keepdims=True)
    return replace(scan, points=scan.points / ranges * 0.2)


@pytest.mark.parametrize("first", [0, 1, 40])
def test_a_covered_sensor_is_lost_until_it_sees_again(drive: tuple[list[Scan], Trajectory], first: int) -> None:
    scans, truth = drive
    under = range(first, first + 4)
    found = tracked([covered(scan) if k in under else scan for k, scan in enumerate(scans)])
    assert [k for k, f in enumerate(found) if f.health == "lost"] == list(under)
    after = found[first + 4 :]
    assert np.median(second_errors(after, Trajectory(truth.stamps_ns[first + 4 :], truth.poses[first + 4 :]))) < 0.025


@pytest.mark.slow
def test_a_shaken_sensor_is_followed(tmp_path: Path) -> None:
    write_demo_building(tmp_path / "demo.ifc")
    run = simulate(
        tmp_path / "demo.ifc", DEMO_STOREY, tmp_path / "drive", 2, 2, 12.0, carrier=Shaken(HANDHELD, 3.0, 5.0, 500.0),
        seconds=10.0,
    )  # fmt: skip
    found = np.stack([f.T_odom_sensor for f in tracked(list(ScanFolder(tmp_path / "drive" / "scans")))])
    truth = run.truth.poses[: len(found)]
    off = inverse(inverse(truth[:-1]) @ truth[1:]) @ inverse(found[:-1]) @ found[1:]
    lost = (np.linalg.norm(off[:, :3, 3], axis=1) > 0.2) | (np.trace(off[:, :3, :3], axis1=1, axis2=2) < 2.99)  # 6 deg
    assert lost.mean() < 0.05  # of four seeds it was 0.0; 0.57 without turned predictions
