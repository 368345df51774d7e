"""The settings of the signals of a map's quality."""

from pydantic import Field

from sgslam.config.base import Settings


class QualitySettings(Settings):
    """Limits of the signals that tell a sound map from one that was lost."""

    map_against_odometry: float = Field(0.01, gt=0)
    """maximum difference between the trajectories of map and odometry, as a share of the path length; 0.001 in sound
    maps, 0.02 in lost ones"""
    lost_scans: float = Field(0.05, ge=0, le=1)
    """maximum share of scans that are lost"""
    unplaced_scans: float = Field(0.05, ge=0, le=1)
    """maximum share of scans in submaps that were not placed, whose poses are in separate frames"""
    keyframes_without_walls: float = Field(0.3, ge=0, le=1)
    """maximum share of keyframes that see no wall; 0.02 in sound maps, 0.6 to 0.9 in lost ones"""
    walls_per_keyframe: float = Field(3.0, ge=0)
    """minimum mean number of walls that a keyframe sees; 5 to 13 in sound maps, 0.3 to 2 in lost ones"""
    anchored_position: float = Field(0.5, gt=0)
    """m, maximum position error of an anchored scan along each axis; enough to tell the room"""
    anchored_attitude: float = Field(5.0, gt=0)
    """degrees, maximum attitude error of an anchored scan about each axis"""
    anchored_probability: float = Field(0.99, gt=0, lt=1)
    """minimum probability that all errors of an anchored scan are within these limits, a conformance probability as
    JCGM 106:2012 defines it; of scans at the minimum, one in a hundred is off by more"""
    position_sigma: float = Field(0.2, gt=0)
    """m, maximum of the 95 % quantile of the positions' standard deviations"""
    place_probability: float = Field(0.9, gt=0, lt=1)
    """minimum probability that the map is sound and at its place in the plan"""
