"""The settings of loop closure."""

from pydantic import Field

from sgslam.config.base import Settings


class LoopSettings(Settings):
    """When loop closures are searched for, and what a closure must satisfy."""

    enabled: bool = True
    """close loops where the map is not anchored or the odometry may have slipped"""
    gap: float = Field(15.0, gt=0)
    """m, least path length between two passes of a place"""
    drift_base: float = Field(0.3, ge=0)
    """m, constant part of the largest drift between two passes"""
    drift: float = Field(0.03, gt=0)
    """m, largest drift between two passes for each metre of path between them"""
    most_drift: float = Field(4.0, gt=0)
    """m, largest drift for which a place is searched"""
    turn_base: float = Field(0.03, ge=0)
    """rad, constant part of the largest heading drift between two passes"""
    turn: float = Field(0.002, gt=0)
    """rad, largest heading drift between two passes for each metre of path between them"""
    most_turn: float = Field(0.3, gt=0)
    """rad, largest heading drift for which a place is searched"""
    submap: float = Field(8.0, gt=0)
    """m, path length on either side of a keyframe whose scans form its submap"""
    spacing: float = Field(2.0, gt=0)
    """m, least path length between two places that are searched for"""
    searches: int = Field(2, ge=1)
    """largest number of searches at each optimisation"""
    overlap: float = Field(0.5, gt=0, le=1)
    """least share of one pass's points in space that the other pass has seen"""
    agreement: float = Field(0.8, gt=0, le=1)
    """least share of the overlapping points that agree, less those that contradict"""
    distinct: float = Field(0.12, gt=0)
    """least margin in agreement over the next best place"""
    inlier_distance: float = Field(0.08, gt=0)
    """m, largest distance across between points on the same surface"""
    inliers: float = Field(0.7, gt=0, le=1)
    """least share of inliers among the overlapping points"""
    inlier_error: float = Field(0.035, gt=0)
    """m, largest RMSE of the inliers' distances across"""
    moved: float = Field(0.35, gt=0)
    """m, largest translation of the registration from the pose that was found"""
    turned: float = Field(0.06, gt=0)
    """rad, largest rotation of the registration from the pose that was found"""
    held: float = Field(0.02, gt=0, le=1)
    """least share of points that constrain the worst constrained direction"""
    alone: float = Field(0.3, ge=0)
    """m, largest correction that a single closure may make; a larger one needs several that agree"""
    alone_turn: float = Field(0.03, ge=0)
    """rad, largest rotation that a single closure may make; a larger one needs several that agree"""
    together: int = Field(3, ge=2)
    """number of closures that must agree on a larger correction"""
    apart: float = Field(4.0, gt=0)
    """m, path length over which the closures that agree must be spread"""
    rejoin: float = Field(0.1, gt=0)
    """m, correction above which the walls of both passes are associated again"""
    sigma_translation: float = Field(0.02, gt=0)
    """m, lower bound of the standard deviation of a closure's translation"""
    sigma_rotation: float = Field(0.004, gt=0)
    """rad, lower bound of the standard deviation of a closure's rotation"""
    huber: float = Field(3.0, gt=0)
    """whitened residual beyond which a closure's weight is reduced (Huber loss)"""
    contradicted: float = Field(0.25, gt=0)
    """m, residual of a closure after the optimisation above which it is withdrawn"""
