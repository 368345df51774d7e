"""A second run finds itself in the map of the first, wherever it starts; who is carried off is found again."""

from pathlib import Path

import numpy as np
import pytest
from beginnings import begins_here
from boxes import Array, Box, pose, room, scan, scene_of
from carried_off import carried_off
from drives import fed, off, small_drive, small_run

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.config import Config
from sgslam.config.tracking_settings import TrackingSettings
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.result import Result
from sgslam.session import PriorMap
from sgslam.session.checkpoints import write_run
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
    write_run(folder, {"finished": True}, slam.state())
    result.clouds.copy_to(folder / CLOUDS)
    return result


def apart(run: Trajectory, truth: Trajectory) -> float:
    """(m) RMSE of a run's positions to the truth's at the same stamps."""
    return float(np.sqrt(np.mean(np.sum(off(run, truth) ** 2, axis=1))))


@pytest.mark.long
def test_a_second_run_finds_itself_in_the_map_of_the_first_and_is_joined_to_it(tmp_path: Path) -> None:
    drive, first, (scans, truth) = small_drive(), write_first_run(tmp_path, True), way_back()
    known = PriorMap.load(tmp_path, Config())
    assert np.allclose(known.T_bim_map, first.T_bim_map)
    result = fed(SceneGraphSlam(drive.bim, prior=known), scans).finish()
    assert result.relocalisation is not None and result.relocalisation.found and result.anchored
    before = apart(first.trajectory, drive.truth)
    assert apart(result.trajectory, truth) < before + 0.02
    assert apart(result.earlier[0], drive.truth) < before + 0.02
    assert len(result.s_graph.rooms) == len(first.s_graph.rooms)  # what both saw is there once
    assert len(result.s_graph.wall_surfaces) <= len(first.s_graph.wall_surfaces) + 3
    assert len(result.clouds) > 1.8 * len(first.clouds)
    assert result.keyframes == len(result.s_graph.keyframes) and result.metrics()["runs"] == 2


def test_a_run_elsewhere_is_not_found(tmp_path: Path) -> None:
    write_first_run(tmp_path, anchored=False)
    slam = SceneGraphSlam(prior=PriorMap.load(tmp_path, Config()))
    result = fed(slam, stamped(bare_room(25))).finish()
    assert result.relocalisation is not None and not result.relocalisation.found and not result.earlier
    assert len(result.trajectory) == 25 and begins_here(result.trajectory.poses[0])


def test_a_map_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no run state"):
        PriorMap.load(tmp_path, Config())
    write_run(tmp_path, {}, fed(SceneGraphSlam(), small_drive().scans[:5]).state())
    with pytest.raises(UserError, match="--resume"):
        PriorMap.load(tmp_path, Config())


def test_who_is_carried_off_is_found_again() -> None:
    """Half of the drive, then, the scans being off, from its end back to its beginning."""
    drive = small_drive()
    order = [*range(len(drive.scans) // 2), *range(len(drive.scans) - 1, -1, -1)]
    scans = stamped([drive.scans[k][1] for k in order])
    slam = fed(SceneGraphSlam(drive.bim), scans)
    found, result = slam.finish().relocalisation, slam.finish()  # once more, which joins nothing again
    assert found is not None and found.found and result.relocalisation == found
    assert len(result.trajectory) == len(scans) and not result.earlier and result.anchored
    assert result.quality["map_against_odometry"].ok  # though the odometry began again
    truth = Trajectory(np.array([stamp for stamp, _ in scans]), drive.truth.poses[order])
    assert apart(result.trajectory, truth) < 0.05


def test_no_scan_is_missing_where_a_sensor_is_carried_off_in_its_first_seconds() -> None:
    """While all scans still wait for gravity. Those under a cover before are lost, and stay with the first map."""
    slam = SceneGraphSlam()
    for stamp_ns, points in carried_off():
        slam.add_scan(stamp_ns, points)
    told = slam.finish().uncertainty
    assert slam.kidnaps == 1 and told.stamps_ns.tolist() == [stamp for stamp, _ in carried_off()]
    assert told.part.tolist() == [0] * 28 + [1] * 30
    assert told.lost[20:28].all() and set(told.health[28:]) != {"lost"}


def test_a_beginning_under_a_cover_is_not_the_map() -> None:
    cover = [0.2 + 0.02 * np.random.default_rng(k).normal(size=(200, 3)) for k in range(30)]
    scans = [(10**8 * k, points) for k, points in enumerate([*cover, *(own for _, own in carried_off()[28:])])]
    slam = SceneGraphSlam()
    for one in scans:
        slam.add_scan(*one)
    result = slam.finish()
    known = result.uncertainty
    assert known.part.tolist() == [1] * 30 + [0] * 30
    assert known.lost[:30].all() and set(known.health[30:]) == {"good"}
    assert np.isnan(known.sigma[:30]).all() and np.isfinite(known.sigma[30:]).all()
    assert result.relocalisation is not None and result.relocalisation.reason == "all scans before it are lost"
    assert len(result.s_graph.rooms) == 1


SEEN, CAPPED, LIKE, ELSEWHERE = 60, 8, 20, 30  # scans
FOUND, LEFT = SEEN + CAPPED, SEEN + CAPPED + LIKE


def scans(*, stays: bool) -> list[tuple[int, Array]]:
    """From a corridor into a room; under a cap it may have been carried to a like one; then, unless it `stays`, in one
    that is not."""
    inner, corridor = room(0, 0, 6, 5), room(6.2, -3, 8.2, 8)
    doorway: list[Box] = [(6, 0, 0, 6.2, 2, 2.6), (6, 3, 0, 6.2, 5, 2.6), (6, 2, 2.1, 6.2, 3, 2.6)]
    cupboard: Box = (1, 4, 0, 2, 5, 2)
    here = scene_of([*inner[:3], *inner[4:], *corridor[:2], *corridor[3:], *doorway, cupboard])
    there = scene_of([*room(20, 0, 29, 7), (23, 2, 0, 24, 4, 2.6), (26, 5, 0, 27, 7, 2.6)])
    points = [scan(here, pose(8.0 - 0.09 * k, 2.5, 1, yaw=np.pi), seed=k) for k in range(SEEN)]
    points += [0.4 * np.random.default_rng(k).normal(size=(20, 3)) for k in range(CAPPED)]
    last = LEFT + (ELSEWHERE if stays else 0)
    points += [scan(here, pose(2.7, 2.5, 1, yaw=np.pi), seed=k) for k in range(FOUND, last)]
    points += [scan(there, pose(25 + 0.03 * k, 2, 1, yaw=1 - 0.03 * k), seed=k) for k in range(LEFT + ELSEWHERE - last)]
    return [(10**8 * k, own) for k, own in enumerate(points)]


def slam(unconfirmed: float) -> SceneGraphSlam:
    settings = TrackingSettings(unconfirmed=unconfirmed, gravity_until=5.0)
    return SceneGraphSlam(config=Config(tracking=settings))


def test_a_place_that_soon_proves_wrong_is_not_believed() -> None:
    told = fed(slam(LIKE / 10 - 0.5), scans(stays=False)).finish().uncertainty
    assert told.part.tolist() == [0] * (FOUND + LIKE) + [1] * ELSEWHERE
    assert set(told.health[SEEN:FOUND]) == {"lost"} and "lost" not in told.health[FOUND:LEFT]


def test_a_sensor_that_stayed_is_not_sure_for_a_time_and_goes_on() -> None:
    run = slam(2.0)
    healths = [run.add_scan(*own).health for own in scans(stays=True)]
    assert healths[FOUND : FOUND + 21] == ["lost"] * 21 and set(healths[FOUND + 21 :]) == {"good"}
    result = run.finish()
    assert run.kidnaps == 0 and not result.uncertainty.part.any()
    assert set(result.uncertainty.health[FOUND:]) == {"good"}
