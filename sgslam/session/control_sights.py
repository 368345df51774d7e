"""Where a run's sensor has the control points, and how far the finished map has them off."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data.control import ControlPoint
from sgslam.config.sensor import SENSOR
from sgslam.geometry.frames import transform_points
from sgslam.mapping.keyframes import ControlSight
from sgslam.registration.motion import pose_at
from sgslam.session.scan_poses import ScanPose
from sgslam.types import ControlResidual

Floats = NDArray[np.float64]


def control_sights(points: Sequence[ControlPoint], scans: list[ScanPose], sigma: float) -> list[ControlSight]:
    """The points with a scan near their times that is not lost; `sigma` (m) is that of a pose since its keyframe."""
    known = sorted((scan for scan in scans if scan.health != "lost"), key=lambda scan: scan.stamp_ns)
    stamps, sights = np.array([scan.stamp_ns for scan in known], dtype=np.int64), list[ControlSight]()
    for point in points if known else ():
        scan = known[int(np.argmin(np.abs(stamps - point.stamp_ns)))]
        later = (point.stamp_ns - scan.stamp_ns) / 1e9
        if abs(later) < SENSOR.longest_scan:
            T_keyframe_sensor = scan.T_keyframe_sensor @ pose_at(scan.motion, later)
            there = transform_points(T_keyframe_sensor, np.array(point.in_sensor))
            place, both = np.array(point.place), float(np.hypot(point.sigma, sigma))
            sights.append(ControlSight(point.name, scan.keyframe, there, place, both))
    return sights


def control_residuals(sights: list[ControlSight], poses: Floats) -> tuple[ControlResidual, ...]:
    """How far the keyframes' `poses` (K, 4, 4) in the BIM frame have each point off."""
    found = []
    for own in sights:
        x, y, z = (transform_points(poses[own.keyframe], own.in_sensor) - own.place).tolist()
        sigmas = max(abs(x), abs(y), abs(z)) / own.sigma
        found.append(ControlResidual(own.name, (x, y, z), own.sigma, sigmas, sigmas > 3.0))
    return tuple(found)
