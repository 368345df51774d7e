"""Every setting of a run: its model, loading and checking, and its documentation."""

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
