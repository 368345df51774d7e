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
from sgslam.config.registration_settings import RegistrationSettings

__all__ = [
    "AnchorSettings",
    "BackendSettings",
    "Config",
    "KeyframeSettings",
    "MatchingSettings",
    "OdometrySettings",
    "RegistrationSettings",
    "RoomSettings",
    "SurfaceSettings",
    "TrackingSettings",
]
