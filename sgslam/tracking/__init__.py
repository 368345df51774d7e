"""Tracking: the pose of each scan by prediction and alignment, floor transitions, kidnap detection."""

from sgslam.tracking.kidnap import KidnapDetector
from sgslam.tracking.scan_tracker import Located, PreparedScan, ScanTracker

__all__ = [
    "KidnapDetector",
    "Located",
    "PreparedScan",
    "ScanTracker",
]
