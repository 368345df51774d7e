"""Horizontal sections of products, and their outlines from above: polygons in plan, metres, BIM frame."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from data.geometry.areas import Area, closed, united
from data.ifc.products import IfcProduct

VERTICAL = 0.1  # |n_z| of a face that is taken for upright
SLIT = 0.002  # m: between triangles that touch, from rounding


@dataclass(frozen=True, eq=False)
class Solid:
    """A product as a body: its connected pieces as triangles (M, 3, 3) with their vertex numbers (M, 3)."""

    product: IfcProduct
    pieces: tuple[tuple[NDArray[np.float64], NDArray[np.int32]], ...]
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
    def upright_faces(self) -> NDArray[np.float64]:
        """(M, 3, 3) the triangles that stand upright."""
        triangles = np.concatenate([t for t, _ in self.pieces])
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        return triangles[(lengths > 1e-9) & (np.abs(normals[:, 2]) < VERTICAL * lengths)]


def solid_of(product: IfcProduct) -> Solid:
    """Splits the mesh into its connected pieces, since pieces of one product may overlap each other."""
    faces = product.faces
    count = len(product.vertices)
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    of_face = label[faces[:, 0]]
    pieces = tuple((product.vertices[f], f) for f in (faces[of_face == k] for k in np.unique(of_face)))
    z = product.vertices[faces.ravel(), 2]
    return Solid(product, pieces, float(z.min()), float(z.max()))


def _section(triangles: NDArray[np.float64], corners: NDArray[np.int32], z: float) -> Area:
    """Each triangle that straddles the plane gives a segment; closed chains of them bound the area."""
    above = triangles[:, :, 2] >= z
    cut = above.any(axis=1) & ~above.all(axis=1)
    triangles, corners, above = triangles[cut], corners[cut], above[cut]
    if not len(triangles):
        return shapely.Polygon()
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
    segments = segments[np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > 0]
    return shapely.build_area(shapely.multilinestrings(shapely.linestrings(segments)))


def _shadow(triangles: NDArray[np.float64]) -> Area:
    plan = triangles[:, :, :2]
    (ax, ay), (bx, by) = (plan[:, 1] - plan[:, 0]).T, (plan[:, 2] - plan[:, 0]).T
    return united(shapely.polygons(plan[np.abs(ax * by - ay * bx) > 1e-9]))
