"""A second run finds itself in the map of the first, wherever it starts, and both become one map."""

import functools
from pathlib import Path

import numpy as np
import pytest
from beginnings import begins_here
from boxes import Array, pose, room, scan, scene_of
from drives import fed, off, small_drive, small_run

from data.common.errors import UserError
from data.trajectory import Trajectory
from matching import Matcher
from sgslam.config import Config
from sgslam.config.loop_settings import LoopSettings
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report.number_formats import NO_PLAN
from sgslam.session import Checkpoints, PriorMap, Result
from sgslam.session.checkpoints import load
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow


def back() -> list[tuple[int, Array]]:
    """The drive from its end to its beginning, on another clock."""
    return [(7 + 200_000_000 * i, points) for i, (_, points) in enumerate(reversed(small_drive().scans))]


def way_back() -> Trajectory:
    """The true poses of `back`."""
    return Trajectory(np.array([stamp for stamp, _ in back()]), small_drive().truth.poses[::-1])


def first_run(folder: Path, anchored: bool) -> Result:
    slam, result = small_run(anchored)
    Checkpoints(folder, {}).write(slam, {}, finished=True)
    result.clouds.copy_to(folder / CLOUDS)
    return result


def apart(run: Trajectory, truth: Trajectory, T_truth_run: Array) -> float:
    """(m) RMSE of a run's positions, moved by `T_truth_run`, to the truth's at the same stamps."""
    return float(np.sqrt(np.mean(np.sum(off(run.transformed(T_truth_run), truth) ** 2, axis=1))))


@pytest.mark.long
def test_a_second_run_finds_itself_in_the_map_of_the_first_and_is_joined_to_it(tmp_path: Path) -> None:
    drive, first = small_drive(), first_run(tmp_path, anchored=False)
    result = fed(SceneGraphSlam(prior=PriorMap.load(tmp_path, Config())), back()).finish()
    assert result.relocalisation is not None and result.relocalisation.found and not result.anchored
    T_bim_map = drive.truth.poses[0]  # the map's frame is the first pose of the first run
    before = apart(first.trajectory, drive.truth, T_bim_map)
    assert apart(result.trajectory, way_back(), T_bim_map) < before + 0.02
    assert apart(result.earlier[0], drive.truth, T_bim_map) < before + 0.01
    assert len(result.s_graph.rooms) == len(first.s_graph.rooms)  # what both saw is there once
    assert len(result.s_graph.wall_surfaces) <= len(first.s_graph.wall_surfaces) + 3
    assert len(result.clouds) > 1.8 * len(first.clouds)
    assert result.keyframes == len(result.s_graph.keyframes) and result.metrics()["runs"] == 2


@pytest.mark.long
def test_with_the_building_both_runs_are_in_its_frame(tmp_path: Path) -> None:
    drive, first = small_drive(), first_run(tmp_path, anchored=True)
    known = PriorMap.load(tmp_path, Config())
    assert known.T_bim_map is not None and np.allclose(known.T_bim_map, first.T_bim_map)
    result = fed(SceneGraphSlam(drive.bim, prior=known), back()).finish()
    assert result.anchored and result.relocalisation is not None and result.relocalisation.found
    assert apart(result.trajectory, way_back(), np.eye(4)) < 0.03
    assert apart(result.earlier[0], drive.truth, np.eye(4)) < 0.03
    assert len(result.s_graph.rooms) == len(first.s_graph.rooms)


def test_a_run_elsewhere_is_not_found_and_stays_its_own(tmp_path: Path) -> None:
    first_run(tmp_path, anchored=False)
    walls = scene_of(room(0, 0, 9, 4))
    scans = [(100_000_000 * i, scan(walls, pose(1 + 0.1 * i, 2, 1), seed=i)) for i in range(40)]
    result = fed(SceneGraphSlam(prior=PriorMap.load(tmp_path, Config())), scans).finish()
    assert result.relocalisation is not None and not result.relocalisation.found and not result.earlier
    assert len(result.trajectory) == 40 and begins_here(result.trajectory.poses[0])


def test_parts_of_a_run_that_were_not_found_at_first_are_asked_after_again(tmp_path: Path) -> None:
    first_run(tmp_path, anchored=False)
    known, part = (PriorMap.load(tmp_path, Config()) for _ in range(2))
    walls = scene_of(room(0, 0, 9, 4))
    alone = fed(SceneGraphSlam(), [(100_000_000 * i, scan(walls, pose(1 + 0.1 * i, 2, 1), seed=i)) for i in range(12)])
    alone.finish()
    (tmp_path / "elsewhere").mkdir()
    Checkpoints(tmp_path / "elsewhere", {}).write(alone, {}, finished=True)
    elsewhere = PriorMap.load(tmp_path / "elsewhere", Config())
    keyframes, scans = len(known.backend.keyframes), len(known.scans)
    left = known.merge_unplaced([elsewhere, part], None, Matcher.load("learned"), Config())
    assert left == [elsewhere] and len(known.begins) == 1
    assert len(known.backend.keyframes) == 2 * keyframes and len(known.scans) == 2 * scans
    again = known.backend.poses[keyframes:]
    assert np.abs(again[:, :3, 3] - known.backend.poses[:keyframes, :3, 3]).max() < 0.03


def test_a_map_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no run state"):
        PriorMap.load(tmp_path, Config())
    Checkpoints(tmp_path, {}).write(fed(SceneGraphSlam(), small_drive().scans[:5]), {})
    with pytest.raises(UserError, match="--resume"):
        PriorMap.load(tmp_path, Config())


def carried_off() -> tuple[list[tuple[int, Array]], Trajectory]:
    """Half of the drive, then, the scans being off, from its end back to its beginning; and the true poses."""
    drive = small_drive()
    half = list(range(len(drive.scans) // 2))
    order = half + list(range(len(drive.scans)))[::-1]
    scans = [(100_000_000 * i, drive.scans[k][1]) for i, k in enumerate(order)]
    return scans, Trajectory(np.array([stamp for stamp, _ in scans]), drive.truth.poses[order])


@functools.cache
def found_again(with_bim: bool) -> Result:
    slam = fed(SceneGraphSlam(small_drive().bim if with_bim else None), carried_off()[0])
    found = slam.finish().relocalisation
    result = slam.finish()  # once more, which joins nothing again
    assert result.relocalisation == found
    return result


@pytest.mark.parametrize("with_bim", [True, pytest.param(False, marks=pytest.mark.long)])
def test_who_is_carried_off_is_found_again(with_bim: bool) -> None:
    (scans, truth), result = carried_off(), found_again(with_bim)
    assert result.relocalisation is not None and result.relocalisation.found
    assert len(result.trajectory) == len(scans) and not result.earlier and result.anchored == with_bim
    assert result.quality["map_against_odometry"].ok  # though the odometry began again
    assert apart(result.trajectory, truth, np.eye(4) if with_bim else truth.poses[0]) < 0.05


@pytest.mark.long
def test_a_drive_is_not_taken_for_carried_off() -> None:
    assert small_run(with_bim=False)[1].relocalisation is None


@pytest.mark.long
def test_who_is_carried_where_nothing_is_known_harms_nothing() -> None:
    drive, (_, alone) = small_drive(), small_run(with_bim=True)
    walls, last = scene_of(room(0, 0, 9, 4)), drive.scans[-1][0]
    more = [(last + 200_000_000 * (i + 1), scan(walls, pose(1 + 0.1 * i, 2, 1), seed=i)) for i in range(30)]
    result = fed(SceneGraphSlam(drive.bim), [*drive.scans, *more]).finish()
    assert result.anchored and result.relocalisation is not None and not result.relocalisation.found
    assert len(result.trajectory) == len(drive.scans)  # only what is anchored
    assert len(result.trajectory_map) == len(result.uncertainty.stamps_ns) == len(drive.scans) + 30
    assert result.uncertainty.part.tolist() == [0] * len(drive.scans) + [1] * 30
    assert result.metrics()["anchored_share"] == pytest.approx(len(drive.scans) / (len(drive.scans) + 30))
    assert result.reason.endswith(f"; of {len(drive.scans) + 30} scans 30 are in parts that were not placed")
    assert result.first_anchor_s == alone.first_anchor_s  # not since the last scan before
    assert drive.rmse(result) < drive.rmse(alone) + 0.005
    assert len(result.s_graph.rooms) == len(alone.s_graph.rooms)


@pytest.mark.parametrize("more", [pytest.param(False, marks=pytest.mark.long), True])
def test_a_run_that_began_where_the_plan_shows_nothing_is_anchored_by_its_later_part(more: bool) -> None:
    """And a third part joins it by the plan, not by the second part alone."""
    drive = small_drive()
    walls, half = scene_of(room(0, 0, 9, 4)), len(drive.scans) // 2
    points = [scan(walls, pose(1 + 0.1 * i, 2, 1), seed=i) for i in range(30)]
    points += [own for _, own in drive.scans]
    points += [own for _, own in reversed(drive.scans[half:])] * more
    result = fed(SceneGraphSlam(drive.bim), [(200_000_000 * k, own) for k, own in enumerate(points)]).finish()
    assert result.anchored and result.relocalisation is not None and result.relocalisation.found
    assert result.uncertainty.part.tolist() == [1] * 30 + [0] * (len(points) - 30)
    truth = np.concatenate([drive.truth.positions, drive.truth.positions[half:][::-1]])[: len(points) - 30]
    scans = np.round(result.trajectory.stamps_ns / 2e8).astype(int) - 30
    assert len(scans) > 0.95 * len(truth)
    assert np.sqrt(np.mean(np.sum((result.trajectory.positions - truth[scans]) ** 2, axis=1))) < 0.05


@pytest.mark.parametrize("covered", [pytest.param(0, marks=pytest.mark.long), 8])
def test_no_scan_is_missing_where_a_sensor_is_carried_off_in_its_first_seconds(covered: int) -> None:
    """While all scans still wait for gravity. Those under a cover before are lost, and stay with the first map."""
    here = scene_of([*room(0, 0, 4, 3), (0, 1, 0, 0.5, 2, 2)])
    there = scene_of([*room(20, 0, 29, 7), (23, 2, 0, 24, 4, 2.6), (26, 5, 0, 27, 7, 2.6)])
    first = [scan(here, pose(2 + 0.03 * i, 1.5, 1, yaw=0.03 * i), seed=i) for i in range(20)]
    cap = [0.4 * np.random.default_rng(i).normal(size=(20, 3)) for i in range(covered)]
    other = [scan(there, pose(25 + 0.03 * i, 2, 1, yaw=1 - 0.03 * i), seed=i) for i in range(30)]
    slam = SceneGraphSlam()
    for k, points in enumerate([*first, *cap, *other]):
        slam.add_scan(10**8 * k, points)
    told = slam.finish().uncertainty
    assert slam.kidnaps == 1
    assert told.stamps_ns.tolist() == [10**8 * k for k in range(50 + covered)]
    assert told.part.tolist() == [0] * (20 + covered) + [1] * 30
    assert told.health[20 : 20 + covered] == ("lost",) * covered and set(told.health[20 + covered :]) != {"lost"}


def test_a_beginning_under_a_cover_is_not_the_map() -> None:
    here = scene_of([*room(20, 0, 29, 7), (23, 2, 0, 24, 4, 2.6), (26, 5, 0, 27, 7, 2.6)])
    slam = SceneGraphSlam()
    for k in range(30):
        slam.add_scan(10**8 * k, 0.2 + 0.02 * np.random.default_rng(k).normal(size=(200, 3)))
    for k in range(30):
        slam.add_scan(10**8 * (30 + k), scan(here, pose(25 + 0.03 * k, 2, 1, yaw=1 - 0.03 * k), seed=k))
    result = slam.finish()
    known = result.uncertainty
    assert known.part.tolist() == [1] * 30 + [0] * 30
    assert known.health[:30] == ("lost",) * 30 and set(known.health[30:]) == {"good"}
    assert np.isnan(known.sigma[:30]).all() and np.isfinite(known.sigma[30:]).all()
    assert result.relocalisation is not None and result.relocalisation.reason == "all scans before it are lost"
    assert len(result.s_graph.rooms) == 1


@functools.cache
def carried_off_without_loops() -> Result:
    config = Config(loops=LoopSettings(enabled=False))
    return fed(SceneGraphSlam(small_drive().bim, config=config), carried_off()[0]).finish()


@pytest.mark.long
@pytest.mark.parametrize("scans_after_the_leap", [2, 40])
def test_a_run_goes_on_bit_by_bit_after_a_leap(scans_after_the_leap: int, tmp_path: Path) -> None:
    """But for loops: the state holds no clouds of keyframes, which they are closed with."""
    drive, (scans, _) = small_drive(), carried_off()
    after, config = len(drive.scans) // 2 + scans_after_the_leap, Config(loops=LoopSettings(enabled=False))
    whole = carried_off_without_loops()
    first = fed(SceneGraphSlam(drive.bim, config=config), scans[:after])
    Checkpoints(tmp_path, {}).write(first, {})
    second = SceneGraphSlam(drive.bim, config=config)
    load(tmp_path, second)
    result = fed(second, scans[after:]).finish()
    assert np.array_equal(result.trajectory.poses, whole.trajectory.poses) and result.s_graph == whole.s_graph


def test_of_a_run_that_is_nowhere_it_is_told_how_many_scans_lie_apart() -> None:
    """In a plan that is not theirs; without a plan it is a map only."""
    here, there = scene_of(room(0, 0, 9, 4)), scene_of([*room(20, 0, 26, 7), (23, 2, 0, 24, 4, 2.6)])
    points = [scan(here, pose(1 + 0.1 * i, 2, 1), seed=i) for i in range(40)]
    points += [scan(there, pose(25 + 0.01 * i, 2, 1, yaw=1 - 0.03 * i), seed=i) for i in range(30)]
    scans = [(100_000_000 * k, own) for k, own in enumerate(points)]
    result = fed(SceneGraphSlam(small_drive().bim), scans).finish()
    assert not result.anchored and result.reason.endswith("30 of 70 scans are not in the first")
    assert fed(SceneGraphSlam(), scans).finish().reason == NO_PLAN
