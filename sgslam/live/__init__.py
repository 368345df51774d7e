"""Live use: each scan is answered at once, while the map is built in another process."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sgslam.live.live_slam import Answer, HeldAnchor, LiveSlam

__all__ = ["Answer", "HeldAnchor", "LiveSlam"]


def __getattr__(name: str) -> Any:
    """Loaded on first use, so that the command's help responds at once."""
    if name not in __all__:
        raise AttributeError(f"module 'sgslam.live' has no attribute '{name}'")
    return getattr(importlib.import_module("sgslam.live.live_slam"), name)
