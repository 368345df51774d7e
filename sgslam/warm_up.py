"""A short drive through a room, so that every inner loop is compiled and loaded before the first scan comes."""

import logging
from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import Compilation
from matching import Matcher
from matching.matcher import make_ready
from sgslam.config import Config
from sgslam.slam import SceneGraphSlam
from sgslam.tracking import RunTracker

Floats = NDArray[np.float64]
_ROOM, _OTHER = np.array([3.0, 4.0, 1.5]), np.array([5.0, 2.0, 1.5])  # m, from the middle to the walls and the ceiling
_SCANS, _LOST = 50, 12  # in the room, and in the other one, in which the sensor is lost


@cache
def compile_ahead() -> Compilation:
    """Begins to compile what a run needs; `wait` for it before the first scan."""
    return Compilation(_track, _match)


def _track() -> None:
    warm_up(Config(), with_map=True)


def _match() -> None:
    make_ready(Matcher.load())


def warm_up(config: Config, with_map: bool) -> None:
    """Tracks the drive as a run with these settings, and builds its map if `with_map`."""
    log = logging.getLogger("sgslam")
    level = log.level
    log.setLevel(logging.CRITICAL)  # what is said of this room is of no interest
    try:
        if with_map:
            slam = SceneGraphSlam(config=config)
            for scan in _drive():
                slam.add_scan(*scan)
            slam.finish()
        else:
            tracker = RunTracker(config)
            for scan in _drive():
                tracker.track(*scan)
    finally:
        log.setLevel(level)


def _drive() -> Iterator[tuple[int, Floats, Floats]]:
    """The stamp, points (N, 3) and times (N,) of each scan: ten a second, at 0.5 m/s, there and there again."""
    for number in range(_SCANS + _LOST):
        place = np.array([0.05 * (number % (_SCANS // 2)) - 1.0, 0.3, 0.0])
        points = _seen(place, _ROOM if number < _SCANS else _OTHER)
        yield number * 100_000_000, points, np.linspace(0.0, 0.09, len(points))


def _seen(place: Floats, room: Floats) -> Floats:
    """(N, 3) where the rays of a spinning sensor with 16 beams meet the room, from a place in it."""
    turn, up = np.meshgrid(np.radians(np.arange(0, 360, 0.8)), np.radians(np.arange(-60, 61, 8)), indexing="ij")
    rays = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=-1).reshape(-1, 3)
    rays[np.abs(rays) < 1e-9] = 1e-9
    ahead = (np.sign(rays) * room - place) / rays
    return np.asarray(rays * ahead.min(axis=1, keepdims=True))
