"""Times of points from their order: right where the order tells them, None where it does not."""

import functools
import time
from pathlib import Path

import numpy as np
import pytest
from boxes import Array, pose, room, scene_of
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.scans import ScanFolder
from data.scans.point_times import Stamped
from data.simulation import SpinningSensor
from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.odometry.timed import TimedOdometry
from sgslam.perception.point_times import GuessedTimes, guessed_times

Ints = NDArray[np.int64]
PERIOD = 0.1  # s
REAL = Path(__file__).resolve().parents[4] / "shared/data/scans/vlp16_room_corridor"
FILTERED = 6  # the one of the real scans that was filtered: its points are in no order


@functools.cache
def scene() -> TriangleScene:
    """A room with a cupboard."""
    return scene_of([*room(0, 0, 8, 6), (5, 1, 0, 6, 1.5, 2)])


@functools.cache
def spun() -> tuple[Array, Array]:
    """(N, 3) a scan in firing order, and (N,) its times."""
    sensor = SpinningSensor(azimuths=600)
    points, times = sensor.scan(scene(), pose(3, 3, 1.2, roll=0.3), np.random.default_rng(0)), sensor.rays(0)[1]
    assert len(points) == len(times)  # the room is closed
    return points.astype(float), times


def ring_by_ring(points: Array) -> Ints:
    """Indices."""
    elevation = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    return np.argsort(np.rint(elevation), kind="stable")


def half(count: int, seed: int) -> Ints:
    """Indices of a random half, in order."""
    return np.sort(np.random.default_rng(seed).permutation(count)[: count // 2])


def turned(points: Array, angle: float, clockwise: bool) -> Array:
    """The same by a sensor that begins at another azimuth, and turns the other way."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) * ([1, -1, 1] if clockwise else [1, 1, 1])


def faults(found: GuessedTimes | None, rule: str, times: Array, within: float = 1e-6) -> list[str]:
    """What is wrong with times that should follow this rule and be these (N,) seconds."""
    if found is None:
        return ["no times"]
    off = float(np.abs(found.seconds - times).max())
    kept = {
        f"rule {found.rule}": found.rule == rule,
        f"{off} s off": off <= within,
        "outside the period": found.seconds.min() >= 0 and found.seconds.max() < PERIOD,
    }
    return [name for name, is_kept in kept.items() if not is_kept]


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("angle", [0.0, 0.4, 1.9, 3.1, 5.0])
def test_a_turn_from_any_azimuth_in_either_sense(angle: float, clockwise: bool) -> None:
    points, times = spun()
    points = turned(points, angle, clockwise)
    assert faults(guessed_times(points, PERIOD), "azimuth", times) == []
    rings = ring_by_ring(points)
    assert faults(guessed_times(points[rings], PERIOD), "rings", times[rings]) == []


@pytest.mark.parametrize("seed", range(10))
def test_lost_returns_change_nothing(seed: int) -> None:
    points, times = spun()
    kept = half(len(points), seed)
    assert faults(guessed_times(points[kept], PERIOD), "azimuth", times[kept], within=0.0005) == []
    rings = ring_by_ring(points)
    rings = rings[half(len(rings), seed)]
    assert faults(guessed_times(points[rings], PERIOD), "rings", times[rings], within=0.0005) == []


def test_an_open_side_is_no_shorter_turn() -> None:
    points, times = spun()
    seen = (times < 0.03) | (times > 0.055)
    assert faults(guessed_times(points[seen], PERIOD), "azimuth", times[seen]) == []


@pytest.mark.parametrize(("share", "told"), [(0.97, True), (0.8, True), (0.6, False)])
def test_a_scan_of_less_than_a_turn(share: float, told: bool) -> None:
    points, times = spun()
    found = guessed_times(points[times < share * PERIOD], PERIOD)
    if told:
        assert faults(found, "azimuth", times[times < share * PERIOD]) == []
    else:
        assert found is None


@pytest.mark.parametrize(("more", "told"), [(0.02, True), (0.08, True), (0.3, False), (1.0, False)])
def test_a_scan_of_more_than_a_turn(more: float, told: bool) -> None:
    points, times = spun()
    again = times < more * PERIOD
    found = guessed_times(np.concatenate([points, points[again]]), PERIOD)
    if told:
        shorter = np.concatenate([times, times[again] + PERIOD]) / (1 + more)
        assert faults(found, "azimuth", shorter, within=0.0005) == []
    else:
        assert found is None


def looking(rays: Array) -> Array:
    """(N, 3) points on rays (N, 3) from the middle of the room."""
    T = pose(3, 3, 1.2)
    return np.asarray(rays * scene().distances(T[:3, 3], rays)[:, None])


def rosette(fast: float, slow: float, count: int = 20000) -> Array:
    """(N, 3) by two prisms that turn against each other, about x."""
    share = np.linspace(0.0, 1.0, count)
    off, around = np.radians(35) * np.cos(2 * np.pi * fast * share), 2 * np.pi * slow * share
    return looking(np.stack([np.cos(off), np.sin(off) * np.cos(around), np.sin(off) * np.sin(around)], axis=1))


def dome(turns: float, lasers: int, count: int = 20000) -> Array:
    """(N, 3) by lasers, fired in turn, that go around while they go up and down."""
    laser = np.arange(count) % lasers
    share = (np.arange(count) - laser) / count
    azimuth = 2 * np.pi * turns * share + 0.05 * laser
    e = np.radians(22 + 29 * np.sin(2 * np.pi * 37.3 * share + 0.4 * laser))
    return looking(np.stack([np.cos(e) * np.cos(azimuth), np.cos(e) * np.sin(azimuth), np.sin(e)], axis=1))


@pytest.mark.parametrize(
    "points",
    [rosette(22.6, 13.7), rosette(40.2, -33.3), dome(3.3, 1), dome(6.7, 4), dome(12.0, 4)],
    ids=["rosette", "rosette back", "dome", "dome 4", "dome 4 fast"],
)
def test_a_sensor_that_does_not_turn_once_around(points: Array) -> None:
    times = np.arange(len(points)) * np.float64(PERIOD / len(points))
    assert faults(guessed_times(points, PERIOD), "index", times) == []
    kept = half(len(points), 1)
    assert faults(guessed_times(points[kept], PERIOD), "index", times[kept], within=0.002) == []
    assert guessed_times(np.random.default_rng(2).permutation(points), PERIOD) is None


def sorted_otherwise(points: Array) -> dict[str, Ints]:
    """The orders that programs leave behind."""
    cells = np.floor(points / 0.25).astype(int)
    _, first = np.unique(cells, axis=0, return_index=True)
    orders = {axis: np.argsort(points[:, k]) for k, axis in enumerate("xyz")}
    orders |= {"voxels": first, "grid": np.lexsort(cells.T), "range": np.argsort(np.linalg.norm(points, axis=1))}
    return orders | {f"shuffled {k}": np.random.default_rng(k).permutation(len(points)) for k in range(20)}


@pytest.mark.parametrize("points", [spun()[0], rosette(22.6, 13.7), dome(6.7, 4)], ids=["spun", "rosette", "dome"])
def test_another_order_tells_nothing(points: Array) -> None:
    told = [name for name, order in sorted_otherwise(points).items() if guessed_times(points[order], PERIOD)]
    assert told == []


def test_rings_that_begin_anywhere_tell_nothing() -> None:
    points, times = spun()
    order = ring_by_ring(points)
    ring = np.rint(np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))))[order]
    begin = np.random.default_rng(0).uniform(0, PERIOD, 100)[ring.astype(int)]
    assert guessed_times(points[order][np.lexsort(((times[order] - begin) % PERIOD, ring))], PERIOD) is None


def test_few_points_tell_nothing() -> None:
    points, _ = spun()
    assert guessed_times(points[:: len(points) // 150], PERIOD) is None
    assert guessed_times(points[:0], PERIOD) is None


@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL} is not there")
def test_real_scans() -> None:
    for scan in ScanFolder(REAL):
        if scan.index == FILTERED:
            assert guessed_times(scan.points, PERIOD) is None
            continue
        found = guessed_times(scan.points, PERIOD)
        assert found is not None
        assert found.rule == "azimuth"
        assert np.maximum.accumulate(found.seconds)[-1] > 0.95 * PERIOD
        assert (np.maximum.accumulate(found.seconds) - found.seconds).max() < 0.001
        rings = ring_by_ring(scan.points)
        by_rings = guessed_times(scan.points[rings], PERIOD)
        assert by_rings is not None
        assert by_rings.rule == "rings"
        assert np.quantile(np.abs(by_rings.seconds - found.seconds[rings]), 0.99) < 0.003
        assert guessed_times(np.random.default_rng(scan.index).permutation(scan.points), PERIOD) is None


def test_it_takes_no_time() -> None:
    points = np.repeat(spun()[0], 3, axis=0)[:20000]
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        guessed_times(points, PERIOD)
        times.append(time.perf_counter() - begin)
    assert min(times) < 0.01  # measured: 0.0004


def test_of_a_sensor_that_does_not_turn_once_around_every_scan_is_in_the_order_of_time() -> None:
    """Where walls are close, the order alone does not show it."""
    unclear = np.random.default_rng(2).permutation(dome(6.7, 4))
    middle, even = np.full(len(unclear), PERIOD / 2), np.arange(len(unclear)) * (PERIOD / len(unclear))
    for before, times in ((dome(6.7, 4), even), (spun()[0], middle), (unclear, middle)):
        odometry = TimedOdometry(lambda: ContinuousTimeOdometry(TrackingSettings()), "order")
        odometry.register(0, before)
        told = odometry.times_of(unclear, None)
        assert told is not None and np.allclose(told, times)


@pytest.mark.parametrize(("stamped", "begin"), [("start", 0.0), ("middle", -PERIOD / 2), ("end", -PERIOD)])
def test_guessed_times_are_seconds_after_the_instant_that_is_stamped(stamped: Stamped, begin: float) -> None:
    """Those of a snapshot are all the stamp's."""
    points, times = spun()
    odometry = TimedOdometry(lambda: ContinuousTimeOdometry(TrackingSettings()), "order", stamped)
    odometry.register(10**9, points)
    told = odometry.times_of(points, None)
    assert told is not None and told == pytest.approx(begin + times, abs=1e-6)
    mixed = odometry.times_of(np.random.default_rng(0).permutation(points), None)
    assert mixed is not None and np.all(mixed == begin + PERIOD / 2)
    snapshots = TimedOdometry(lambda: ContinuousTimeOdometry(TrackingSettings()), "snapshot", stamped)
    assert snapshots.register(0, points).point_times is None
