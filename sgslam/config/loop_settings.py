"""The settings of loop closure."""

from pydantic import Field

from sgslam.config.base import Settings


class LoopSettings(Settings):
    """When loop closures are searched for."""

    enabled: bool = True
    """close loops where the map is not anchored or the odometry may have slipped"""
    gap: float = Field(15.0, gt=0)
    """m, minimum path length between two passes of a place"""
    drift: float = Field(0.03, gt=0)
    """maximum drift between two passes, in metres per metre of path between them"""
    most_drift: float = Field(4.0, gt=0)
    """m, upper limit of the drift within which a place is searched for"""
