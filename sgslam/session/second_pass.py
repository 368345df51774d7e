"""The second pass of a run: once the map is known, all scans are registered again, and the graph is solved again."""

import logging

import numpy as np

from sgslam.config import TrackingSettings
from sgslam.registration.motion import pose_at
from sgslam.registration.smoothing import smoothed
from sgslam.session.active_map import ActiveMap
from sgslam.session.scan_poses import interpolated
from sgslam.types import Motion

_log = logging.getLogger(__name__)


def pass_again(final: ActiveMap, settings: TrackingSettings) -> bool:
    """Registers all scans of a map again, and estimates the map with the motion found; returns whether it did."""
    with final.stopwatch("smoothing"):
        stamps = np.array([scan.stamp_ns for scan in final.scans])
        if len(final.points) != len(stamps) or len(stamps) < 3:
            _log.warning("no second pass: the points of %d of %d scans are there", len(final.points), len(stamps))
            return False
        at = (stamps - stamps[0]) / 1e9
        again = [own.later(second) for own, second in zip(final.points.read(), at, strict=True)]
        start = Motion(at, interpolated(final.scans, final.backend.poses))
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
