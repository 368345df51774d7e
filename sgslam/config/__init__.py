"""The settings of a run: their models, loading, checking and documentation."""

from sgslam.config.imu_settings import ImuSettings
from sgslam.config.models import (
    AnchorSettings,
    AsBuiltSettings,
    BackendSettings,
    Config,
    KeyframeSettings,
    LevelSettings,
    MatchingSettings,
    OdometrySettings,
    RoomSettings,
    SurfaceSettings,
)
from sgslam.config.quality_settings import QualitySettings
from sgslam.config.tracking_settings import FloorSettings, TrackingSettings

__all__ = [
    "AnchorSettings",
    "AsBuiltSettings",
    "BackendSettings",
    "Config",
    "FloorSettings",
    "ImuSettings",
    "KeyframeSettings",
    "LevelSettings",
    "MatchingSettings",
    "OdometrySettings",
    "QualitySettings",
    "RoomSettings",
    "SurfaceSettings",
    "TrackingSettings",
]
