"""Compiles what a run needs before its first scan, once per installed version."""

import sys
from functools import partial
from threading import Timer
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.compiling import once_on_two_cores
from matching.matcher import make_ready
from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.registration.sampling import thinned
from sgslam.registration.smoothing import smoothed
from sgslam.types import Motion

_ROOM = np.array([3.0, 4.0, 1.5])  # m, from the sensor in its middle to the walls and the ceiling
_PERIOD = 100_000_000  # ns between scans
_SILENT = 5.0  # s without output, after which a message explains the delay


def compile_ahead(matcher: Any, method: str | None) -> None:
    """Makes a matcher, which was loaded by the name `method`, and the odometry ready; only the odometry for None."""
    message = "compiling, once per installed version: this takes half a minute or more"
    notice = Timer(_SILENT, print, [message], {"file": sys.stderr})
    notice.start()
    try:
        if method is None:
            _register()
            return
        once_on_two_cores("run", partial(make_ready, matcher, method), _register)
        make_ready(matcher, method)
    finally:
        notice.cancel()


def _register() -> None:
    """Registers three scans of a room, twice, so that the loops are loaded or compiled before a robot needs them."""
    settings, points = TrackingSettings(), _points()
    odometry = ContinuousTimeOdometry(settings)
    for number in range(3):
        odometry.register(number * _PERIOD, points)
    scans = [thinned(points, None, number * _PERIOD / 1e9, 0.0, settings)[0] for number in range(3)]
    stood = Motion(np.arange(3) * _PERIOD / 1e9, np.tile(np.eye(4), (3, 1, 1)))
    smoothed(scans, stood, np.ones(3, bool), settings)


def _points() -> NDArray[np.float64]:
    """(N, 3) where the rays of a spinning sensor with 16 beams meet the room."""
    turn, up = np.meshgrid(np.radians(np.arange(0, 360, 0.8)), np.radians(np.arange(-15, 16, 2)), indexing="ij")
    rays = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=-1).reshape(-1, 3)
    return rays * (_ROOM / np.maximum(np.abs(rays), 1e-9)).min(axis=1, keepdims=True)
