"""A verdict for each planned element, in the tolerance classes of the trade, and its files."""

from sgslam.as_built.elements.entries import ElementVerdict
from sgslam.as_built.elements.likelihoods import Finding, Verdict
from sgslam.as_built.elements.tolerance_classes import SURE_SIGMAS
from sgslam.as_built.elements.verdicts import element_findings

__all__ = [
    "SURE_SIGMAS",
    "ElementVerdict",
    "Finding",
    "Verdict",
    "element_findings",
]
