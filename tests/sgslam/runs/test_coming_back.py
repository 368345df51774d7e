"""A second run finds itself in the map of the first, wherever it starts; who is carried off is found again."""

from pathlib import Path

import numpy as np
import pytest
from beginnings import begins_here
from boxes import Array, pose, room, scan, scene_of
from carried_off import carried_off
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
Scans = list[tuple[int, Array]]


def stamped(points: list[Array], first_ns: int = 0) -> Scans:
    return [(first_ns + 200_000_000 * k, own) for k, own in enumerate(points)]


def bare_room(count: int) -> list[Array]:
    """Scans in a room that is in no plan."""
    walls = scene_of(room(0, 0, 9, 4))
    return [scan(walls, pose(1 + 0.1 * i, 2, 1), seed=i) for i in range(count)]


def way_back() -> tuple[Scans, Trajectory]:
    """The drive from its end to its beginning, on another clock; and the true poses."""
    scans = stamped([points for _, points in reversed(small_drive().scans)], 7)
    return scans, Trajectory(np.array([stamp for stamp, _ in scans]), small_drive().truth.poses[::-1])


def write_first_run(folder: Path, anchored: bool) -> Result:
    slam, result = small_run(anchored)
    Checkpoints(folder, {}).write(slam, {}, finished=True)
    result.clouds.copy_to(folder / CLOUDS)
    return result


def apart(run: Trajectory, truth: Trajectory, T_truth_run: Array) -> float:
    """(m) RMSE of a run's positions, moved by `T_truth_run`, to the truth's at the same stamps."""
    return float(np.sqrt(np.mean(np.sum(off(run.transformed(T_truth_run), truth) ** 2, axis=1))))


@pytest.mark.long
@pytest.mark.parametrize("anchored", [False, True])
def test_a_second_run_finds_itself_in_the_map_of_the_first_and_is_joined_to_it(anchored: bool, tmp_path: Path) -> None:
    drive, first, (scans, truth) = small_drive(), write_first_run(tmp_path, anchored), way_back()
    known = PriorMap.load(tmp_path, Config())
    assert not anchored or np.allclose(known.T_bim_map, first.T_bim_map)
    result = fed(SceneGraphSlam(drive.bim if anchored else None, prior=known), scans).finish()
    assert result.relocalisation is not None and result.relocalisation.found and result.anchored == anchored
    T = np.eye(4) if anchored else drive.truth.poses[0]  # the map's frame is the first pose of the first run
    before = apart(first.trajectory, drive.truth, T)
    assert apart(result.trajectory, truth, T) < before + 0.02
    assert apart(result.earlier[0], drive.truth, T) < before + 0.02
    assert len(result.s_graph.rooms) == len(first.s_graph.rooms)  # what both saw is there once
    assert len(result.s_graph.wall_surfaces) <= len(first.s_graph.wall_surfaces) + 3
    assert len(result.clouds) > 1.8 * len(first.clouds)
    assert result.keyframes == len(result.s_graph.keyframes) and result.metrics()["runs"] == 2


def test_a_run_elsewhere_is_not_found_and_its_parts_are_asked_after_again(tmp_path: Path) -> None:
    write_first_run(tmp_path, anchored=False)
    slam = SceneGraphSlam(prior=PriorMap.load(tmp_path, Config()))
    result = fed(slam, stamped(bare_room(25))).finish()
    assert result.relocalisation is not None and not result.relocalisation.found and not result.earlier
    assert len(result.trajectory) == 25 and begins_here(result.trajectory.poses[0])
    known, part = (PriorMap.load(tmp_path, Config()) for _ in range(2))
    (tmp_path / "elsewhere").mkdir()
    alone = fed(SceneGraphSlam(), stamped(bare_room(12)))
    alone.finish()
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


def leapt() -> tuple[Scans, Trajectory]:
    """Half of the drive, then, the scans being off, from its end back to its beginning; and the true poses."""
    drive = small_drive()
    count = len(drive.scans)
    order = [*range(count // 2), *range(count - 1, -1, -1)]
    scans = stamped([drive.scans[k][1] for k in order])
    return scans, Trajectory(np.array([stamp for stamp, _ in scans]), drive.truth.poses[order])


@pytest.mark.parametrize("with_bim", [True, pytest.param(False, marks=pytest.mark.long)])
def test_who_is_carried_off_is_found_again(with_bim: bool) -> None:
    scans, truth = leapt()
    slam = fed(SceneGraphSlam(small_drive().bim if with_bim else None), scans)
    found, result = slam.finish().relocalisation, slam.finish()  # once more, which joins nothing again
    assert found is not None and found.found and result.relocalisation == found
    assert len(result.trajectory) == len(scans) and not result.earlier and result.anchored == with_bim
    assert result.quality["map_against_odometry"].ok  # though the odometry began again
    assert apart(result.trajectory, truth, np.eye(4) if with_bim else truth.poses[0]) < 0.05


@pytest.mark.long
def test_who_is_carried_where_nothing_is_known_harms_nothing() -> None:
    drive, (_, alone) = small_drive(), small_run(with_bim=True)
    count = len(drive.scans)
    assert alone.relocalisation is None
    more = stamped(bare_room(30), drive.scans[-1][0] + 200_000_000)
    result = fed(SceneGraphSlam(drive.bim), [*drive.scans, *more]).finish()
    assert result.anchored and result.relocalisation is not None and not result.relocalisation.found
    assert len(result.trajectory) == count  # only what is anchored
    assert len(result.trajectory_map) == len(result.uncertainty.stamps_ns) == count + 30
    assert result.uncertainty.part.tolist() == [0] * count + [1] * 30
    assert result.metrics()["anchored_share"] == pytest.approx(count / (count + 30))
    assert result.reason.endswith(f"; of {count + 30} scans 30 are in parts that were not placed")
    assert result.first_anchor_s == alone.first_anchor_s and drive.rmse(result) < drive.rmse(alone) + 0.005


@pytest.mark.long
def test_a_run_that_began_where_the_plan_shows_nothing_is_anchored_by_its_later_part() -> None:
    """And a third part joins it by the plan, not by the second part alone."""
    drive = small_drive()
    half = len(drive.scans) // 2
    points = [*bare_room(30), *(own for _, own in drive.scans), *(own for _, own in reversed(drive.scans[half:]))]
    result = fed(SceneGraphSlam(drive.bim), stamped(points)).finish()
    assert result.anchored and result.relocalisation is not None and result.relocalisation.found
    assert result.uncertainty.part.tolist() == [1] * 30 + [0] * (len(points) - 30)
    truth = np.concatenate([drive.truth.positions, drive.truth.positions[half:][::-1]])
    scans = np.round(result.trajectory.stamps_ns / 2e8).astype(int) - 30
    assert len(scans) > 0.95 * len(truth)
    assert np.sqrt(np.mean(np.sum((result.trajectory.positions - truth[scans]) ** 2, axis=1))) < 0.05


def test_no_scan_is_missing_where_a_sensor_is_carried_off_in_its_first_seconds() -> None:
    """While all scans still wait for gravity. Those under a cover before are lost, and stay with the first map."""
    slam = SceneGraphSlam()
    for stamp_ns, points in carried_off():
        slam.add_scan(stamp_ns, points)
    told = slam.finish().uncertainty
    assert slam.kidnaps == 1 and told.stamps_ns.tolist() == [stamp for stamp, _ in carried_off()]
    assert told.part.tolist() == [0] * 28 + [1] * 30
    assert told.health[20:28] == ("lost",) * 8 and set(told.health[28:]) != {"lost"}


def test_a_beginning_under_a_cover_is_not_the_map() -> None:
    cover = [0.2 + 0.02 * np.random.default_rng(k).normal(size=(200, 3)) for k in range(30)]
    scans = [(10**8 * k, points) for k, points in enumerate([*cover, *(own for _, own in carried_off()[28:])])]
    slam = SceneGraphSlam()
    for one in scans:
        slam.add_scan(*one)
    result = slam.finish()
    known = result.uncertainty
    assert known.part.tolist() == [1] * 30 + [0] * 30
    assert known.health[:30] == ("lost",) * 30 and set(known.health[30:]) == {"good"}
    assert np.isnan(known.sigma[:30]).all() and np.isfinite(known.sigma[30:]).all()
    assert result.relocalisation is not None and result.relocalisation.reason == "all scans before it are lost"
    assert len(result.s_graph.rooms) == 1


@pytest.mark.long
@pytest.mark.parametrize("scans_after_the_leap", [2, 40])
def test_a_run_goes_on_bit_by_bit_after_a_leap(scans_after_the_leap: int, tmp_path: Path) -> None:
    """But for loops: the state holds no clouds of keyframes, which they are closed with."""
    drive, (scans, _) = small_drive(), leapt()
    after, config = len(drive.scans) // 2 + scans_after_the_leap, Config(loops=LoopSettings(enabled=False))
    whole = fed(SceneGraphSlam(drive.bim, config=config), scans).finish()
    Checkpoints(tmp_path, {}).write(fed(SceneGraphSlam(drive.bim, config=config), scans[:after]), {})
    second = SceneGraphSlam(drive.bim, config=config)
    load(tmp_path, second)
    result = fed(second, scans[after:]).finish()
    assert np.array_equal(result.trajectory.poses, whole.trajectory.poses) and result.s_graph == whole.s_graph


@pytest.mark.long
def test_of_a_run_that_is_nowhere_it_is_told_how_many_scans_lie_apart() -> None:
    """In a plan that is not theirs; without a plan it is a map only."""
    scans = [(10**8 * k, own) for k, own in enumerate([*bare_room(40), *(own for _, own in carried_off()[28:])])]
    result = fed(SceneGraphSlam(small_drive().bim), scans).finish()
    assert not result.anchored and result.reason.endswith("30 of 70 scans are not in the first")
    assert fed(SceneGraphSlam(), scans).finish().reason == NO_PLAN
