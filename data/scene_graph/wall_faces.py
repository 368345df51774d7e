"""Which surfaces of a plan are faces of one wall."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data.scene_graph.nodes import WallSurface

_PARALLEL = 0.999  # cosine
_THICKEST = 0.7  # m between the two sides of a wall
_IN_LINE = 0.02  # m: surfaces in one plane


def wall_names(surfaces: Sequence[WallSurface]) -> dict[str, str]:
    """The name of the wall that each surface, by its id, is a face of: its source where the plan knows it.

    Where not, surfaces that lie in one plane and face the same way are one wall, and so are two that face away from
    each other, no further apart than a wall is thick.
    """
    unnamed = [surface for surface in surfaces if not surface.source]
    names = {surface.id: surface.source for surface in surfaces if surface.source}
    if unnamed:
        from scipy.sparse.csgraph import connected_components

        _, wall = connected_components(_belong_together(unnamed), directed=False)
        names |= {surface.id: f"wall {number}" for surface, number in zip(unnamed, wall.tolist(), strict=True)}
    return names


def _belong_together(surfaces: list[WallSurface]) -> NDArray[np.bool_]:
    """(N, N) whether two surfaces are faces of one wall."""
    normals = np.array([surface.normal for surface in surfaces])
    away = np.array([surface.centroid for surface in surfaces])
    away = away[None, :] - away[:, None]
    lengths = np.array([surface.length or 0.0 for surface in surfaces])
    facing = normals @ normals.T
    behind = -np.einsum("ijk,ik->ij", away, normals)  # m, by which the other one lies behind
    along = np.abs(away[..., 0] * normals[:, None, 1] - away[..., 1] * normals[:, None, 0])
    overlap = along < (lengths[:, None] + lengths) / 2
    in_line = (facing > _PARALLEL) & (np.abs(behind) < _IN_LINE)
    back_to_back = (facing < -_PARALLEL) & (behind > 0) & (behind < _THICKEST) & overlap
    return np.asarray(in_line | back_to_back)
