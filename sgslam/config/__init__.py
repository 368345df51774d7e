"""The settings of a run: their models, loading, checking and documentation."""

from sgslam.config.models import (
    AnchorSettings,
    AsBuiltSettings,
    BackendSettings,
    Config,
    ImuSettings,
    KeyframeSettings,
    LevelSettings,
    MatchingSettings,
    OdometrySettings,
    QualitySettings,
    RoomSettings,
    SurfaceSettings,
)
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
