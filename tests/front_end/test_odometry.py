"""The odometries against their contract, and what is each one's own."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from boxes import Array, pose
from commands import called
from drives import small_drive
from odometry_contract import SCAN_NS, OdometryContract, RegistrationContract, bow, from_file, off, way

from data import UserError
from data.trajectory import Trajectory
from sgslam.config import Config, OdometrySettings, TrackingSettings
from sgslam.geometry.frames import inverse, is_rigid
from sgslam.odometry import METHODS, Odometry, make_odometry
from sgslam.odometry.choice import choose
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.odometry.external import ExternalOdometry
from sgslam.odometry.given import GivenPoses
from sgslam.odometry.timed import TimedOdometry
from sgslam.registration import Registration
from sgslam.session import Checkpoints
from sgslam.session.checkpoints import load
from sgslam.slam import SceneGraphSlam

NS = 1_000_000_000


class TestContinuousTime(RegistrationContract):
    def make(self) -> Odometry:
        return made("continuous_time")


class TestKiss(RegistrationContract):
    step_error, end_turn = 0.02, 2.0
    rolling_end = 0.1  # m; 0.05 to 0.07 on different CPUs

    def make(self) -> Odometry:
        return made("kiss")


class TestSmallGicp(RegistrationContract):
    def make(self) -> Odometry:
        return made("small_gicp")


class TestGiven(OdometryContract):
    """By a trajectory of another rate, in a frame of its own."""

    def tracked(self, scans: list[Array], truth: list[Array]) -> list[Array]:
        T_odom_scene = pose(5.0, -3.0, 1.0, 2.0)
        stamps = np.arange(len(truth)) * SCAN_NS
        kept = [*range(0, len(stamps) - 1, 3), len(stamps) - 1]
        given = ExternalOdometry(Trajectory(stamps[kept], T_odom_scene @ np.stack(truth)[kept]))
        poses = GivenPoses(OdometrySettings())
        return [poses.register(int(stamp), given.at(int(stamp))).T_odom_sensor for stamp in stamps]


def made(method: str) -> Odometry:
    return make_odometry(OdometrySettings(method=method), TrackingSettings())  # type: ignore[arg-type]


def followed(given: list[Array]) -> list[Registration]:
    poses = GivenPoses(OdometrySettings())
    return [poses.register(i * SCAN_NS, T) for i, T in enumerate(given)]


def test_an_outlier_of_given_poses_is_ignored_and_told_once(caplog: pytest.LogCaptureFixture) -> None:
    truth = way()
    lifted = [T if i not in (10, 11, 17) else pose(3.0, 1.0) @ T for i, T in enumerate(truth)]
    found = followed(lifted)
    assert [i for i, result in enumerate(found) if result.health == "lost"] == [10, 17]
    # the second scan at the wrong place counts as a slip, the next one shows that it was none
    assert max(off(result.T_odom_sensor, T)[0] for result, T in zip(found, truth, strict=True)) < 0.05
    assert off(found[-1].T_odom_sensor, truth[-1])[0] < 1e-6
    assert caplog.text.count("outlier of 3.") == 1


def test_after_a_slip_the_frame_of_given_poses_goes_on() -> None:
    truth = way()
    slipped = [T if i < 10 else pose(3.0, 1.0, 0.0, 0.5) @ T for i, T in enumerate(truth)]
    found = followed(slipped)
    assert [i for i, result in enumerate(found) if result.health == "lost"] == [10]
    assert off(found[0].T_odom_sensor, truth[0])[0] < 1e-6 and off(found[-1].T_odom_sensor, truth[-1])[0] < 0.05


def test_given_poses_say_the_motion_within_a_scan() -> None:
    poses, times = GivenPoses(OdometrySettings()), np.linspace(0.0, 0.1, 50)
    for i in range(3):
        result = poses.register(i * SCAN_NS, pose(0.1 * i, 0.0, 0.0, 0.05 * i), times)
    assert off(result.motion.at(0.1), pose(0.3, 0.0, 0.0, 0.15))[0] < 1e-3
    np.testing.assert_allclose(result.undistorted(np.zeros((50, 3)))[-1], [0.1, 0.0, 0.0], atol=0.02)


def test_given_poses_that_are_restored_go_on_alike() -> None:
    truth, whole, again = way(), GivenPoses(OdometrySettings()), GivenPoses(OdometrySettings())
    for i in range(10):
        whole.register(i * SCAN_NS, truth[i])
    again.restore(from_file(whole.state()))
    wrong = pose(3.0, 1.0)
    for i, T in enumerate([wrong @ truth[10], *truth[11:]], 10):
        both = [o.register(i * SCAN_NS, T).T_odom_sensor.tobytes() for o in (whole, again)]
        assert both[0] == both[1]


def straight(stamps: list[float]) -> ExternalOdometry:
    """One metre and half a radian a second."""
    stamps_ns = (np.array(stamps) * NS).astype(np.int64)
    poses = np.stack([pose(t, 0.0, 0.0, 0.5 * t) for t in stamps])
    return ExternalOdometry(Trajectory(stamps_ns, poses), "odometry.tum")


def test_between_two_poses_the_way_is_even() -> None:
    given = straight([0.0, 0.5, 1.0, 1.5])
    for t in (0.0, 0.1, 0.5, 0.77, 1.5):
        np.testing.assert_allclose(given.at(round(t * NS)), pose(t, 0.0, 0.0, 0.5 * t), atol=1e-9)
        assert is_rigid(given.at(round(t * NS)))


def test_the_ends_reach_one_scan_further() -> None:
    given = straight([1.0, 1.5, 2.0])
    np.testing.assert_allclose(given.at(int(0.92 * NS)), pose(0.92, 0.0, 0.0, 0.46), atol=1e-9)
    np.testing.assert_allclose(given.at(int(2.08 * NS)), pose(2.08, 0.0, 0.0, 1.04), atol=1e-9)


@pytest.mark.parametrize(
    ("stamps", "at", "what"),
    [([1.0, 1.5], 0.8, "outside"), ([1.0, 1.5], 1.7, "outside"), ([0.0, 0.5, 4.0, 4.5], 2.0, "gap")],
)
def test_a_trajectory_that_does_not_cover_the_scans_is_refused(stamps: list[float], at: float, what: str) -> None:
    given = straight(stamps)
    with pytest.raises(UserError, match=rf"odometry.tum.*{at:.1f}.*{what}"):
        given.at(int(at * NS))
    with pytest.raises(UserError, match=f"1 more of 3.*{what}"):
        given.check([int(stamps[0] * NS), int(at * NS), int(at * NS) + 1])


def test_one_pose_is_no_odometry() -> None:
    with pytest.raises(UserError, match="one pose"):
        straight([0.0])


def test_a_name_or_a_file_is_chosen(tmp_path: Path) -> None:
    for method in METHODS:
        config, given = choose(method, Config())
        assert config.odometry.method == method and given is None
    file = tmp_path / "odometry.tum"
    Trajectory(np.array([0, NS]), np.stack([pose(0.0, 0.0), pose(1.0, 0.0)])).write_tum(file)
    config, given = choose(str(file), Config())
    assert config == Config() and given is not None
    for told, word in (("small-gicp", "did you mean small_gicp"), ("nowhere.tum", "TUM file")):
        with pytest.raises(UserError, match=f"{told}.*{word}"):
            choose(told, Config())


@pytest.mark.parametrize("method", ["kiss", "small_gicp"])
@pytest.mark.parametrize("mount", [pose(0.0, 0.0), pose(0.0, 0.0, roll=np.pi / 2)], ids=["level", "lying"])
def test_a_leap_of_the_scans_is_searched_and_found(method: str, mount: Array) -> None:
    """The scans turn by 100 degrees about the vertical from one to the next, which no step can follow."""
    scans, _ = bow()
    odometry, T_mounted = made(method), mount[:3, :3].T
    for i, points in enumerate(scans[:6]):
        before = odometry.register(i * SCAN_NS, points @ T_mounted.T).T_odom_sensor
    turned = scans[6] @ pose(0.0, 0.0, 0.0, 1.75)[:3, :3]
    after = odometry.register(6 * SCAN_NS, turned @ T_mounted.T).T_odom_sensor
    metres, radians = off(before, after)
    assert metres < 0.3 and radians == pytest.approx(1.75, abs=0.1)


@pytest.mark.parametrize("method", METHODS)
def test_a_run_is_anchored_by_each(method: str) -> None:
    drive = small_drive()
    slam = SceneGraphSlam(drive.bim, config=Config(odometry=OdometrySettings(method=method)))  # type: ignore[arg-type]
    for stamp_ns, points in drive.scans:
        slam.add_scan(stamp_ns, points)
    result = slam.finish()
    assert result.anchored, result.reason
    # measured 0.004, 0.005 and, as KISS-ICP sways by a degree, 0.060, most of it in height
    assert drive.rmse(result) < (0.12 if method == "kiss" else 0.02)


@pytest.mark.long
@pytest.mark.parametrize("method", [*METHODS, "given"])
def test_a_run_by_each_goes_on_bit_by_bit(method: str, tmp_path: Path) -> None:
    """Broken off where the surfaces have not held every scan, and taken up from its file."""
    drive, given = small_drive(), method == "given"
    snapshots = TrackingSettings(point_times="snapshot")  # with what is found out, a test of its own
    config = Config(tracking=snapshots, odometry=OdometrySettings(method="kiss" if given else method))  # type: ignore[arg-type]
    scans = [(stamp, points if i % 9 else points[:40]) for i, (stamp, points) in enumerate(drive.scans[:48])]

    def go(slam: SceneGraphSlam, first: int, last: int) -> SceneGraphSlam:
        for i in range(first, last):
            slam.add_scan(*scans[i], T_odom_sensor=drive.truth.poses[i] if given else None)
        return slam

    whole = go(SceneGraphSlam(config=config), 0, 48).finish()
    broken = go(SceneGraphSlam(config=config), 0, 33)
    assert Checkpoints(tmp_path, {}).write(broken, {})
    again = SceneGraphSlam(config=config, clouds=broken.clouds)
    load(tmp_path, again)
    result = go(again, 33, 48).finish()
    assert result.trajectory.poses.tobytes() == whole.trajectory.poses.tobytes()
    assert result.trajectory_odometry.poses.tobytes() == whole.trajectory_odometry.poses.tobytes()


def test_the_command_takes_a_file(tmp_path: Path) -> None:
    """The poses have another rate than the scans; the motion of the run's odometry is what the file says."""
    drive, count = small_drive(), 12
    (tmp_path / "scans").mkdir()
    for i, (_, points) in enumerate(drive.scans[:count]):
        np.save(tmp_path / "scans" / f"{i:03d}.npy", points)
    stamps = [stamp for stamp, _ in drive.scans[:count]]
    (tmp_path / "scans" / "times.txt").write_text("".join(f"{stamp / NS:.9f}\n" for stamp in stamps))
    poses = inverse(drive.truth.poses[0]) @ drive.truth.poses[: count + 2]
    given = Trajectory(drive.truth.stamps_ns[: count + 2 : 2], poses[::2])
    given.write_tum(tmp_path / "given.tum")
    command = ("sgslam.run", "--scan-dir", tmp_path / "scans", "--out", tmp_path / "out")
    done = called(*command, "--odometry", tmp_path / "given.tum")
    assert done.returncode == 0, done.stderr
    odometry = Trajectory.read_tum(tmp_path / "out" / "trajectory_odometry.tum")
    moved = inverse(odometry.poses[0]) @ odometry.poses[::2]  # the run's frame is level
    np.testing.assert_allclose(moved, given.poses[: count // 2], atol=1e-6)
    Trajectory(given.stamps_ns[:2], given.poses[:2]).write_tum(tmp_path / "short.tum")
    done = called(*command, "--odometry", tmp_path / "short.tum")
    assert done.returncode == 2 and done.stderr.splitlines()[-1].startswith("error: ") and "covers" in done.stderr


def untimed(point_times: Literal["auto", "snapshot", "order"] = "auto") -> TimedOdometry:
    return TimedOdometry(lambda: ContinuousTimeOdometry(TrackingSettings()), point_times)


def test_snapshots_are_found_out() -> None:
    scans, _ = bow()
    odometry = untimed()
    back_and_forth = [*scans, *scans[::-1], *scans, *scans[::-1]]
    for i, points in enumerate(back_and_forth):
        odometry.register(i * SCAN_NS, points)
    assert odometry.kind == "snapshot"
