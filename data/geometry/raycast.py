"""Rays against triangles (Embree), in coordinates that may lie kilometres from zero."""

import numpy as np
from numpy.typing import NDArray

# (12, 3) the triangles of a box whose corners come in the order of their x, then y, then z
BOX_FACES = np.array(
    [
        face
        for a, b, c, d in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        for face in ((a, b, c), (a, c, d))
    ],
    dtype=np.int32,
)


def area_normals(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, 3) the normals of triangles (M, 3, 3), as long as their areas."""
    return np.asarray(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2)


class TriangleScene:
    """Triangles (M, 3, 3) in metres, kept about a local origin because Embree counts in float32."""

    def __init__(self, triangles: NDArray[np.float64]) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        corners = triangles.reshape(-1, 3)
        self._origin = (corners.min(axis=0) + corners.max(axis=0)) / 2
        self._scene = rtcore_scene.EmbreeScene()
        self._mesh = TriangleMesh(self._scene, (triangles - self._origin).astype(np.float32))  # kept alive

    def distances(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) metres along unit `directions` from `origins`, (N, 3) or one of them (3,); inf where nothing is."""
        hits = self._scene.run(*self._rays(origins, directions), query="DISTANCE")
        return np.where(hits < 1e30, hits, np.inf).astype(np.float64)

    def faces(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """As `distances`, and (N,) the index of the triangle that is met first; -1 where nothing is."""
        hits = self._scene.run(*self._rays(origins, directions), output=1)
        face = hits["primID"].astype(np.int64)
        return np.where(face >= 0, hits["tfar"].astype(np.float64), np.inf), face

    def incidences(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """As `distances`, and (N,) the cosines of the angles between rays and surfaces' normals; 1 where nothing is."""
        hits = self._scene.run(*self._rays(origins, directions), output=1)
        found, normals = hits["primID"] >= 0, hits["Ng"].astype(np.float64)
        lengths = np.where(found, np.linalg.norm(normals, axis=1), 1.0)
        cosines = np.abs(np.einsum("ij,ij->i", normals, directions)) / np.maximum(lengths, 1e-12)
        return np.where(found, hits["tfar"].astype(np.float64), np.inf), np.where(found, cosines, 1.0)

    def _rays(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(N, 3) both, about the local origin, as Embree takes them."""
        local, along = np.broadcast_arrays((origins - self._origin).astype(np.float32), directions.astype(np.float32))
        return np.ascontiguousarray(local), np.ascontiguousarray(along)
