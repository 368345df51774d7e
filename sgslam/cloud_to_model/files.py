"""The files of a comparison of cloud and model."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data.common.files import write_json
from data.scans.writers import write_ply
from sgslam.as_built.elements.files import PICTURES, picture_of
from sgslam.cloud_to_model.distances import CloudToModel
from sgslam.cloud_to_model.pictures import colours, write_heat_map, write_histogram

if TYPE_CHECKING:
    from data.plans.elements import PlannedElement  # loads ifcopenshell

Floats = NDArray[np.float64]
CLOUD, TABLE, HISTOGRAM = "cloud_to_model.ply", "cloud_to_model.json", "cloud_to_model.png"
_LIMIT = 3.0  # tolerances up to which colours tell distances apart
_PERCENTILES = (1, 5, 25, 50, 75, 95, 99)
_LEAST_POINTS = 50  # of an element that is listed


def write_cloud_to_model(
    out: Path, found: CloudToModel, elements: Sequence["PlannedElement"], tolerance: float
) -> list[Path]:
    """Writes the coloured cloud, the table, the histogram, and a heat map of each element with enough points, named by
    its GlobalId; returns their paths."""
    limit, listed = _LIMIT * tolerance, list[dict[str, Any]]()
    folder = out / PICTURES
    shutil.rmtree(folder, ignore_errors=True)  # those of another time
    folder.mkdir()
    numbers, counts = np.unique(found.element[found.compared], return_counts=True)
    for k, points in zip(numbers.tolist(), counts.tolist(), strict=True):
        if points >= _LEAST_POINTS:
            known = {name: getattr(elements[k], name) for name in ("global_id", "name", "ifc_class", "storey")}
            picture = picture_of(elements[k].global_id)
            measured = _statistics(found.distance[found.element == k], tolerance)
            listed.append({**known, "points": points, **measured, "heat_map": picture})
            write_heat_map(found, k, elements[k], limit, out / picture)
    write_histogram(found, tolerance, out / HISTOGRAM)
    comment = f"bim frame, metres; distance in metres, positive before the planned face, NaN beyond {found.reach:g} m"
    write_ply(out / CLOUD, found.points, comment, colours(found.distance, limit), {"distance": found.distance})
    compared, edges = found.distance[found.compared], found.edges
    histogram = {"edges_m": np.round(edges, 6).tolist(), "points": np.histogram(compared, edges)[0].tolist()}
    table = {"points": len(found.points), "compared": len(compared), "reach_m": found.reach, "tolerance_m": tolerance}
    write_json(out / TABLE, {**table, **_statistics(compared, tolerance), "histogram": histogram, "elements": listed})
    return [out / CLOUD, out / TABLE, out / HISTOGRAM, folder]


def _statistics(distance: Floats, tolerance: float) -> dict[str, Any]:
    """Metres, to a tenth of a millimetre; None for each number of no points."""
    if not len(distance):
        return dict.fromkeys(("mean_m", "sigma_m", "rms_m", "within_tolerance", "percentiles_m"))
    percentiles = np.percentile(distance, _PERCENTILES).round(4)
    return {
        "mean_m": round(float(distance.mean()), 4),
        "sigma_m": round(float(distance.std()), 4),
        "rms_m": round(float(np.sqrt(np.mean(distance**2))), 4),
        "within_tolerance": round(float((np.abs(distance) <= tolerance).mean()), 4),
        "percentiles_m": dict(zip(map(str, _PERCENTILES), percentiles.tolist(), strict=True)),
    }
