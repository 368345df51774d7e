"""Perception: checks of a scan, times of its points, columns, and extraction of walls and floor."""

from sgslam.perception.column_scan import ColumnScan, sort_into_columns
from sgslam.perception.floor_extraction import FloorObservation, extract_floor
from sgslam.perception.scan_checks import RawScan, checked_scan
from sgslam.perception.wall_extraction import WallObservation, extract_walls

__all__ = [
    "ColumnScan",
    "FloorObservation",
    "RawScan",
    "WallObservation",
    "checked_scan",
    "extract_floor",
    "extract_walls",
    "sort_into_columns",
]
