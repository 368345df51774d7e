"""Whole runs through a small building, whose plan and whose robot's true way are known."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from beginnings import begins_here
from boxes import Array, pose
from drives import Drive, fed, small_drive, small_run
from plans import a_graph, offices
from scipy.spatial.transform import Rotation

from data import SceneGraph, UserError
from sgslam.config import Config, TrackingSettings
from sgslam.registration import Registration
from sgslam.session import Result
from sgslam.session.stopwatch import Stopwatch
from sgslam.slam import SceneGraphSlam


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


def test_rooms_and_walls_are_matched_to_their_like_and_show_no_deviations(drive: Drive, anchored: Result) -> None:
    assert anchored.matches is not None and anchored.T_bim_map is not None
    planned = drive.bim.graph
    assert {a for _, a, _ in anchored.matches["rooms"]} == {room.id for room in planned.rooms}
    R, t = anchored.T_bim_map[:2, :2], anchored.T_bim_map[:2, 3]
    assert len(anchored.matches["wall_surfaces"]) >= 10 and len(anchored.deviations) >= 10
    for s_id, a_id, _ in anchored.matches["wall_surfaces"]:
        seen, wall = anchored.s_graph.surface_by_id[s_id], planned.surface_by_id[a_id]
        assert R @ seen.normal @ np.array(wall.normal) > 0.99
        assert abs((R @ seen.centroid + t - wall.centroid) @ np.array(wall.normal)) < 0.05
    assert not any(deviation["significant"] for deviation in anchored.deviations)


@pytest.mark.slow
def test_a_wall_that_was_built_elsewhere_is_told_and_bends_nothing(drive: Drive) -> None:
    """The plan has an outer wall of the hall 10 cm further in than it was built."""
    plan = drive.bim.graph
    hall = next(room.id for room in plan.rooms if room.name == "Hall")
    long = [w for w in plan.surfaces_of_room[hall] if (w.length or 0.0) > 9]
    wrong = max(long, key=lambda w: float(np.linalg.norm(w.centroid - plan.centroid())))
    planned = replace(wrong, centroid=tuple(np.add(wrong.centroid, 0.1 * np.array(wrong.normal)).tolist()), plane=None)
    walls = tuple(planned if w.id == wrong.id else w for w in plan.wall_surfaces)
    result = fed(SceneGraphSlam(replace(plan, wall_surfaces=walls)), drive.scans).finish()
    assert result.anchored and drive.rmse(result) < 0.03, result.reason
    told = {d["a_id"]: d["offset_m"] for d in result.deviations if d["significant"]}
    assert told == {wrong.id: pytest.approx(-0.1, abs=0.02)}


@pytest.mark.slow
def test_a_sensor_that_leans_and_stands_higher_is_levelled(drive: Drive) -> None:
    T_sensor_leaning = pose(0.0, 0.0, 0.0, -0.8, np.radians(4), np.radians(-3))
    scans = [(stamp, points @ T_sensor_leaning[:3, :3]) for stamp, points in drive.scans]
    result = fed(SceneGraphSlam(drive.bim), scans).finish()
    assert result.anchored and drive.rmse(result) < 0.04, result.reason
    tilt = (result.trajectory.poses @ np.linalg.inv(T_sensor_leaning))[:, 2, 2]
    assert np.degrees(np.arccos(np.clip(tilt, -1, 1))).mean() < 0.5


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


def test_in_another_building_nothing_is_anchored(drive: Drive) -> None:
    other = a_graph(offices([3.1, 4.4, 2.6, 3.7], [5.2, 3.3, 4.1]))
    result = fed(SceneGraphSlam(other), drive.scans[:150]).finish()
    assert not result.anchored and result.T_bim_map is None and result.deviations == []
    assert result.first_anchor_s is None and result.reason
    assert result.trajectory.poses.tobytes() == result.trajectory_map.poses.tobytes()
    in_map = np.linalg.inv(drive.truth.poses[0]) @ drive.truth.poses[:150]
    assert np.linalg.norm((result.trajectory.poses - in_map)[:, :3, 3], axis=1).max() < 0.15


@dataclass(frozen=True)
class Answer:
    """What a matcher says."""

    status: str
    rooms: tuple[tuple[str, str, float], ...] = ()
    wall_surfaces: tuple[tuple[str, str, float], ...] = ()
    T_a_s: tuple[float, float, float] | None = None
    floor: str | None = None
    reason: str = "I was told"

    def to_dict(self) -> dict[str, Any]:
        return {"status": self.status, "reason": self.reason, "rooms": self.rooms, "wall_surfaces": self.wall_surfaces}


@dataclass
class KnowingMatcher:
    """Knows where the map begins, T_bim_map; says so with the given status, of maps that end before a stamp. Fails so
    many times first."""

    T_bim_map: Array
    status: str
    until_ns: int = 2**62
    fails: int = 0

    def match(self, s: SceneGraph, a: SceneGraph) -> Answer:
        if self.fails:
            self.fails -= 1
            raise RuntimeError("the matcher failed")
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
        status = self.status if s.keyframes[-1].stamp_ns < self.until_ns else "ambiguous"
        place = (float(np.arctan2(R[1, 0], R[0, 0])), float(t[0]), float(t[1]))
        return Answer(status, (), tuple(pairs), place, a.floors[0].id)


@pytest.mark.slow
def test_a_commitment_that_the_final_map_does_not_confirm_is_withdrawn(drive: Drive) -> None:
    """Until then the updates tell what is known."""
    slam = SceneGraphSlam(drive.bim, KnowingMatcher(drive.truth.poses[0], "unique", drive.scans[-1][0]))
    updates = [slam.add_scan(*scan) for scan in drive.scans]
    assert np.abs(updates[0].T_map_sensor - np.eye(4)).max() < 1e-6
    keyframes, flags = [u.keyframes for u in updates], [u.anchored for u in updates]
    # it takes seconds to find out where up is; the scans until then come all at once
    began = int(np.flatnonzero(keyframes)[0])
    assert 4.0 <= (updates[began].stamp_ns - updates[0].stamp_ns) / 1e9 <= 10.0
    assert set(np.diff(keyframes[began:])) == {0, 1} and any(flags) and not flags[0]
    in_map = np.linalg.inv(drive.truth.poses[0]) @ drive.truth.poses
    live = np.stack([u.T_map_sensor for u in updates])
    assert np.linalg.norm((live - in_map)[:, :3, 3], axis=1).max() < 0.2
    result = slam.finish()
    assert not result.anchored and result.T_bim_map is None and result.first_anchor_s is None
    assert result.matches is not None and result.matches["status"] == "ambiguous" and result.deviations == []


@pytest.mark.parametrize("status", ["unique", "ambiguous", "none"])
def test_only_a_unique_answer_of_a_matcher_anchors(drive: Drive, status: str) -> None:
    """Any object with `match` serves. The first 100 scans see two rooms of three."""
    slam = SceneGraphSlam(drive.bim, KnowingMatcher(drive.truth.poses[0], status))
    result = fed(slam, drive.scans[:100]).finish()
    assert result.anchored == slam.anchored == (status == "unique")
    assert result.reason == "I was told"
    helps = {"unique": [], "ambiguous": ["--start X,Y,YAW"], "none": ["the model of the scanned building"]}[status]
    helps = [*helps, "--mount 180,0,0"] if helps else []  # only a place in the plan shows which way up the sensor was
    assert len(result.advice) == len(helps) and all(text in "".join(result.advice) for text in helps)
    assert not result.anchored or drive.rmse(result) < 0.03


def test_odometry_from_outside_is_used(drive: Drive) -> None:
    class NoOdometry:
        def register(self, stamp_ns: int, points: Array, point_times: Array | None = None) -> Registration:
            raise AssertionError("the odometry was asked although the pose was given")

        def level(self, up_in_odom: Array) -> None:
            pass

    count = 100
    T_odom_bim = pose(5.0, 6.0, 7.0, 1.0) @ np.linalg.inv(drive.truth.poses[0])  # any frame will do
    given = T_odom_bim @ drive.truth.poses[:count]
    given[:, 0, 3] += np.linspace(0, 0.5, count)  # and it drifts
    slam = SceneGraphSlam(drive.bim, KnowingMatcher(drive.truth.poses[0], "unique"), odometry=NoOdometry())
    for (stamp_ns, points), T in zip(drive.scans[:count], given, strict=True):
        slam.add_scan(stamp_ns, points, T_odom_sensor=T)
    result = slam.finish()
    found = result.trajectory_odometry.poses  # the same way, in a level frame that begins at the first pose
    np.testing.assert_allclose(np.linalg.inv(found[0]) @ found, np.linalg.inv(given[0]) @ given, atol=1e-9)
    assert drive.rmse(result) < 0.03


BAD_POINTS = {
    "nan": np.array([[1.0, 2.0, np.nan], [1.0, 2.0, 3.0]]),
    "infinite": np.array([[1.0, np.inf, 0.0]]),
    "empty": np.empty((0, 3)),
    "flat": np.ones((5, 2)),
    "one row": np.ones(3),
}


def test_bad_scans_are_refused_and_the_run_goes_on(drive: Drive) -> None:
    slam, clean = SceneGraphSlam(), SceneGraphSlam()
    with pytest.raises(UserError, match="no scan"):
        slam.finish()
    for bad in BAD_POINTS.values():
        with pytest.raises(UserError, match="points"):
            slam.add_scan(-1, bad)  # even as the first one
    for stamp_ns, points in drive.scans[:6]:
        times = np.linspace(0.0, 0.1, len(points))
        for bad in BAD_POINTS.values():
            with pytest.raises(UserError, match=f"{stamp_ns} ns.*points"):
                slam.add_scan(stamp_ns, bad)
        for wrong, message in ((1e3 * times, "after the stamp"), (1e9 * times, "after"), (1.7e9 + times, "of day")):
            with pytest.raises(UserError, match=message):
                slam.add_scan(stamp_ns, points, wrong)
        for T in (np.full((4, 4), np.nan), np.eye(3), 2 * np.eye(4)):
            with pytest.raises(UserError, match="T_odom_sensor"):
                slam.add_scan(stamp_ns, points, T_odom_sensor=T)
        fed(slam, [(stamp_ns, points)])
        for earlier in (stamp_ns, stamp_ns - 1, -5):
            with pytest.raises(UserError, match="must increase"):
                slam.add_scan(earlier, points)
    expected = fed(clean, drive.scans[:6]).finish()
    assert slam.finish().trajectory.poses.tobytes() == expected.trajectory.poses.tobytes()


def test_a_single_scan_is_a_run(drive: Drive) -> None:
    result = fed(SceneGraphSlam(drive.bim), drive.scans[:1]).finish()
    assert len(result.trajectory) == 1 and not result.anchored
    assert begins_here(result.trajectory.poses[0])


@pytest.mark.parametrize("count", [1, 30])
def test_scans_of_a_few_points_are_survived(drive: Drive, count: int) -> None:
    """A sensor that is covered for a while sees next to nothing."""
    scans = [(s, points[:count] if 10 <= i <= 15 else points) for i, (s, points) in enumerate(drive.scans[:30])]
    result = fed(SceneGraphSlam(drive.bim), scans).finish()
    assert len(result.trajectory_map) == 30 and np.isfinite(result.trajectory_map.poses).all()
    assert result.tracked["lost"] == 6 and len(result.trajectory) == (24 if result.anchored else 30)


def test_after_a_matcher_that_raised_no_scan_is_missing(drive: Drive) -> None:
    """The first seconds' scans come to the map in one call."""
    late = Config(tracking=TrackingSettings(gravity_after=9.0, gravity_until=10.0))
    slam, failed = SceneGraphSlam(drive.bim, KnowingMatcher(np.eye(4), "none", fails=1), late), 0
    for stamp_ns, points in drive.scans[:80]:
        try:
            slam.add_scan(stamp_ns, points, np.zeros(len(points)))
        except RuntimeError:
            failed += 1
    assert failed == 1 and len(slam.finish().trajectory_map) == 80
    stopwatch = Stopwatch(iter(range(10)).__next__)
    with pytest.raises(RuntimeError), stopwatch("matching"):
        raise RuntimeError
    assert stopwatch.seconds["matching"] == 1.0  # the time of a stage that raises counts
