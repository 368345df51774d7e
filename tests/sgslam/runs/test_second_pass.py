"""A second pass over all scans, once the map is known."""

import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from drives import fed, off, small_drive
from scipy.spatial.transform import Rotation

from data.scans import Scan
from sgslam.config import Config, OdometrySettings
from sgslam.registration import Motion
from sgslam.registration.sampling import TimedPoints
from sgslam.report.accuracy import align_se3
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow


def read_again() -> Iterator[Scan]:
    """The drive's scans as a source yields them."""
    for k, (stamp_ns, points) in enumerate(small_drive().scans):
        yield Scan(k, stamp_ns, points, point_times=np.zeros(len(points)))


@pytest.fixture(scope="module")
def passed_again() -> tuple[SceneGraphSlam, Result, Result]:
    """A run, and its results before and after a second pass."""
    drive = small_drive()
    slam = fed(SceneGraphSlam(drive.bim), drive.scans)
    return slam, slam.finish(), slam.finish(read_again())


def test_poses_are_better_than_the_live_ones_which_are_kept(
    passed_again: tuple[SceneGraphSlam, Result, Result], tmp_path: Path
) -> None:
    drive, (_, single, second) = small_drive(), passed_again
    assert single.trajectory_live is None
    assert second.anchored and second.trajectory_live is not None
    assert np.array_equal(second.trajectory_live.stamps_ns, second.trajectory.stamps_ns)
    assert drive.rmse(second) < drive.rmse(single) + 0.003
    live = np.linalg.norm(off(second.trajectory_live, drive.truth), axis=1)
    assert drive.rmse(second) < 0.9 * np.sqrt(np.mean(live**2))
    assert second.seconds["smoothing"] > 0 == single.seconds["smoothing"]
    assert np.array_equal(second.trajectory_odometry.poses, single.trajectory_odometry.poses)
    (tmp_path / "trajectory_live.tum").write_text("of an earlier run")
    single.save(tmp_path)
    assert not (tmp_path / "trajectory_live.tum").exists()


def test_scans_that_cannot_all_be_read_again_change_nothing(caplog: pytest.LogCaptureFixture) -> None:
    drive = small_drive()
    slam = fed(SceneGraphSlam(), drive.scans[:40])
    single = slam.finish()
    with caplog.at_level(logging.WARNING):
        again = slam.finish(list(read_again())[:39])
    assert "39 of 40 scans can be read again" in caplog.text
    assert again.trajectory_live is None
    assert np.abs(again.trajectory.poses - single.trajectory.poses).max() < 1e-4  # optimised once more
    assert slam.finish(read_again()).trajectory_live is not None  # more scans than the run has do no harm


def test_a_result_stays_that_a_second_pass_would_lose(
    passed_again: tuple[SceneGraphSlam, Result, Result],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A motion that bends, as where a smoothing fails: the map fits the plan no more."""
    slam, single, _ = passed_again

    def bent(scans: list[TimedPoints], start: Motion, *_: object) -> Motion:
        knots = start.knots.copy()
        way = np.linspace(0, 1, len(knots))
        knots[:, :3, :3] = Rotation.from_rotvec(np.outer(way, [0.0, 0.0, 2.0])).as_matrix() @ knots[:, :3, :3]
        knots[:, :3, 3] += 8 * way[:, None]
        return Motion(start.seconds, knots)

    monkeypatch.setattr("sgslam.session.second_pass.smoothed", bent)
    with caplog.at_level(logging.WARNING):
        kept = slam.finish(read_again())
    assert "the second pass is left out" in caplog.text
    assert kept.anchored and kept.trajectory_live is None
    assert small_drive().rmse(kept) < small_drive().rmse(single) + 0.01


def shape_error(result: Result) -> float:
    """(m) RMSE of the first 40 scans after alignment."""
    found = result.trajectory_map.positions
    true = small_drive().truth.at(result.trajectory_map.stamps_ns)[:, :3, 3]
    T = align_se3(found, true)
    return float(np.sqrt(np.mean(np.sum((found @ T[:3, :3].T + T[:3, 3] - true) ** 2, axis=1))))


def test_poses_of_another_odometry_are_estimated_again() -> None:
    drive = small_drive()
    given = SceneGraphSlam()
    for k, (stamp_ns, points) in enumerate(drive.scans[:40]):
        given.add_scan(stamp_ns, points, T_odom_sensor=drive.truth.poses[k])
    other = SceneGraphSlam(config=Config(odometry=OdometrySettings(method="small_gicp")))
    for slam in (given, fed(other, drive.scans[:40])):
        single, second = slam.finish(), slam.finish(list(read_again())[:40])
        assert second.trajectory_live is not None
        assert shape_error(second) < min(shape_error(single) + 0.003, 0.01)
