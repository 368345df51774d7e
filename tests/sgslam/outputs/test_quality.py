"""The signals that tell a sound map from a lost one, those of a map at a place, and which walls a way crosses."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from boxes import Array, pose
from numpy.typing import NDArray

from data import Door, Floor, SceneGraph, WallSurface
from data.trajectory import Trajectory
from sgslam.anchoring.soundness import Soundness, shipped
from sgslam.config import QualitySettings
from sgslam.session.soundness.quality import Quality, contradiction, placed_signals, quality_of
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty, what_is_not_anchored
from sgslam.session.soundness.standing_walls import seen_parts, walls_crossed

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
    health = np.where(why == 1, "lost", "good")
    return ScanUncertainty(
        np.arange(n), deviations, (why == 2).astype(np.int64), np.full(n, ""), anchored.astype(float), anchored, health
    )


WAY = way((0.0, 0.0, 0.0), (6.0, 0.0, 0.0), (6.0, 4.0, 0.0), steps=SCANS // 2)[:SCANS]


def known_at(sure: int, sigma: float, left_out: tuple[int, ...] = ()) -> ScanUncertainty:
    deviations, number = np.zeros((SCANS, 6)), np.arange(SCANS)
    deviations[:, 0] = np.where(number < sure, sigma, 9.0)
    return known(deviations, (number < sure) & ~np.isin(number, left_out))


def judged(
    lost: int = 0,
    sigma: float = 0.1,
    walls_seen: tuple[int, ...] = (4,) * 10,
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
    positions, odometry = WAY, WAY.copy()
    odometry[:, :2] += bend * np.sin(np.linspace(0.0, 6 * np.pi, SCANS))[:, None]
    for begin in begins[1:]:
        odometry[begin:] = odometry[begin:, [1, 2, 0]] + 3.0
    uncertainty = known_at(sure, sigma, left_out)
    maps, seen = (trajectory(positions), trajectory(odometry)), (list(begins), list(walls_seen))
    return quality_of(*maps, *seen, uncertainty, lost / SCANS, unplaced / SCANS, QualitySettings())


def planned(*places: float) -> SceneGraph:
    """Walls across the way, at x."""
    return SceneGraph("bim", (), tuple(replace(WALL, id=f"w{x}", centroid=(x, 0.0)) for x in places))


def placed(
    plan: SceneGraph, begins: tuple[int, ...] = (0,), left_out: tuple[int, ...] = (), tilt: float = 0.0,
    positions: Array = WAY, rays: float = 0.0,
) -> dict[str, float]:  # fmt: skip
    """The signals of the map at a place in the plan, tilted by so many degrees."""
    T, quality = pose(0.0, 0.0, roll=np.radians(tilt)), judged()
    return placed_signals(
        quality, trajectory(positions), list(begins), known_at(SCANS, 0.1, left_out), T, plan, rays
    )  # fmt: skip


def crossed(plan: SceneGraph, begins: tuple[int, ...] = (0,), left_out: tuple[int, ...] = ()) -> float:
    return placed(plan, begins, left_out)["planned_walls_crossed"]


@pytest.mark.parametrize(
    ("signal", "inside", "outside"),
    [
        ("lost_scans", judged(lost=5), judged(lost=6)),
        ("unplaced_scans", judged(unplaced=5), judged(unplaced=6)),
        ("keyframes_without_walls", judged(walls_seen=(0,) * 3 + (9,) * 7), judged(walls_seen=(0,) * 4 + (9,) * 6)),
        ("walls_per_keyframe", judged(walls_seen=(3,)), judged(walls_seen=(3, 2))),
        ("position_sigma_m", judged(sigma=0.199), judged(sigma=0.201)),
        ("map_against_odometry", judged(bend=0.099), judged(bend=0.101)),
        ("map_against_odometry", judged(bend=0.09, begins=(0, 30, 60)), judged(bend=0.2, begins=(0, 30, 60))),
    ],
)
def test_a_signal_is_kept_up_to_its_limit(signal: str, inside: Quality, outside: Quality) -> None:
    assert inside[signal].ok and not outside[signal].ok
    assert inside[signal].limit == outside[signal].limit
    assert all(value.ok for name, value in outside.items() if name != signal)


def test_only_a_way_that_was_followed_crosses_walls() -> None:
    plan = planned(3.05, 5.05)
    assert crossed(plan) == 2
    fewer = [k for k in range(1, SCANS) if crossed(plan, begins=(0, k)) == 1]
    assert len(fewer) == 2  # where the odometry begins again in one of the walls
    assert crossed(plan, left_out=(fewer[0],)) == 1


def test_two_scans_that_follow_one_another_cross_a_wall() -> None:
    plan = planned(3.05)
    after = next(k for k in range(SCANS) if not crossed(plan, begins=(0, k)))
    for kept in ((after - 1, after), (after - 1,), (after,)):
        others = tuple(k for k in range(SCANS) if k not in kept)
        assert crossed(plan, left_out=others) == (len(kept) == 2)


def test_a_place_that_is_crossed_several_times_counts_once() -> None:
    plan, to, fro = planned(2.0, 5.0), (6.0, 0.1, 0.0), (0.0, -0.2, 0.0)
    once, thrice = (way((0.0, 0.0, 0.0), *corners, steps=SCANS)[:: len(corners)] for corners in ((to,), (to, fro, to)))
    for positions in (once, thrice):
        assert placed(plan, positions=positions[:SCANS])["planned_walls_crossed"] == 2


@pytest.mark.parametrize(("apart", "count"), [(0.9, 1), (1.1, 2)])
def test_the_faces_of_a_wall_are_crossed_together(apart: float, count: int) -> None:
    assert crossed(planned(3.0, 3.0 + apart)) == count


def test_the_signals_of_a_place() -> None:
    found = placed(planned(), tilt=1.2, rays=0.03)
    assert found["plan_tilt_deg"] == pytest.approx(1.2) and found["walls_looked_through"] == 0.03
    assert found["planned_walls_crossed"] == 0 and found["position_sigma_m"] == pytest.approx(0.1)
    assert found.keys() == shipped().sound.keys() == shipped().unsound.keys()


@pytest.mark.parametrize(
    ("worst", "value", "said"),
    [
        ("planned_walls_crossed", 3.0, "crosses 3 walls"),
        ("plan_tilt_deg", 2.34, "2.3 degrees"),
        ("map_against_odometry", 0.05, "5.0% of the way"),
        ("walls_looked_through", 0.12, "12% of the walls"),
        ("position_sigma_m", 0.4, "0.40 m"),
    ],
)
def test_a_place_that_is_not_kept_says_why(worst: str, value: float, said: str) -> None:
    signals = placed(planned(3.0)) | {worst: value}
    for probability in (0.4567, 0.0123, 0.0):
        sound = Soundness(probability, dict.fromkeys(signals, 1.0) | {worst: -3.0})
        reason = contradiction(probability, sound, signals, 0.5)
        assert reason is not None and said in reason and f"{100 * probability:.1f} %" in reason
        assert contradiction(probability, sound, signals, probability) is None


def test_the_position_sigma_is_of_the_anchored_scans_or_of_all() -> None:
    every = tuple(range(SCANS))
    assert judged(sure=50)["position_sigma_m"].value == pytest.approx(0.1)
    assert judged(sure=0)["position_sigma_m"].value == pytest.approx(9.0)
    of_all = [judged(sure=sure, left_out=every)["position_sigma_m"].ok for sure in (96, 94)]
    assert of_all == [True, False]


@pytest.mark.parametrize(
    ("wall", "across"),
    [
        (WALL, True),
        (replace(WALL, length=None), False),
        (replace(WALL, centroid=(5.0, 3.0)), False),
        (replace(WALL, parts=((True, -2.0, -0.5, None), (True, 0.5, 2.0, None))), False),  # an opening
        (replace(WALL, parts=((True, -2.0, 0.5, None), (True, 1.0, 1.0, None))), True),
    ],
)
def test_a_way_crosses_what_stands_of_a_wall(wall: WallSurface, across: bool) -> None:
    there = way((0.0, 0.0, 0.0), (10.0, 0.0, 0.0))
    assert (len(walls_crossed(there, SceneGraph("bim", (), (wall,)))) > 0) is across


@pytest.mark.parametrize(("y", "across"), [(0.75, False), (0.85, True)])
def test_a_way_through_a_door_crosses_no_wall(y: float, across: bool) -> None:
    plan = SceneGraph("bim", (), (WALL,), (Door("d", ("a", "b"), (5.0, y)),))
    assert (len(walls_crossed(way((0.0, 0.0, 0.0), (10.0, 0.0, 0.0), steps=1000), plan)) > 0) is across


def test_a_way_crosses_walls_of_its_own_storey() -> None:
    floors = (Floor("low", "", 0.0), Floor("high", "", 3.0))
    plan = SceneGraph("bim", (), (replace(WALL, floor="high"),), floors=floors)
    for z, across in ((1.0, False), (3.0, True), (2.99, False), (-0.2, False)):
        assert (len(walls_crossed(way((0.0, 0.0, z), (10.0, 0.0, z)), plan)) > 0) is across
    low = SceneGraph("bim", (), (replace(WALL, floor="low"),), floors=floors)
    assert len(walls_crossed(way((0.0, 0.0, -0.2), (10.0, 0.0, -0.2)), low)) > 0


def test_a_way_of_single_scans_on_a_storey_crosses_nothing() -> None:
    floors = (Floor("low", "", 0.0), Floor("high", "", 3.0))
    plan = SceneGraph("bim", (), tuple(replace(WALL, id=f"w-{f}", floor=f) for f in ("low", "high")), floors=floors)
    hopping = np.array([[4.0, 0.0, 1.0], [6.0, 0.0, 3.5], [4.0, 0.0, 1.0]])
    assert len(walls_crossed(hopping, plan)) == 0
    assert len(walls_crossed(np.concatenate([hopping, [[6.0, 0.0, 1.0]]]), plan)) > 0  # two scans are a way


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
