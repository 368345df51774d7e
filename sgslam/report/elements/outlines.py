"""The outlines of planned elements in plan view."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import Floor
from sgslam.report.elements.labels import element_name, is_spread_out, kind

Array = NDArray[np.float64]
_LEAST_CORNERS = 3  # of an outline with an area


@dataclass(frozen=True)
class DrawnElement:
    """`outline` (K, 2) in the BIM frame, not closed. `flat`: it lies under or over everything else, as slabs do."""

    global_id: str
    outline: Array
    verdict: str
    title: str
    flat: bool


def drawn_elements(entries: Sequence[Mapping[str, Any]], floor: Floor | None) -> tuple[DrawnElement, ...]:
    """The elements of a storey, all where it is None; `entries` are those of elements.json."""
    return tuple(
        DrawnElement(
            entry["global_id"], np.array(entry["outline"], dtype=float), entry["verdict"], _title(entry),
            is_spread_out(entry["ifc_class"]),
        )
        for entry in entries
        if len(entry["outline"]) >= _LEAST_CORNERS
        and (floor is None or entry["storey"] in (floor.id, floor.name))
    )  # fmt: skip


def _title(entry: Mapping[str, Any]) -> str:
    return f"{element_name(entry)} ({kind(entry['ifc_class'])}): {entry['verdict']}\n{entry['reason']}"
