"""The second pass of a run: once the map is known, all scans are registered again, and the graph is solved again."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from data.scans import Scan
from sgslam.config import TrackingSettings
from sgslam.registration.motion import pose_at
from sgslam.registration.sampling import thinned
from sgslam.registration.smoothing import smoothed
from sgslam.session.active_map import ActiveMap
from sgslam.session.scan_poses import smooth
from sgslam.types import Motion, TimedPoints

Floats = NDArray[np.float64]
TimesOf: TypeAlias = Callable[[Floats, Floats | None], Floats | None]
_log = logging.getLogger(__name__)
_LEAST = 3  # scans that a smoothing needs
_MOST_POINTS = 2e7  # of all scans, 36 bytes each, stay in memory


def second_pass(final: ActiveMap, scans: Iterable[Scan], times_of: TimesOf, settings: TrackingSettings) -> bool:
    """Registers all scans of a map again, and estimates the map with the motion found; returns whether it did.

    `scans` are those of the run, in the same order; more of them do no harm. Where one of the map's scans is not among
    them, nothing happens but a warning. `times_of` is that of the run's tracker.
    """
    with final.stopwatch("smoothing"):
        stamps = np.array([scan.stamp_ns for scan in final.scans])
        points = min(settings.points, int(_MOST_POINTS / len(stamps)))
        again = _thinned(scans, stamps, times_of, settings.model_copy(update={"points": points}))
        if len(again) != len(stamps) or len(stamps) < _LEAST:
            _log.warning("no second pass: %d of %d scans can be read again", len(again), len(stamps))
            return False
        at = (stamps - stamps[0]) / 1e9
        start = Motion(at, smooth(final.scans, final.backend.poses))
        is_known = np.array([scan.health != "lost" for scan in final.scans])
        _log.info("second pass: all %d scans are registered again", len(stamps))
        motion = smoothed(again, start, is_known, settings)
        poses = np.stack([pose_at(motion, second) for second in at])
        of_points = poses.copy()
        for i, (scan, own) in enumerate(zip(final.scans, again, strict=True)):
            if scan.T_begin_sensor is not None:  # the pose at a later stamp was less certain than that of the points
                of_points[i] = pose_at(motion, own.knot_seconds[0]) @ scan.T_begin_sensor
        final.take_tracked(poses, of_points)
    final.complete()
    return True


def _thinned(
    scans: Iterable[Scan], stamps: NDArray[np.int64], times_of: TimesOf, settings: TrackingSettings
) -> list[TimedPoints]:
    """The points of the map's scans that are used, with times in seconds since the first scan."""
    wanted, side, found = set(stamps.tolist()), 0.0, list[TimedPoints]()
    for scan in scans:
        if scan.stamp_ns in wanted:
            times = times_of(scan.points, scan.point_times)
            own, side = thinned(scan.points, times, (scan.stamp_ns - stamps[0]) / 1e9, side, settings)
            found.append(replace(own, points=own.points.astype(np.float32)))
    return found
