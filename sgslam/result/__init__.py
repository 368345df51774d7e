"""The result of a run, assembled from its final map, and its output folder."""

from sgslam.result.result import Result

__all__ = ["Result"]
