"""Free-space conflict of two maps of one place: walls of one map that stand in the free space of the other.

The map of an earlier run lacks rooms. In a building of equal wings or offices, a missing room looks like a mapped one,
so a wrong place may explain most walls. But two maps of the same place agree wherever both have looked, whereas a
similar part has some wall elsewhere, in what the other map saw as free space.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from data import SceneGraph
from data.geometry import se2
from data.geometry.areas import Area, polygons_of, united

Floats = NDArray[np.float64]
_STEP = 0.2  # m between the sampled places of a wall, and to a wall of the other map that counts as the same
_INSIDE = 0.3  # m inside the outline of a room's free space, from which on a wall is in conflict
_PARALLEL = 0.95  # cosine


@dataclass(frozen=True)
class _Drawn:
    """A map as drawn: sampled places along walls and the normals there (N, 2); M walls as lines, their normals (M, 2);
    and the free space."""

    places: Floats
    normals: Floats
    walls: NDArray[np.object_]
    wall_normals: Floats
    free: Area

    @staticmethod
    def of(graph: SceneGraph, T: Floats) -> "_Drawn":
        """Draws a map moved by T (3,), yaw x y."""
        walls = graph.wall_surfaces
        centre = se2.apply(T, np.array([w.centroid for w in walls], dtype=float).reshape(-1, 2))
        normal = se2.rotate(T[0], np.array([w.normal for w in walls], dtype=float).reshape(-1, 2))
        length = np.array([w.length or 0.0 for w in walls])
        arm = length[:, None] / 2 * np.column_stack([-normal[:, 1], normal[:, 0]])
        count = np.ceil(length / _STEP).astype(np.int64)
        which = np.repeat(np.arange(len(walls)), count)
        nth = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        share = 2 * (nth + 0.5) / np.maximum(count[which], 1) - 1
        rooms = [shapely.Polygon(se2.apply(T, np.array(r.polygon))) for r in graph.rooms if len(r.polygon or ()) > 2]
        free = united(polygons_of(room).buffer(-_INSIDE) for room in rooms)
        shapely.prepare(free)
        lines = shapely.linestrings(np.stack([centre - arm, centre + arm], axis=1))
        return _Drawn(centre[which] + share[:, None] * arm[which], normal[which], lines, normal, free)

    def against(self, other: "_Drawn") -> tuple[int, int]:
        """How many of the sampled places stand in the other's free space, and how many at its walls."""
        i, j = shapely.STRtree(other.walls).query(shapely.points(self.places), predicate="dwithin", distance=_STEP)
        at = np.zeros(len(self.places), dtype=bool)
        at[i[np.abs(np.sum(self.normals[i] * other.wall_normals[j], axis=1)) > _PARALLEL]] = True
        inside = shapely.contains_xy(other.free, self.places[:, 0], self.places[:, 1])
        return int((inside & ~at).sum()), int(at.sum())


def conflict_share(s: SceneGraph, a: SceneGraph, T_a_s: Floats) -> float:
    """The share of wall length in conflict, of all that both maps could see, in both directions together.

    The S-graph is placed by T_a_s (3,), yaw x y. 1 where the maps have nothing in common.
    """
    if not s.wall_surfaces or not a.wall_surfaces:
        return 1.0
    seen, known = _Drawn.of(s, np.asarray(T_a_s, dtype=float)), _Drawn.of(a, np.zeros(3))
    (free, at), (known_free, known_at) = seen.against(known), known.against(seen)
    return (free + known_free) / (free + known_free + at + known_at) if at + known_at else 1.0
