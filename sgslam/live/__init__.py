"""Live use: each scan is answered at once, while the map is built in another process."""

from sgslam.cli.processes.messages import HeldAnchor
from sgslam.live.answer import Answer
from sgslam.live.live_slam import LiveSlam

__all__ = ["Answer", "HeldAnchor", "LiveSlam"]
