"""Tracking: the pose of each scan in a level frame."""

from sgslam.tracking.run_tracker import RunTracker, TrackerNotes

__all__ = [
    "RunTracker",
    "TrackerNotes",
]
