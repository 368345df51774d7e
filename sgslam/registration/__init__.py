"""Continuous-time registration: scans of a moving sensor to a local map of oriented surfels."""

from sgslam.registration.types import Health, Motion, Registration

__all__ = ["Health", "Motion", "Registration"]
