"""The settings of loop closure."""

from pydantic import Field

from sgslam.config.base import Settings


class LoopSettings(Settings):
    """When loop closures are searched for, and what a closure must satisfy."""

    enabled: bool = True
    """close loops where the map is not anchored or the odometry may have slipped"""
    gap: float = Field(15.0, gt=0)
    """m, minimum path length between two passes of a place"""
    drift_base: float = Field(0.3, ge=0)
    """m, constant part of the maximum drift between two passes"""
    drift: float = Field(0.03, gt=0)
    """maximum drift between two passes, in metres per metre of path between them"""
    most_drift: float = Field(4.0, gt=0)
    """m, upper limit of the drift within which a place is searched for"""
    turn_base: float = Field(0.03, ge=0)
    """rad, constant part of the maximum heading drift between two passes"""
    turn: float = Field(0.002, gt=0)
    """maximum heading drift between two passes, in radians per metre of path between them"""
    most_turn: float = Field(0.3, gt=0)
    """rad, upper limit of the heading drift within which a place is searched for"""
    submap: float = Field(8.0, gt=0)
    """m, path length on either side of a keyframe whose scans form its submap"""
    spacing: float = Field(2.0, gt=0)
    """m, minimum path length between two places that are searched for"""
    searches: int = Field(2, ge=1)
    """maximum number of loop searches per optimisation"""
    overlap: float = Field(0.5, gt=0, le=1)
    """minimum share of one pass's points in space that the other pass has seen"""
    agreement: float = Field(0.8, gt=0, le=1)
    """minimum share of overlapping points that agree, minus the share that contradicts"""
    distinct: float = Field(0.12, gt=0)
    """minimum margin in agreement over the second-best place"""
    inlier_distance: float = Field(0.08, gt=0)
    """m, maximum distance between points on the same surface, along its normal"""
    inliers: float = Field(0.7, gt=0, le=1)
    """minimum share of inliers among the overlapping points"""
    inlier_error: float = Field(0.035, gt=0)
    """m, maximum RMSE of the inliers' distances along the normal"""
    moved: float = Field(0.35, gt=0)
    """m, maximum translation between the registered pose and the pose found by the search"""
    turned: float = Field(0.06, gt=0)
    """rad, maximum rotation between the registered pose and the pose found by the search"""
    held: float = Field(0.02, gt=0, le=1)
    """minimum share of points that constrain the least constrained direction"""
    alone: float = Field(0.3, ge=0)
    """m, maximum correction that a single closure may make; a larger one needs several that agree"""
    alone_turn: float = Field(0.03, ge=0)
    """rad, maximum rotation that a single closure may make; a larger one needs several that agree"""
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
    """m, residual after the optimisation above which a closure is withdrawn"""
