"""Times of points from their order: right where the order tells them, None where it does not."""

import functools
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from boxes import Array, pose, room, scene_of
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.scans import ScanFolder
from data.scans.point_times import Stamped
from data.simulation import Sensor
from data.simulation.sensor import sensor_named
from sgslam.config import TrackingSettings
from sgslam.odometry.timed import Kind, TimedOdometry
from sgslam.perception.point_times import guessed_times

Ints = NDArray[np.int64]
PERIOD = 0.1  # s
REAL = Path(__file__).resolve().parents[4] / "shared/data/scans/vlp16_room_corridor"
THINNED = REAL.with_name("e1r_office") / "scans_000.npz"
FILTERED = 6  # the one of the real scans that was filtered: its points are in no order


@functools.cache
def scene() -> TriangleScene:
    """A room with a cupboard."""
    return scene_of([*room(0, 0, 8, 6), (5, 1, 0, 6, 1.5, 2)])


@functools.cache
def spun() -> tuple[Array, Array]:
    """(N, 3) a scan in firing order, and (N,) its times."""
    sensor = Sensor(azimuths=600)
    points, times = sensor.scan(scene(), pose(3, 3, 1.2, roll=0.3), np.random.default_rng(0))[0], sensor.seconds
    assert len(points) == len(times)  # the room is closed
    return points.astype(float), times


def looking(rays: Array) -> Array:
    """(N, 3) points on rays (N, 3) from the middle of the room."""
    T = pose(3, 3, 1.2)
    return np.asarray(rays * scene().distances(T[:3, 3], rays)[:, None])


def rosette(fast: float, slow: float) -> Array:
    """(N, 3) by two prisms that turn against each other, about x."""
    share = np.linspace(0.0, 1.0, 20_000)
    off, around = np.radians(35) * np.cos(2 * np.pi * fast * share), 2 * np.pi * slow * share
    return looking(np.stack([np.cos(off), np.sin(off) * np.cos(around), np.sin(off) * np.sin(around)], axis=1))


def ring_of(points: Array) -> Ints:
    """(N,) degrees of elevation."""
    return np.rint(np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))).astype(int)


def shuffled(points: Array, seed: int = 2) -> Array:
    return np.random.default_rng(seed).permutation(points)


def half(count: int, seed: int) -> Ints:
    """Indices of a random half, in order."""
    return np.sort(np.random.default_rng(seed).permutation(count)[: count // 2])


def assert_times(points: Array, rule: str, times: Array, within: float = 1e-6) -> None:
    found = guessed_times(points, PERIOD)
    assert found is not None and found.rule == rule
    assert np.abs(found.seconds - times).max() <= within
    assert found.seconds.min() >= 0 and found.seconds.max() < PERIOD


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("angle", [0.0, 0.4, 1.9, 3.1, 5.0])
def test_a_turn_from_any_azimuth_in_either_sense(angle: float, clockwise: bool) -> None:
    """Also where half of the returns are lost, or all of one side."""
    points, times = spun()
    points = points @ pose(0, 0, 0, -angle)[:3, :3].T * ([1, -1, 1] if clockwise else [1, 1, 1])
    rings, seen = np.argsort(ring_of(points), kind="stable"), (times < 0.03) | (times > 0.055)
    for rule, order in (("azimuth", np.arange(len(points))), ("rings", rings)):
        assert_times(points[order], rule, times[order])
        kept = order[half(len(order), round(10 * angle))]
        assert_times(points[kept], rule, times[kept], within=0.0005)
    assert_times(points[seen], "azimuth", times[seen])


@pytest.mark.parametrize(
    ("turns", "told"), [(0.97, True), (0.8, True), (0.6, False), (1.02, True), (1.08, True), (1.3, False), (2.0, False)]
)
def test_a_scan_of_less_or_more_than_a_turn(turns: float, told: bool) -> None:
    points, times = (np.concatenate(parts) for parts in zip(spun(), (spun()[0], spun()[1] + PERIOD), strict=True))
    points, times = points[times < turns * PERIOD], times[times < turns * PERIOD]
    if told:
        assert_times(points, "azimuth", times / max(turns, 1.0), within=0.0005)
    else:
        assert guessed_times(points, PERIOD) is None


OTHERS = {"rosette": rosette(22.6, 13.7), "rosette back": rosette(40.2, -33.3)}
OTHERS["Mid-360"] = looking(sensor_named("Mid-360").rays(0))


@pytest.mark.parametrize("sensor", OTHERS)
def test_a_sensor_that_does_not_turn_once_around(sensor: str) -> None:
    points = OTHERS[sensor]
    times, kept = np.arange(len(points)) * np.float64(PERIOD / len(points)), half(len(points), 1)
    assert_times(points, "index", times)
    assert_times(points[kept], "index", times[kept], within=0.002)


@pytest.mark.parametrize("sensor", ["spun", *OTHERS])
def test_another_order_tells_nothing(sensor: str) -> None:
    """Those that programs leave behind, few points, and rings that begin anywhere."""
    points = OTHERS.get(sensor, spun()[0])
    cells, (_, times) = np.floor(points / 0.25).astype(int), spun()
    orders = [*np.argsort(points, axis=0).T, np.lexsort(cells.T), np.argsort(np.linalg.norm(points, axis=1))]
    orders += [np.unique(cells, axis=0, return_index=True)[1], np.arange(0, len(points), len(points) // 150), []]
    orders += [np.random.default_rng(k).permutation(len(points)) for k in range(20)]
    if sensor == "spun":
        begin = np.random.default_rng(0).uniform(0, PERIOD, 100)[ring_of(points)]
        orders.append(np.lexsort(((times - begin) % PERIOD, ring_of(points))))
    assert [k for k, order in enumerate(orders) if guessed_times(points[order], PERIOD) is not None] == []


@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL} is not there")
def test_real_scans() -> None:
    for scan in ScanFolder(REAL):
        found, rings = guessed_times(scan.points, PERIOD), np.argsort(ring_of(scan.points), kind="stable")
        assert guessed_times(shuffled(scan.points), PERIOD) is None
        if scan.index == FILTERED:
            assert found is None
            continue
        assert found is not None and found.rule == "azimuth"
        newest = np.maximum.accumulate(found.seconds)
        assert newest[-1] > 0.95 * PERIOD and (newest - found.seconds).max() < 0.001
        by_rings = guessed_times(scan.points[rings], PERIOD)
        assert by_rings is not None and by_rings.rule == "rings"
        assert np.quantile(np.abs(by_rings.seconds - found.seconds[rings]), 0.99) < 0.003


@pytest.mark.skipif(not THINNED.is_file(), reason="needs the recording e1r_office")
def test_real_scans_whose_points_were_thinned_by_voxels_are_snapshots() -> None:
    packed = np.load(THINNED)
    scans = np.split(packed["points"] / 1000.0, np.cumsum(packed["counts"])[:-1])  # mm
    odometry = timed(scans[0], "auto")
    for number, points in enumerate(scans[1:60], 1):
        odometry.register(10**9 + number * 10**8, points)
    assert odometry.kind == "snapshot"


def timed(first: Array, kind: Kind | Literal["auto"] = "order", stamped: Stamped = "start") -> TimedOdometry:
    """An odometry that has seen one scan."""
    odometry = TimedOdometry(TrackingSettings(point_times=kind, stamp=stamped))
    odometry.register(10**9, first)
    return odometry


def test_of_a_sensor_that_does_not_turn_once_around_every_scan_is_in_the_order_of_time() -> None:
    """Where walls are close, the order alone does not show it."""
    clear, unclear = OTHERS["Mid-360"], shuffled(OTHERS["Mid-360"])
    middle, even = np.full(len(unclear), PERIOD / 2), np.arange(len(unclear)) * (PERIOD / len(unclear))
    for before, times in ((clear, even), (spun()[0], middle), (unclear, middle)):
        told = timed(before).register(11 * 10**8, unclear).point_times
        assert told is not None and np.allclose(told, times)


@pytest.mark.parametrize(("stamped", "begin"), [("start", 0.0), ("middle", -PERIOD / 2), ("end", -PERIOD)])
def test_guessed_times_are_seconds_after_the_instant_that_is_stamped(stamped: Stamped, begin: float) -> None:
    """Those of a snapshot are all the stamp's."""
    points, times = spun()
    odometry = timed(points, "order", stamped)
    told = odometry.register(11 * 10**8, points).point_times
    mixed = odometry.register(12 * 10**8, shuffled(points)).point_times
    assert told is not None and told == pytest.approx(begin + times, abs=1e-6)
    assert mixed is not None and np.all(mixed == begin + PERIOD / 2)
    assert timed(points, "snapshot", stamped).register(2 * 10**9, points).point_times is None
