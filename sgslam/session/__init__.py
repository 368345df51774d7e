"""A run's maps and their memory: the active map, the prior map, and checkpoints."""

from sgslam.session.active_map import ActiveMap
from sgslam.session.prior_map import PriorMap
from sgslam.session.session import Session
from sgslam.session.snapshot import Snapshot
from sgslam.session.stopwatch import Stopwatch

__all__ = [
    "ActiveMap",
    "PriorMap",
    "Session",
    "Snapshot",
    "Stopwatch",
]
