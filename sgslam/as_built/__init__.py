"""As built against as planned: deviations, missing and extra walls."""

from sgslam.as_built.assessment import AnchoredMap, Assessment, assess
from sgslam.as_built.deviation_entries import Deviation

__all__ = [
    "AnchoredMap",
    "Assessment",
    "Deviation",
    "assess",
]
