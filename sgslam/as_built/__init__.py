"""As built against as planned: deviations, missing and extra walls."""

from sgslam.as_built.deviation_entries import Deviation
from sgslam.as_built.deviations import Piece, measured_pieces
from sgslam.as_built.findings import write_topics

__all__ = [
    "Deviation",
    "Piece",
    "measured_pieces",
    "write_topics",
]
