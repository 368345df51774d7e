"""What the distances of a cloud from the model say, of the whole and of each element."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sgslam.cloud_to_model.distances import CloudToModel

if TYPE_CHECKING:
    from data.plans.elements import PlannedElement  # loads ifcopenshell

Floats = NDArray[np.float64]
PERCENTILES = (1, 5, 25, 50, 75, 95, 99)
BIN_M = 0.005
LEAST_POINTS = 50  # of an element that is listed


def summary(found: CloudToModel, elements: Sequence["PlannedElement"], tolerance: float) -> dict[str, Any]:
    """The content of cloud_to_model.json: metres, signed; `within_tolerance` are shares of the compared points."""
    compared = found.distance[found.compared]
    edges = np.arange(-found.reach, found.reach + BIN_M / 2, BIN_M)
    return {
        "points": len(found.points), "compared": len(compared), "reach_m": found.reach, "tolerance_m": tolerance,
        **_statistics(compared, tolerance),
        "histogram": {
            "edges_m": np.round(edges, 6).tolist(), "points": np.histogram(compared, edges)[0].tolist(),
        },
        "elements": [
            {
                "global_id": elements[k].global_id, "name": elements[k].name, "ifc_class": elements[k].ifc_class,
                "storey": elements[k].storey, "points": int(count),
                **_statistics(found.distance[found.element == k], tolerance),
            }
            for k, count in shown(found)
        ],
    }  # fmt: skip


def shown(found: CloudToModel) -> list[tuple[int, int]]:
    """The elements with enough points, and how many these are."""
    elements, counts = np.unique(found.element[found.compared], return_counts=True)
    return [(k, n) for k, n in zip(elements.tolist(), counts.tolist(), strict=True) if n >= LEAST_POINTS]


def _statistics(distance: Floats, tolerance: float) -> dict[str, Any]:
    """None for each number of no points."""
    if not len(distance):
        return {"mean_m": None, "sigma_m": None, "rms_m": None, "within_tolerance": None, "percentiles_m": None}
    percentiles = np.percentile(distance, PERCENTILES)
    return {
        "mean_m": _rounded(distance.mean()), "sigma_m": _rounded(distance.std()),
        "rms_m": _rounded(np.sqrt(np.mean(distance**2))),
        "within_tolerance": round(float((np.abs(distance) <= tolerance).mean()), 4),
        "percentiles_m": {str(p): _rounded(value) for p, value in zip(PERCENTILES, percentiles, strict=True)},
    }  # fmt: skip


def _rounded(metres: float) -> float:
    """To a tenth of a millimetre."""
    return round(float(metres), 4)
