"""Free-space conflict of two maps of one place: walls of one map that stand in the free space of the other.

The map of an earlier run lacks rooms. In a building of equal wings or offices, a missing room looks like a mapped one,
so a wrong place may explain most walls. But two maps of the same place agree wherever both have looked, whereas a
similar part has some wall elsewhere, in what the other map saw as free space.
"""

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from data import SceneGraph
from data.geometry.areas import Area, polygons_of, united
from data.scene_graph.graph import moved
from data.scene_graph.segments import Segments

Floats = NDArray[np.float64]
_STEP = 0.2  # m between the sampled places of a wall, and to a wall of the other map that counts as the same
_INSIDE = 0.3  # m inside the outline of a room's free space, from which on a wall is in conflict
_PARALLEL = 0.95  # cosine


class _Drawn(NamedTuple):
    """The walls of a map, sampled places (N, 2) along them with their walls (N,), and the free space."""

    walls: Segments
    places: Floats
    wall: NDArray[np.int64]
    free: Area


def conflict_share(s: SceneGraph, a: SceneGraph, T_a_s: Floats) -> float:
    """The share of wall length in conflict, of all that both maps could see, in both directions together.

    The S-graph is placed by T_a_s (3,), yaw x y. 1 where the maps have nothing in common.
    """
    seen, known = _drawn(moved(s, T_a_s)), _drawn(a)
    (free, at), (known_free, known_at) = _compared(seen, known), _compared(known, seen)
    return (free + known_free) / (free + known_free + at + known_at) if at + known_at else 1.0


def _drawn(graph: SceneGraph) -> _Drawn:
    walls = Segments.of(graph.wall_surfaces)
    count = np.ceil(np.nan_to_num(walls.length) / _STEP).astype(np.int64)
    wall = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(wall)) - np.repeat(np.cumsum(count) - count, count)
    along = (2 * nth + 1) / count[wall] - 1
    rooms = [shapely.Polygon(room.polygon) for room in graph.rooms if len(room.polygon or ()) > 2]
    free = united(polygons_of(room).buffer(-_INSIDE) for room in rooms)
    shapely.prepare(free)
    return _Drawn(walls, walls.centre[wall] + along[:, None] * walls.arm[wall], wall, free)


def _compared(one: _Drawn, other: _Drawn) -> tuple[int, int]:
    """How many of the sampled places of a map stand in the other's free space, and how many at its walls."""
    ends = np.stack([other.walls.centre - other.walls.arm, other.walls.centre + other.walls.arm], axis=1)
    tree = shapely.STRtree(shapely.linestrings(ends))
    i, j = tree.query(shapely.points(one.places), predicate="dwithin", distance=_STEP)
    at = np.zeros(len(one.places), dtype=bool)
    at[i[np.abs(np.cos(one.walls.heading[one.wall[i]] - other.walls.heading[j])) > _PARALLEL]] = True
    inside = shapely.contains_xy(other.free, one.places[:, 0], one.places[:, 1])
    return int((inside & ~at).sum()), int(at.sum())
