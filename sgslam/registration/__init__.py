"""Continuous-time registration: scans of a moving sensor to a local map of oriented surfels."""
