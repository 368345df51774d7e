"""Every point of the map against the planned surface that it was measured on. Needs the extra `open3d`."""

from sgslam.cloud_to_model.distances import CloudToModel, distances_to_model
from sgslam.cloud_to_model.library import load_open3d

__all__ = ["CloudToModel", "distances_to_model", "load_open3d"]
