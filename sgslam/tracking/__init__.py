"""Tracking: the pose of each scan in a level frame."""

from sgslam.tracking.run_tracker import CarriedElsewhere, RunTracker, TrackerNotes, TrackingStep
from sgslam.tracking.scan_tracker import ScanTracker

__all__ = [
    "CarriedElsewhere",
    "RunTracker",
    "ScanTracker",
    "TrackerNotes",
    "TrackingStep",
]
