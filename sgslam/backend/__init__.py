"""The back end: held factors, optimisation, covariances."""

from sgslam.backend.backend import Backend
from sgslam.backend.covariances import Uncertainty
from sgslam.backend.held_factors import HeldFactors, write_pose_graph

__all__ = ["Backend", "HeldFactors", "Uncertainty", "write_pose_graph"]
