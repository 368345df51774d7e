"""Whole runs through a small building, whose plan and whose robot's true way are known."""

import logging
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from beginnings import begins_here
from boxes import Array, pose
from drives import Drive, fed, off, small_drive, small_run
from scipy.spatial.transform import Rotation

from data import SceneGraph, UserError
from data.trajectory import Trajectory
from matching import MatchResult
from matching.result import Status
from sgslam.config import AnchorSettings, Config, QualitySettings, TrackingSettings
from sgslam.mapping import KeyframeClouds
from sgslam.result import Result
from sgslam.session.scan_points import FILE as POINTS
from sgslam.session.scan_poses import ScanPose, with_unplaced
from sgslam.slam import SceneGraphSlam
from sgslam.types import Motion, TimedPoints


@pytest.fixture(scope="module")
def drive() -> Drive:
    return small_drive()


@pytest.fixture(scope="module")
def anchored() -> Result:
    return small_run(with_bim=True)[1]


def test_a_run_ends_in_building_coordinates(drive: Drive, anchored: Result) -> None:
    assert anchored.anchored and anchored.T_bim_map is not None, anchored.reason
    assert drive.rmse(anchored) < 0.03 and drive.errors(anchored).max() < 0.12
    turns = np.linalg.inv(anchored.trajectory.poses) @ drive.truth.at(anchored.trajectory.stamps_ns)
    assert np.abs(Rotation.from_matrix(turns[:, :3, :3]).magnitude()).mean() < np.radians(0.5)
    assert anchored.trajectory.stamps_ns.tolist() == [stamp for stamp, _ in drive.scans]
    assert anchored.first_anchor_s is not None and 0 < anchored.first_anchor_s < 60
    assert begins_here(anchored.trajectory_map.poses[0])
    np.testing.assert_allclose(anchored.trajectory.poses, anchored.T_bim_map @ anchored.trajectory_map.poses)


def test_the_map_of_a_tilted_sensor_is_level_and_asks_for_its_mount(drive: Drive) -> None:
    tilt = Rotation.from_euler("y", 25, degrees=True).as_matrix()
    result = fed(SceneGraphSlam(), [(stamp, points @ tilt) for stamp, points in drive.scans[:60]]).finish()
    assert begins_here(result.trajectory.poses[0], tilt_deg=26) and not begins_here(result.trajectory.poses[0], 24)
    assert np.ptp(result.trajectory.positions[:, 2]) < 0.05  # it drives on a level floor
    true_height = drive.truth.poses[0, 2, 3] - drive.bim.graph.floors[0].elevation
    assert result.s_graph.floors[0].elevation == pytest.approx(-true_height, abs=0.03)
    assert not result.anchored and result.a_graph is None and result.matches is None
    assert result.s_graph.rooms and result.s_graph.wall_surfaces and result.s_graph.keyframes
    assert ["--mount 180,0,0" in line for line in result.advice] == [True]
    upright = Config(tracking=TrackingSettings(mount=(0.0, 0.0, 0.0)))
    assert not fed(SceneGraphSlam(config=upright), drive.scans[:60]).finish().advice


@dataclass
class KnowingMatcher:
    """Knows where the map begins, T_bim_map; says so with the given status."""

    T_bim_map: Array
    status: Status

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        R, t = self.T_bim_map[:2, :2], self.T_bim_map[:2, 3]
        pairs = []
        for seen in s.wall_surfaces:
            centre, normal = R @ seen.centroid + t, R @ seen.normal
            for wall in a.wall_surfaces:
                away = centre - wall.centroid
                n = np.array(wall.normal)
                along = abs(n[0] * away[1] - n[1] * away[0])
                if normal @ n > 0.98 and abs(away @ n) < 0.1 and along < (wall.length or 0.0) / 2:
                    pairs.append((seen.id, wall.id, 1.0))
        place = (float(np.arctan2(R[1, 0], R[0, 0])), float(t[0]), float(t[1]))
        return MatchResult(self.status, "I was told", (), tuple(pairs), place, a.floors[0].id)


@pytest.mark.parametrize("status", ["unique", "ambiguous", "none"])
def test_only_a_unique_answer_of_a_matcher_anchors(drive: Drive, status: Status) -> None:
    """Any object with `match` serves. The first 100 scans see two rooms of three."""
    slam = SceneGraphSlam(drive.bim, KnowingMatcher(drive.truth.poses[0], status))
    result = fed(slam, drive.scans[:100]).finish()
    assert result.anchored == slam.anchored == (status == "unique")
    assert result.reason == "I was told"
    helps = {"unique": [], "ambiguous": ["--start X,Y,YAW"], "none": ["the model of the scanned building"]}[status]
    helps = [*helps, "--mount 180,0,0"] if helps else []  # only a place in the plan shows which way up the sensor was
    assert len(result.advice) == len(helps) and all(text in "".join(result.advice) for text in helps)
    assert not result.anchored or drive.rmse(result) < 0.03


BAD_POINTS = (np.array([[1.0, 2.0, np.nan], [1.0, 2.0, 3.0]]), np.empty((0, 3)), np.ones(3))


def test_bad_scans_are_refused_and_the_run_goes_on(drive: Drive) -> None:
    slam, clean = SceneGraphSlam(), SceneGraphSlam()
    with pytest.raises(UserError, match="no scan"):
        slam.finish()
    for bad in BAD_POINTS:
        with pytest.raises(UserError, match="points"):
            slam.add_scan(-1, bad)  # even as the first one
    for stamp_ns, points in drive.scans[:6]:
        times = np.linspace(0.0, 0.1, len(points))
        for bad in BAD_POINTS:
            with pytest.raises(UserError, match=f"{stamp_ns} ns.*points"):
                slam.add_scan(stamp_ns, bad)
        with pytest.raises(UserError, match="after the stamp"):
            slam.add_scan(stamp_ns, points, 1e3 * times)
        for T in (np.full((4, 4), np.nan), np.eye(3), 2 * np.eye(4)):
            with pytest.raises(UserError, match="T_odom_sensor"):
                slam.add_scan(stamp_ns, points, T_odom_sensor=T)
        fed(slam, [(stamp_ns, points)])
        for earlier in (stamp_ns, stamp_ns - 1, -5):
            with pytest.raises(UserError, match="must increase"):
                slam.add_scan(earlier, points)
    expected = fed(clean, drive.scans[:6]).finish()
    assert slam.finish().trajectory.poses.tobytes() == expected.trajectory.poses.tobytes()


def test_live_sigma_is_unknown_at_first_and_grows_where_nothing_is_seen(anchored: Result) -> None:
    drive, said = small_drive(), []
    slam = SceneGraphSlam(drive.bim)
    for stamp_ns, points in drive.scans[:60]:
        slam.add_scan(stamp_ns, points)
        said.append(slam.sigma())
    assert np.isnan(said[:5]).all()
    for k in range(1, 6):
        slam.add_scan(stamp_ns + k * 200_000_000, points[:20])
        said.append(slam.sigma())
    covered = np.array(said)[-6:, :2].max(axis=1)
    assert (np.diff(covered) > 0).all()
    ratio = small_run(with_bim=True)[0].sigma() / anchored.uncertainty.sigma[-1]
    assert ((ratio > 1 / 3) & (ratio < 3)).all()


def run_with(withdraw: float = 0.5, **limits: float) -> Result:
    """The drive until it is anchored."""
    drive = small_drive()
    config = Config(quality=QualitySettings(**limits), anchors=AnchorSettings(withdraw=withdraw))
    return fed(SceneGraphSlam(drive.bim, config=config), drive.scans[:150]).finish()


@pytest.mark.slow
def test_a_scan_that_is_not_known_well_enough_is_not_anchored(anchored: Result) -> None:
    assert anchored.uncertainty.anchored.all()
    position = 2.7 * float(np.median(anchored.uncertainty.sigma[:150, :3].max(axis=1)))
    result = run_with(anchored_position=position)
    known, worst = result.uncertainty.anchored, result.uncertainty.sigma[:, :3].max(axis=1) / position
    assert 0.2 < known.mean() < 0.8
    assert not known[worst > 1 / 2.57].any()  # 99 % of one axis
    assert known[worst < 1 / 2.94].all()  # 99 % of three independent ones
    assert result.anchored and len(result.trajectory) == known.sum()
    assert result.trajectory.stamps_ns.tolist() == result.trajectory_map.stamps_ns[known].tolist()
    assert result.metrics()["anchored_share"] == pytest.approx(known.mean())


@pytest.mark.slow
def test_a_run_with_no_scan_that_is_known_is_not_anchored_and_says_what_is_unknown() -> None:
    result = run_with(anchored_attitude=1e-4)
    assert not result.anchored and result.T_bim_map is None and not result.uncertainty.anchored.any()
    assert len(result.trajectory) == len(result.trajectory_map)
    assert re.search(r"its (?:pitch|roll|heading) is.*quality.anchored_attitude", result.reason)


@pytest.mark.slow
def test_a_place_that_is_not_probable_enough_is_withdrawn_and_the_reason_says_so(anchored: Result) -> None:
    assert anchored.place is not None and anchored.quality["place_probability"].ok
    result = run_with(withdraw=1 - 1e-9)
    assert not result.anchored and result.T_bim_map is None and not result.uncertainty.anchored.any()
    assert not result.deviations and "place_probability" not in result.quality
    assert result.place is not None and result.place.T_bim_map is not None  # what was withdrawn
    assert "anchors.withdraw" in result.reason


def test_a_part_begins_level_at_the_last_known_place_and_heading() -> None:
    known = Trajectory(np.array([0, 10]), np.stack([np.eye(4), pose(5.0, 2.0, 1.0, np.pi / 2, 0.0, 0.3)]))
    first = pose(0.0, 0.0, 0.0, 0.0, 0.0, -0.2)
    whole = with_unplaced(known, [([ScanPose(20, first, first, 0, np.eye(4))], first[None])])
    assert whole.stamps_ns.tolist() == [0, 10, 20]
    np.testing.assert_allclose(whole.poses[2], pose(5.0, 2.0, 1.0, np.pi / 2, 0.0, -0.2), atol=1e-9)


@pytest.fixture(scope="module")
def passed_again() -> tuple[SceneGraphSlam, Result, Result]:
    """A run, and its results before and after a second pass."""
    drive = small_drive()
    slam = fed(SceneGraphSlam(drive.bim), drive.scans)
    return slam, slam.finish(), slam.finish(second_pass=True)


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_run_whose_points_are_gone_has_no_second_pass(caplog: pytest.LogCaptureFixture, tmp_path: Path) -> None:
    """Of a run that was killed, the file may have been deleted."""
    clouds = KeyframeClouds(tmp_path / "clouds.bin")
    first = fed(SceneGraphSlam(clouds=clouds), small_drive().scans[:40])
    state, single = first.state(), first.finish()
    again = SceneGraphSlam(clouds=clouds)
    (tmp_path / POINTS).unlink()
    again.restore(state)
    with caplog.at_level(logging.WARNING):
        kept = again.finish(second_pass=True)
    assert "the points of 0 of 40 scans are there" in caplog.text
    assert kept.trajectory_live is None
    assert np.abs(kept.trajectory.poses - single.trajectory.poses).max() < 1e-4  # optimised once more
    assert first.finish(second_pass=True).trajectory_live is not None


@pytest.mark.slow
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

    monkeypatch.setattr("sgslam.slam.smoothed", bent)
    with caplog.at_level(logging.WARNING):
        kept = slam.finish(second_pass=True)
    assert "the second pass is left out" in caplog.text
    assert kept.anchored and kept.trajectory_live is None
    assert small_drive().rmse(kept) < small_drive().rmse(single) + 0.01
