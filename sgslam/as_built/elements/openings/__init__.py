"""Verdicts on openings: doors and windows, by where rays cross the wall around them."""

from sgslam.as_built.elements.openings.finding import opening_finding

__all__ = ["opening_finding"]
