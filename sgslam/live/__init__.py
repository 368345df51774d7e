"""Live use: each scan is answered at once, while the map is built in another process."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sgslam.cli.processes.mapping_process import HeldAnchor
    from sgslam.live.answer import Answer
    from sgslam.live.live_slam import LiveSlam

_MODULES = {
    "Answer": "sgslam.live.answer",
    "HeldAnchor": "sgslam.cli.processes.mapping_process",
    "LiveSlam": "sgslam.live.live_slam",
}
__all__ = ["Answer", "HeldAnchor", "LiveSlam"]


def __getattr__(name: str) -> Any:
    """Loaded on first use, so that the command's help responds at once."""
    if name not in _MODULES:
        raise AttributeError(f"module 'sgslam.live' has no attribute '{name}'")
    return getattr(importlib.import_module(_MODULES[name]), name)
