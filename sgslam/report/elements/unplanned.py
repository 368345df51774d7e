"""Walls that no plan shows, among the planned elements of the report."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sgslam.as_built.deviation_bands import UNPLANNED

_DRAWN = 0.1  # m, the thickness of an unplanned wall in the plan


def shown_as_element(wall: Mapping[str, Any]) -> dict[str, Any]:
    """An entry of `unplanned` in elements.json, in the form of an entry of `elements`."""
    low, high = wall["height_m"]
    behind = -_DRAWN * np.array(wall["facing"])
    first, last = np.array(wall["trace"])
    nothing = dict.fromkeys((
        "offset_m", "direction", "sigma_m", "loa", "turn_rad", "turn_sigma_rad", "din_18202_limit_m", "din_18202",
        "seen", "views",
    ))  # fmt: skip
    return {
        **nothing, "global_id": wall["id"], "name": f"{wall['length_m']:.1f} m, not planned", "ifc_class": "IfcWall",
        "storey": wall["storey"], "rooms": [wall["room"]] if wall["room"] else [], "verdict": UNPLANNED,
        "conclusive": True, "reason": f"{wall['length_m']:.1f} m long, z {low:.2f} to {high:.2f} m; {wall['reason']}",
        "outline": [place.tolist() for place in (first, last, last + behind, first + behind)], "grid": "",
    }  # fmt: skip
