"""The files of a comparison of cloud and model."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from data.common.files import write_json
from data.scans.writers import write_ply
from sgslam.as_built.elements.files import PICTURES, picture_of
from sgslam.cloud_to_model.distances import CloudToModel
from sgslam.cloud_to_model.pictures import colours, write_heat_map, write_histogram
from sgslam.cloud_to_model.summary import shown, summary

if TYPE_CHECKING:
    from data.plans.elements import PlannedElement  # loads ifcopenshell

CLOUD, TABLE, HISTOGRAM = "cloud_to_model.ply", "cloud_to_model.json", "cloud_to_model.png"
_LIMIT = 3.0  # tolerances up to which colours tell distances apart


def write_cloud_to_model(
    out: Path, found: CloudToModel, elements: Sequence["PlannedElement"], tolerance: float
) -> list[Path]:
    """Writes the coloured cloud, the table, the histogram, and a heat map of each element with enough points, named by
    its GlobalId; returns their paths."""
    limit = _LIMIT * tolerance
    table = summary(found, elements, tolerance)
    folder = out / PICTURES
    shutil.rmtree(folder, ignore_errors=True)  # those of another time
    folder.mkdir()
    for entry, (number, _) in zip(table["elements"], shown(found), strict=True):
        entry["heat_map"] = picture_of(elements[number].global_id)
        write_heat_map(found, number, elements[number], limit, out / entry["heat_map"])
    write_histogram(found, tolerance, out / HISTOGRAM)
    comment = f"bim frame, metres; distance in metres, positive before the planned face, NaN beyond {found.reach:g} m"
    write_ply(out / CLOUD, found.points, comment, colours(found.distance, limit), {"distance": found.distance})
    write_json(out / TABLE, table)
    return [out / CLOUD, out / TABLE, out / HISTOGRAM, folder]
