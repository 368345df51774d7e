"""Inspection of a plan before any robot drives, as values and as a page."""

from sgslam.inspection.inspection import Inspection, inspect

__all__ = ["Inspection", "inspect"]
