"""The settings of the signals of a map's quality."""

from pydantic import Field

from sgslam.config.base import Settings


class QualitySettings(Settings):
    """Limits of the signals that tell a sound map from one that was lost."""

    map_against_odometry: float = Field(0.01, gt=0)
    """difference of the map's and the odometry's trajectories, share of the way; sound maps 0.001, lost ones 0.02"""
    lost_scans: float = Field(0.05, ge=0, le=1)
    """largest share of scans that are lost"""
    unplaced_scans: float = Field(0.05, ge=0, le=1)
    """largest share of scans in parts of the map that were not placed, whose poses are in frames of their own"""
    keyframes_without_walls: float = Field(0.3, ge=0, le=1)
    """largest share of keyframes that see no wall; sound maps 0.02, lost ones 0.6 to 0.9"""
    walls_per_keyframe: float = Field(3.0, ge=0)
    """least mean number of walls that a keyframe sees; sound maps 5 to 13, lost ones 0.3 to 2"""
    anchored_position: float = Field(0.5, gt=0)
    """m, error of a position along each axis that anchored scans keep with 95 %: enough to be in the right room"""
    anchored_attitude: float = Field(5.0, gt=0)
    """degrees, error of an attitude about each axis that anchored scans keep with 95 %"""
    position_sigma: float = Field(0.2, gt=0)
    """m, largest standard deviation that 95 % of the positions have at most"""
    plan_tilt: float = Field(1.0, gt=0)
    """degrees, largest angle between the plan's vertical and the map's; sound maps 0.2, lost ones 4"""
    planned_walls_crossed: int = Field(1, ge=0)
    """largest number of planned walls through which the way leads; sound maps 0, lost ones 5"""
