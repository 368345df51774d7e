"""Suspended ceilings that the plan does not have, in some rooms."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from data.simulation.storey_model import Space, StoreyModel

Array = NDArray[np.float64]
DROP = 0.3  # m below the ceiling
SHARE = 0.5  # of the rooms
FROM_WALLS = 0.02  # m
HEADROOM = 2.3  # m above the floor, at least


def suspended(models: Sequence[StoreyModel], seed: int) -> Array:
    """(M, 3, 3) the undersides of suspended ceilings in half of the rooms that are high enough."""
    rng, parts = np.random.default_rng([seed, 56]), [np.empty((0, 3, 3))]
    for model in dict.fromkeys(models):
        for space in model.spaces:
            is_chosen = rng.random() < SHARE
            if is_chosen and len(space.top):
                parts.append(_underside(space, model.level))
    return np.concatenate(parts)


def _underside(space: Space, level: float) -> Array:
    z = float(np.median(space.top[:, :, 2])) - DROP
    area = shapely.union_all([shapely.Polygon(corners).buffer(1e-3) for corners in space.top[:, :, :2]])
    area = area.buffer(-FROM_WALLS, join_style="mitre")
    if area.is_empty or z < level + HEADROOM:
        return np.empty((0, 3, 3))
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    return np.array([[(x, y, z) for x, y in list(t.exterior.coords)[:3]] for t in triangles])
