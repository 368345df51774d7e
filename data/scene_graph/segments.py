"""Wall surfaces in plan: as arrays, and which of them are faces of one wall."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph.nodes import WallSurface

PARALLEL = 0.99  # cosine between both sides of a wall, and the pieces of one
THICKEST = 0.7  # m between the two sides of a wall
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

    def moved(self, T_out_in: Array) -> "Segments":
        """The same under a motion (3,), yaw x y."""
        return Segments(se2.apply(T_out_in, self.centre), self.heading + T_out_in[0], self.half)

    @property
    def length(self) -> Array:
        """(N,) NaN where not known."""
        return 2 * self.half

    @property
    def arm(self) -> Array:
        """(N, 2) from the middle to the left end, looking along the normal; zero for unknown lengths."""
        return np.nan_to_num(self.half)[:, None] * self.tangent


def straight_walls(surfaces: Sequence[WallSurface]) -> tuple[NDArray[np.int64], Array]:
    """(N,) the number of the straight wall that each surface is a face of, in the order of their first faces, and (N,)
    1 where it faces as the first one does, -1 where it faces the other way.

    Those of one source are of one wall where they are parallel and no further apart than a wall is thick: a wall of the
    source may go round corners. One without a source is a wall of its own.
    """
    numbers, senses, count = np.empty(len(surfaces), np.int64), np.ones(len(surfaces)), 0
    legs: dict[str, list[tuple[int, WallSurface]]] = {}  # the first face of each, by source
    for k, surface in enumerate(surfaces):
        own = legs.setdefault(surface.source or surface.id, [])
        for number, first in own:
            (nx, ny), (mx, my) = surface.normal, first.normal
            across = (surface.centroid[0] - first.centroid[0]) * mx + (surface.centroid[1] - first.centroid[1]) * my
            if abs(nx * mx + ny * my) > PARALLEL and abs(across) < THICKEST:
                numbers[k], senses[k] = number, np.sign(nx * mx + ny * my)
                break
        else:
            numbers[k], count = count, count + 1
            own.append((count - 1, surface))
    return numbers, senses


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
    in_line = (facing > PARALLEL) & (np.abs(behind) < _IN_LINE)
    back_to_back = (facing < -PARALLEL) & (behind > 0) & (behind < THICKEST) & overlap
    return np.asarray(in_line | back_to_back)
