"""The signals that tell a sound map from a lost one: each limit from both sides, and which walls a way crosses."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from boxes import Array, pose
from numpy.typing import NDArray

from data import Door, Floor, SceneGraph, WallSurface
from data.trajectory import Trajectory
from sgslam.config import QualitySettings
from sgslam.session.soundness.quality import Quality, contradiction, quality_of, walls_crossed
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty, what_is_not_anchored
from sgslam.session.soundness.standing_walls import seen_parts

SCANS = 100
WALL = WallSurface("w", None, (5.0, 0.0), (1.0, 0.0), 4.0)


def way(*corners: tuple[float, float, float], steps: int = 100) -> Array:
    """(N, 3) along straight lines between corners."""
    parts = [np.linspace(p, q, steps, endpoint=False) for p, q in pairwise(corners)]
    return np.concatenate([*parts, [corners[-1]]])


def trajectory(positions: Array) -> Trajectory:
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    return Trajectory(np.arange(len(positions)) * 10**8, poses)


def known(deviations: Array, anchored: NDArray[np.bool_], cause: int | NDArray[np.int64] = 0) -> ScanUncertainty:
    """`cause` why a scan is not anchored: 1 it is lost, 2 it is in another part."""
    n, why = len(deviations), np.broadcast_to(cause, len(deviations))
    health: Any = tuple("lost" if c == 1 else "good" for c in why)
    return ScanUncertainty(
        np.arange(n), deviations, (why == 2).astype(np.int64), ("",) * n, anchored.astype(float), anchored, health
    )


def judged(
    lost: int = 0,
    sigma: float = 0.1,
    walls_seen: tuple[int, ...] = (4,) * 10,
    tilt: float | None = None,
    plan: SceneGraph | None = None,
    sure: int = SCANS,
    bend: float = 0.0,
    begins: tuple[int, ...] = (0,),
    unplaced: int = 0,
    left_out: tuple[int, ...] = (),
) -> Quality:
    """Of a way of 10 m, first along x from the origin, of whose scans `sure` ones are anchored and have a sigma (m).

    The odometry leaves the way by up to `bend` (m), and is in another frame from each of the scans `begins` on. Scans
    that are `left_out` are not anchored.
    """
    positions = way((0.0, 0.0, 0.0), (6.0, 0.0, 0.0), (6.0, 4.0, 0.0), steps=SCANS // 2)[:SCANS]
    odometry = positions.copy()
    odometry[:, :2] += bend * np.sin(np.linspace(0.0, 6 * np.pi, SCANS))[:, None]
    for begin in begins[1:]:
        odometry[begin:] = odometry[begin:, [1, 2, 0]] + 3.0
    deviations = np.zeros((SCANS, 6))
    deviations[:, 0] = np.where(np.arange(SCANS) < sure, sigma, 9.0)
    anchored = (np.arange(SCANS) < sure) & ~np.isin(np.arange(SCANS), left_out)
    uncertainty, shares = known(deviations, anchored), (lost / SCANS, unplaced / SCANS)
    T_bim_map = None if tilt is None else pose(0.0, 0.0, roll=np.radians(tilt))
    maps, seen = (trajectory(positions), trajectory(odometry)), (list(begins), list(walls_seen))
    return quality_of(*maps, *seen, uncertainty, *shares, T_bim_map, plan, QualitySettings())


def planned(*places: float) -> SceneGraph:
    """Walls across the way, at x."""
    return SceneGraph("bim", (), tuple(replace(WALL, id=f"w{x}", centroid=(x, 0.0)) for x in places))


@pytest.mark.parametrize(
    ("signal", "inside", "outside"),
    [
        ("lost_scans", judged(lost=5), judged(lost=6)),
        ("unplaced_scans", judged(unplaced=5), judged(unplaced=6)),
        ("keyframes_without_walls", judged(walls_seen=(0,) * 3 + (9,) * 7), judged(walls_seen=(0,) * 4 + (9,) * 6)),
        ("walls_per_keyframe", judged(walls_seen=(3,)), judged(walls_seen=(3, 2))),
        ("position_sigma_m", judged(sigma=0.199), judged(sigma=0.201)),
        ("plan_tilt_deg", judged(tilt=0.99, plan=SceneGraph("bim")), judged(tilt=1.01, plan=SceneGraph("bim"))),
        ("map_against_odometry", judged(bend=0.099), judged(bend=0.101)),
        ("map_against_odometry", judged(bend=0.09, begins=(0, 30, 60)), judged(bend=0.2, begins=(0, 30, 60))),
        ("planned_walls_crossed", judged(tilt=0.0, plan=planned(3.0)), judged(tilt=0.0, plan=planned(3.0, 5.0))),
    ],
)
def test_a_signal_is_kept_up_to_its_limit(signal: str, inside: Quality, outside: Quality) -> None:
    assert inside[signal].ok and not outside[signal].ok
    assert inside[signal].limit == outside[signal].limit
    assert all(value.ok for name, value in outside.items() if name != signal)


def test_only_a_way_that_was_followed_crosses_walls() -> None:
    plan = planned(3.05, 5.05)
    crossed = [k for k in range(1, SCANS) if judged(tilt=0.0, plan=plan, begins=(0, k))["planned_walls_crossed"].ok]
    assert len(crossed) == 2  # where the odometry begins again in one of the walls
    assert judged(tilt=0.0, plan=plan, left_out=(crossed[0],))["planned_walls_crossed"].value == 1


def test_two_scans_that_follow_one_another_cross_a_wall() -> None:
    plan = planned(3.05)
    alone = (judged(tilt=0.0, plan=plan, begins=(0, k))["planned_walls_crossed"].value for k in range(SCANS))
    after = next(k for k, crossed in enumerate(alone) if not crossed)
    for kept in ((after - 1, after), (after - 1,), (after,)):
        others = tuple(k for k in range(SCANS) if k not in kept)
        crossed = judged(tilt=0.0, plan=plan, left_out=others)["planned_walls_crossed"].value
        assert crossed == (len(kept) == 2)


def test_a_place_is_contradicted_by_crossed_walls_and_by_a_tilt() -> None:
    assert contradiction(judged(sigma=9.0)) is None  # it has no place in a plan
    assert contradiction(judged(tilt=0.99, plan=planned(3.0))) is None
    crossed, tilted = judged(tilt=0.0, plan=planned(3.0, 5.0)), judged(tilt=1.21, plan=planned())
    assert "crosses 2 walls" in str(contradiction(crossed))
    assert "planned_walls_crossed=2 accepts" in str(contradiction(crossed))
    assert "1.2 degrees" in str(contradiction(tilted)) and "plan_tilt=1.3 accepts" in str(contradiction(tilted))


def test_signals_of_the_plan_are_of_anchored_runs() -> None:
    of_plan = {"plan_tilt_deg", "planned_walls_crossed"}
    assert not of_plan & judged(plan=SceneGraph("bim")).keys() and not of_plan & judged(tilt=0.0).keys()
    assert of_plan <= judged(tilt=0.0, plan=SceneGraph("bim")).keys()


def test_the_position_sigma_is_of_the_anchored_scans_or_of_all() -> None:
    assert judged(sure=50)["position_sigma_m"].value == pytest.approx(9.0)
    assert judged(sure=50, tilt=0.0)["position_sigma_m"].value == pytest.approx(0.1)
    assert judged(sure=96)["position_sigma_m"].ok and not judged(sure=94)["position_sigma_m"].ok
    assert "position_sigma_m" not in judged(sure=0, tilt=0.0)


@pytest.mark.parametrize(
    ("wall", "crossed"),
    [
        (WALL, 1),
        (replace(WALL, length=None), 0),
        (replace(WALL, centroid=(5.0, 3.0)), 0),
        (replace(WALL, parts=((True, -2.0, -0.5, None), (True, 0.5, 2.0, None))), 0),  # an opening
        (replace(WALL, parts=((True, -2.0, 0.5, None), (True, 1.0, 1.0, None))), 1),
    ],
)
def test_a_way_crosses_what_stands_of_a_wall(wall: WallSurface, crossed: int) -> None:
    there = way((0.0, 0.0, 0.0), (10.0, 0.0, 0.0))
    assert walls_crossed(there, SceneGraph("bim", (), (wall,))) == crossed


@pytest.mark.parametrize(("apart", "crossed"), [(0.95, 1), (1.05, 2)])
def test_the_faces_of_a_wall_are_crossed_together(apart: float, crossed: int) -> None:
    faces = WALL, replace(WALL, id="v", centroid=(5.0 + apart, 0.0))
    there = way((0.0, 0.0, 0.0), (10.003, 0.0, 0.0), steps=1000)
    assert walls_crossed(there, SceneGraph("bim", (), faces)) == crossed


@pytest.mark.parametrize(("y", "crossed"), [(0.75, 0), (0.85, 1)])
def test_a_way_through_a_door_crosses_no_wall(y: float, crossed: int) -> None:
    plan = SceneGraph("bim", (), (WALL,), (Door("d", ("a", "b"), (5.0, y)),))
    assert walls_crossed(way((0.0, 0.0, 0.0), (10.0, 0.0, 0.0), steps=1000), plan) == crossed


def test_a_way_crosses_walls_of_its_own_storey() -> None:
    floors = (Floor("low", "", 0.0), Floor("high", "", 3.0))
    plan = SceneGraph("bim", (), (replace(WALL, floor="high"),), floors=floors)
    for z, crossed in ((1.0, 0), (3.0, 1), (2.99, 0), (-0.2, 0)):
        assert walls_crossed(way((0.0, 0.0, z), (10.0, 0.0, z)), plan) == crossed
    low = SceneGraph("bim", (), (replace(WALL, floor="low"),), floors=floors)
    assert walls_crossed(way((0.0, 0.0, -0.2), (10.0, 0.0, -0.2)), low) == 1


def test_a_way_of_single_scans_on_a_storey_crosses_nothing() -> None:
    floors = (Floor("low", "", 0.0), Floor("high", "", 3.0))
    plan = SceneGraph("bim", (), tuple(replace(WALL, id=f"w-{f}", floor=f) for f in ("low", "high")), floors=floors)
    hopping = np.array([[4.0, 0.0, 1.0], [6.0, 0.0, 3.5], [4.0, 0.0, 1.0]])
    assert walls_crossed(hopping, plan) == 0
    assert walls_crossed(np.concatenate([hopping, [[6.0, 0.0, 1.0]]]), plan) == 1  # two scans are a way


def test_scans_that_are_not_anchored_are_counted_by_cause() -> None:
    def told(anchored: int, lost: int, apart: int, unsure: int) -> ScanUncertainty:
        cause = np.repeat(np.arange(4), (anchored, lost, apart, unsure))
        return known(np.zeros((len(cause), 6)), cause == 0, cause)

    assert what_is_not_anchored(told(9, 0, 0, 0)) == ""
    assert what_is_not_anchored(told(9, 0, 3, 0)) == "of 12 scans 3 are in parts that were not placed"
    everything = what_is_not_anchored(told(3, 2, 4, 1))
    assert everything.startswith("of 10 scans 2 are lost, 4 are in parts") and "1 have poses" in everything


def test_a_wall_stands_where_the_map_has_it_too() -> None:
    """Two walls in one plane, a door between them; the map has the left end and the middle of the right one."""
    parts = (("left", -4.0, -1.0, True), ("right", 0.0, 4.0, False))
    seen = np.concatenate([np.arange(-4.2, -2.95, 0.1), np.arange(1.0, 2.05, 0.1)])
    found = seen_parts(parts, seen)
    assert [(source, whole) for source, _, _, whole in found] == [("left", True), ("right", False)]
    np.testing.assert_allclose([own[1:3] for own in found], [(-4.0, -2.95), (0.95, 2.05)], atol=1e-6)
    assert seen_parts(parts, np.empty(0)) == []
