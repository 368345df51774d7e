"""The directions of wall surfaces in plan."""

from functools import cached_property

import numpy as np

from data.geometry.se2 import Array


class WallDirections:
    """For dataclasses of N wall surfaces with a `heading` (N,): that of the inward normal, in radians."""

    heading: Array

    @cached_property
    def normal(self) -> Array:
        """(N, 2) inward normals."""
        return np.stack((np.cos(self.heading), np.sin(self.heading)), axis=-1)

    @cached_property
    def tangent(self) -> Array:
        """(N, 2) the normals rotated by 90 degrees to the left."""
        return np.stack((-np.sin(self.heading), np.cos(self.heading)), axis=-1)
