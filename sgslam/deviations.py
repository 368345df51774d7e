"""As built against as planned: how far each matched wall lies from its place in the plan."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.config import Config

Floats = NDArray[np.float64]


def deviations(
    s_graph: SceneGraph, a_graph: SceneGraph, matches: dict[str, Any], T_bim_map: Floats | None, config: Config
) -> list[dict[str, Any]]:
    """For each matched wall surface its offset along the plan's inward normal (m) and its tilt (rad), in plan view.

    Empty where the run was not anchored. `sigma_m` is what the anchors assume of walls as built together with the
    observations' floor; an offset of more than three of them is significant.
    """
    if T_bim_map is None:
        return []
    sigma = float(np.hypot(config.anchors.sigma_offset, config.backend.sigma_offset))
    found = []
    for s_id, a_id, _ in matches["wall_surfaces"]:
        seen, planned = s_graph.surface_by_id[s_id], a_graph.surface_by_id[a_id]
        R, t = T_bim_map[:2, :2], T_bim_map[:2, 3]
        centre, normal = R @ seen.centroid + t, R @ seen.normal
        offset = float((centre - planned.centroid) @ planned.normal)
        n = planned.normal
        tilt = float(np.arctan2(n[0] * normal[1] - n[1] * normal[0], n[0] * normal[0] + n[1] * normal[1]))
        found.append(
            {
                "s_id": s_id, "a_id": a_id, "source": planned.source, "kind": "moved", "offset_m": offset,
                "tilt_rad": tilt, "sigma_m": sigma, "significant": abs(offset) > 3 * sigma,
            }
        )  # fmt: skip
    return found
