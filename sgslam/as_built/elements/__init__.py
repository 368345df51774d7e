"""A verdict for each planned element, in the tolerance classes of the trade, and its files."""

from sgslam.as_built.elements.entries import ElementVerdict, Verdict
from sgslam.as_built.elements.tolerance_classes import SURE_SIGMAS
from sgslam.as_built.elements.unplanned import UNPLANNED, UnplannedEntry, unplanned_walls
from sgslam.as_built.elements.verdicts import element_verdicts

__all__ = [
    "SURE_SIGMAS",
    "UNPLANNED",
    "ElementVerdict",
    "UnplannedEntry",
    "Verdict",
    "element_verdicts",
    "unplanned_walls",
]
