"""Loop closure: candidates, search, registration, and the closures that hold."""

from sgslam.loops.closure import LoopCloser

__all__ = [
    "LoopCloser",
]
