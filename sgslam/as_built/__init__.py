"""As built against as planned: deviations, missing and extra walls."""

from sgslam.as_built.assessment import AnchoredMap, Assessment, Deviation, assess

__all__ = [
    "AnchoredMap",
    "Assessment",
    "Deviation",
    "assess",
]
