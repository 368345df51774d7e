"""Horizontal cuts through a mesh whose walls are bodies, maybe with slits, doubled faces and overlaps."""

from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.areas import Area, united
from data.ifc.products import IfcProduct
from data.ifc.sections import Solid

Array = NDArray[np.float64]
SNAP = 1e-3  # m: ends of a cut's segments closer to each other are one
LEAST = 1e-3  # m2
AT_ONCE = 2_000_000  # solid angles


def mesh_solid(triangles: Array, name: str) -> "MeshSolid":
    """Returns a mesh as one body."""
    faces = np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)
    z = triangles[:, :, 2]
    product = IfcProduct("mesh", "IfcWall", name, None, triangles.reshape(-1, 3), faces)
    return MeshSolid(product, ((triangles, faces),), float(z.min()), float(z.max()))


class MeshSolid(Solid):
    """A body whose sections are valid although its surface is not closed."""

    is_building = True

    @lru_cache(maxsize=64)  # noqa: B019 - a body is made once for a building
    def section(self, z: float) -> Area:
        """What of the plane at `z` lies inside: faces between the cut's segments with a winding number above one half.

        Generalised winding numbers (Jacobson et al., "Robust inside-outside segmentation using generalized winding
        numbers", SIGGRAPH 2013) are right in spite of slits and overlapping bodies.
        """
        triangles = self.pieces[0][0]
        segments = _cut(triangles, z)
        if not len(segments):
            return shapely.Polygon()
        lines = shapely.set_precision(shapely.multilinestrings(shapely.linestrings(segments)), SNAP)
        noded = shapely.union_all(lines, grid_size=SNAP)
        faces = [f for f in shapely.get_parts(shapely.polygonize([noded])) if f.area > LEAST]
        if not faces:
            return shapely.Polygon()
        inner = np.array([[p.x, p.y, z] for p in shapely.point_on_surface(faces)])
        inside = np.abs(winding_numbers(triangles, inner)) > 0.5
        return united(face for face, solid in zip(faces, inside.tolist(), strict=True) if solid)


def winding_numbers(triangles: Array, points: Array) -> Array:
    """(N,) the winding numbers of triangles (M, 3, 3) around points (N, 3).

    Solid angles after Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 1983.
    """
    numbers = []
    for part in np.array_split(points, max(1, -(-len(points) * len(triangles) // AT_ONCE))):
        a, b, c = (triangles[None, :, k] - part[:, None] for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
        volume = np.einsum("nmk,nmk->nm", a, np.cross(b, c))
        dots = [np.einsum("nmk,nmk->nm", u, v) for u, v in ((a, b), (b, c), (c, a))]
        below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
        numbers.append(2 * np.arctan2(volume, below).sum(axis=1) / (4 * np.pi))
    return np.concatenate(numbers)


def _cut(triangles: Array, z: float) -> Array:
    """(K, 2, 2) the segments in which triangles meet the plane."""
    above = triangles[:, :, 2] >= z
    crossed = above.any(axis=1) & ~above.all(axis=1)
    corners, high = triangles[crossed], above[crossed]
    following = np.roll(corners, -1, axis=1)
    crosses = high != np.roll(high, -1, axis=1)  # two edges of each
    rise = np.where(crosses, following[:, :, 2] - corners[:, :, 2], 1.0)
    share = (z - corners[:, :, 2]) / rise
    points = corners[:, :, :2] + share[:, :, None] * (following - corners)[:, :, :2]
    segments = points[crosses].reshape(-1, 2, 2)
    return segments[np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > 0]
