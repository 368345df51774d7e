"""The walls of a plan that an S-graph observed, without the map's noise."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, WallSurface
from data.geometry import se2
from data.geometry.se2 import Array
from data.synthetic_maps.noise_models import DrawnGraph
from data.synthetic_maps.wall_noise import SIGMA_END

CLIPPED = 3 * SIGMA_END  # m: a surface that ends further inside its wall than this does not show the wall's end


@dataclass(frozen=True)
class VisibleWalls:
    """A surfaces or parts of them.

    `goes_on` (N, 2) says whether the wall continues beyond its right and its left end, looking along the normal.
    """

    surfaces: tuple[WallSurface, ...]
    goes_on: NDArray[np.bool_]


def visible_walls(drawn: DrawnGraph, a: SceneGraph) -> VisibleWalls:
    """Returns every A surface that is in the map, clipped where the map's surfaces end well before the wall does.

    Raises KeyError if the true matches refer to something that is not in the A-graph.
    """
    seen: dict[str, list[Array]] = {}
    for s_id, a_id in drawn.wall_surfaces.items():
        seen.setdefault(a_id, []).append(_along(drawn, s_id, a.surface_by_id[a_id]))
    surfaces, goes_on = [], []
    for a_id, spans in seen.items():
        wall = a.surface_by_id[a_id]
        half = (wall.length or 0.0) / 2
        low, high = float(np.min(spans)), float(np.max(spans))
        clipped = wall.length is not None and low > CLIPPED - half, wall.length is not None and high < half - CLIPPED
        low, high = low if clipped[0] else -half, high if clipped[1] else half
        if high - low < 1e-3 and wall.length is not None:
            continue  # the map's surface lies beside its wall
        (x, y), (nx, ny), middle = wall.centroid, wall.normal, (low + high) / 2
        place = (x - ny * middle, y + nx * middle)
        surfaces.append(wall if not any(clipped) else replace(wall, centroid=place, length=high - low))
        goes_on.append(clipped)
    return VisibleWalls(tuple(surfaces), np.array(goes_on, dtype=bool).reshape(-1, 2))


def _along(drawn: DrawnGraph, s_id: str, wall: WallSurface) -> Array:
    """(2,) where an S surface ends on its wall, in metres to the left of its middle; the whole wall if it has no
    length.
    """
    surface = drawn.s_graph.surface_by_id[s_id]
    if surface.length is None:
        half = (wall.length or 0.0) / 2
        return np.array([-half, half])
    motion = drawn.T_a_s if surface.room is None else drawn.T_a_s_by_room.get(surface.room, drawn.T_a_s)
    ends = se2.apply(np.array(motion), np.array(surface.ends())) - wall.centroid
    return np.sort(ends @ [-wall.normal[1], wall.normal[0]])
