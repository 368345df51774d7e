"""The settings of a run: their models, loading, checking and documentation."""

from sgslam.config.models import (
    AnchorSettings,
    BackendSettings,
    Config,
    KeyframeSettings,
    MatchingSettings,
    OdometrySettings,
    RoomSettings,
    SurfaceSettings,
    TrackingSettings,
)

__all__ = [
    "AnchorSettings",
    "BackendSettings",
    "Config",
    "KeyframeSettings",
    "MatchingSettings",
    "OdometrySettings",
    "RoomSettings",
    "SurfaceSettings",
    "TrackingSettings",
]
