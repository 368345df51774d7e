"""Tracking: the pose of each scan in a level frame, gravity, floor transitions."""

from sgslam.tracking.floor_transition import FloorTransition
from sgslam.tracking.front_end import FrontEnd
from sgslam.tracking.run_tracker import CarriedElsewhere, RunTracker, TrackingStep
from sgslam.tracking.scan_tracker import ScanTracker, TrackedScan

__all__ = [
    "CarriedElsewhere",
    "FloorTransition",
    "FrontEnd",
    "RunTracker",
    "ScanTracker",
    "TrackedScan",
    "TrackingStep",
]
