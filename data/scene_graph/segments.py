"""Wall surfaces in plan: as arrays, and which of them are faces of one wall."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from data.geometry.se2 import Array
from data.scene_graph.nodes import WallSurface

_PARALLEL = 0.999  # cosine
_THICKEST = 0.7  # m between the two sides of a wall
_IN_LINE = 0.02  # m: surfaces in one plane


@dataclass(frozen=True, eq=False)
class Segments:
    """N wall surfaces as directed segments in plan, all in one frame; metres, radians."""

    centre: Array  # (N, 2)
    heading: Array  # (N,) of the inward normal
    half: Array  # (N,) half the length, NaN where not known

    @staticmethod
    def of(surfaces: Collection[WallSurface]) -> "Segments":
        """Those of a scene graph, in its frame."""
        points = (surface.centroid for surface in surfaces), (surface.normal for surface in surfaces)
        centre, normal = (np.fromiter(chain.from_iterable(own), float).reshape(-1, 2) for own in points)
        length = np.array([surface.length for surface in surfaces], dtype=float)  # None becomes NaN
        return Segments(centre, np.arctan2(normal[:, 1], normal[:, 0]), length / 2)

    @cached_property
    def normal(self) -> Array:
        """(N, 2) inward normals."""
        return np.stack((np.cos(self.heading), np.sin(self.heading)), axis=-1)

    @cached_property
    def tangent(self) -> Array:
        """(N, 2) the normals rotated by 90 degrees to the left."""
        return np.stack((-np.sin(self.heading), np.cos(self.heading)), axis=-1)

    @property
    def length(self) -> Array:
        """(N,) NaN where not known."""
        return 2 * self.half

    @property
    def arm(self) -> Array:
        """(N, 2) from the middle to the left end, looking along the normal; zero for unknown lengths."""
        return np.nan_to_num(self.half)[:, None] * self.tangent


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
