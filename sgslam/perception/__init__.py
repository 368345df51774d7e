"""Perception: checks of a scan, times of its points, columns, and extraction of walls and level surfaces."""

from sgslam.perception.column_scan import ColumnScan, sort_into_columns
from sgslam.perception.keyframe_scan import keyframe_scan
from sgslam.perception.level_extraction import LevelObservation, extract_levels
from sgslam.perception.scan_checks import checked_scan
from sgslam.perception.wall_extraction import WallObservation, extract_walls

__all__ = [
    "ColumnScan",
    "LevelObservation",
    "WallObservation",
    "checked_scan",
    "extract_levels",
    "extract_walls",
    "keyframe_scan",
    "sort_into_columns",
]
