"""Continuous-time registration: scans of a moving sensor to a local map of oriented surfels."""

from sgslam.registration.surfel_map import SurfelMap
from sgslam.registration.types import Health, Motion, Registration

__all__ = ["Health", "Motion", "Registration", "SurfelMap"]
