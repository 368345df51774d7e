"""The back end: factor log, optimisation, covariances."""

from sgslam.backend.backend import Backend
from sgslam.backend.covariances import Uncertainty
from sgslam.backend.factor_log import FactorEvent, FactorLog, write_pose_graph

__all__ = [
    "Backend",
    "FactorEvent",
    "FactorLog",
    "Uncertainty",
    "write_pose_graph",
]
