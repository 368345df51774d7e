"""Bodies of walls: their horizontal sections and their outlines from above, polygons in plan, metres, BIM frame."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from data.geometry.areas import Area, closed, united

Array = NDArray[np.float64]
VERTICAL = 0.1  # |n_z| of a face that is taken for upright
SNAP = 1e-3  # m: ends of a cut's segments closer to each other are one
LEAST = 1e-3  # m2
AT_ONCE = 2_000_000  # solid angles
SLIT = 0.002  # m: between triangles that touch, from rounding


@dataclass(frozen=True, eq=False)
class Solid:
    """A body with the id and the IFC class of what it is read from, and the id of its storey; its connected pieces are
    triangles (M, 3, 3) with their vertex numbers (M, 3)."""

    id: str
    kind: str
    storey: str | None
    pieces: tuple[tuple[Array, NDArray[np.int32]], ...]
    bottom: float
    top: float
    is_building: ClassVar[bool] = False  # all walls and columns in one body

    def section(self, z: float) -> Area:
        """What a horizontal plane at `z` cuts out of the body."""
        if not self.bottom < z < self.top:
            return shapely.Polygon()
        return united(_section(triangles, corners, z) for triangles, corners in self.pieces)

    def shadow(self) -> Area:
        """The body seen from above; door and window openings are closed by what lies over and under them."""
        return closed(united(_shadow(triangles) for triangles, _ in self.pieces), SLIT)

    @cached_property
    def corners(self) -> Array:
        """(N, 3) of all triangles."""
        return np.concatenate([t for t, _ in self.pieces]).reshape(-1, 3)

    @cached_property
    def upright_faces(self) -> Array:
        """(M, 3, 3) the triangles that stand upright."""
        triangles = self.corners.reshape(-1, 3, 3)
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        return triangles[(lengths > 1e-9) & (np.abs(normals[:, 2]) < VERTICAL * lengths)]


def solid_of(vertices: Array, faces: NDArray[np.int32], id: str, kind: str, storey: str | None = None) -> Solid:
    """Splits a mesh of vertices (N, 3) into its connected pieces, since those of one product may overlap each other."""
    count = len(vertices)
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    of_face = label[faces[:, 0]]
    pieces = tuple((vertices[f], f) for f in (faces[of_face == k] for k in np.unique(of_face)))
    z = vertices[faces.ravel(), 2]
    return Solid(id, kind, storey, pieces, float(z.min()), float(z.max()))


def _section(triangles: Array, corners: NDArray[np.int32], z: float) -> Area:
    segments = _cut(triangles, corners, z)
    return shapely.build_area(shapely.multilinestrings(shapely.linestrings(segments)))


def _shadow(triangles: Array) -> Area:
    plan = triangles[:, :, :2]
    (ax, ay), (bx, by) = (plan[:, 1] - plan[:, 0]).T, (plan[:, 2] - plan[:, 0]).T
    return united(shapely.polygons(plan[np.abs(ax * by - ay * bx) > 1e-9]))


@dataclass(frozen=True, eq=False)
class Prism(Solid):
    """Walls with the same section at every height, and no faces: these reach from floor to ceiling."""

    area: Area
    is_building = True

    @staticmethod
    def of(area: Area, bottom: float, top: float) -> "Prism":
        """The walls over an area."""
        none = (np.zeros((0, 3, 3)), np.zeros((0, 3), np.int32))
        return Prism("walls", "IfcWall", None, (none,), bottom, top, area)

    def section(self, z: float) -> Area:
        """The walls."""
        return self.area if self.bottom < z < self.top else shapely.Polygon()


def mesh_solid(triangles: Array) -> "MeshSolid":
    """Returns a mesh as one body."""
    faces = np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)
    z = triangles[:, :, 2]
    return MeshSolid("mesh", "IfcWall", None, ((triangles, faces),), float(z.min()), float(z.max()))


class MeshSolid(Solid):
    """A body whose sections are valid although its surface is not closed."""

    is_building = True

    @lru_cache(maxsize=64)  # noqa: B019 - a body is made once for a building
    def section(self, z: float) -> Area:
        """What of the plane at `z` lies inside: faces between the cut's segments with a winding number above one half.

        Generalised winding numbers (Jacobson et al., "Robust inside-outside segmentation using generalized winding
        numbers", SIGGRAPH 2013) are right in spite of slits and overlapping bodies.
        """
        triangles, corners = self.pieces[0]
        segments = _cut(triangles, corners, z)
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


def _cut(triangles: Array, corners: NDArray[np.int32], z: float) -> Array:
    """(K, 2, 2) the segments in which triangles (M, 3, 3), with their vertex numbers (M, 3), meet the plane at `z`."""
    above = triangles[:, :, 2] >= z
    cut = above.any(axis=1) & ~above.all(axis=1)
    triangles, corners, above = triangles[cut], corners[cut], above[cut]
    points = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        # An edge is cut from its lower vertex number to its higher: both its triangles get the same point.
        swap = corners[:, i] > corners[:, j]
        a = np.where(swap[:, None], triangles[:, j], triangles[:, i])
        b = np.where(swap[:, None], triangles[:, i], triangles[:, j])
        rise = np.where(above[:, i] != above[:, j], b[:, 2] - a[:, 2], 1.0)
        points.append(a[:, :2] + ((z - a[:, 2]) / rise)[:, None] * (b - a)[:, :2])
    crossed = above != np.roll(above, -1, axis=1)  # edges 01, 12, 20
    segments = np.stack(points, axis=1)[crossed].reshape(-1, 2, 2)
    return segments[np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > 0]
