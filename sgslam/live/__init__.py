"""Live use: each scan is answered at once, while the map is built in another process."""

from sgslam.live.answer import Answer, HeldAnchor
from sgslam.live.live_slam import LiveSlam
from sgslam.live.messages import LiveInputs

__all__ = ["Answer", "HeldAnchor", "LiveInputs", "LiveSlam"]
