"""A run's maps and their memory: the active map, the prior map, checkpoints, and the result."""

from sgslam.session.active_map import ActiveMap
from sgslam.session.checkpoints import Checkpoints
from sgslam.session.prior_map import PriorMap
from sgslam.session.result import PoseCovariances, Result, Update
from sgslam.session.session import Session
from sgslam.session.snapshot import Snapshot
from sgslam.session.stopwatch import Stopwatch

__all__ = [
    "ActiveMap",
    "Checkpoints",
    "PoseCovariances",
    "PriorMap",
    "Result",
    "Session",
    "Snapshot",
    "Stopwatch",
    "Update",
]
