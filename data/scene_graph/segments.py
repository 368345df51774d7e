"""Wall surfaces in plan as arrays."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

from data.geometry.se2 import Array
from data.scene_graph.nodes import WallSurface


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
