"""The rays of all keyframes, in the BIM frame, with what they would meet first in the plan."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from sgslam.as_built.elements.sightings import View

if TYPE_CHECKING:
    from data.plans.elements import PlannedElement  # loads ifcopenshell

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Rays:
    """N rays: index of the `view`, `origin` (N, 3) and unit `direction` (N, 3) in the BIM frame, `measured` (N,) and
    `planned` (N,) range in metres (inf where the plan has nothing), and `owner` (N,), the index of the solid element
    that is planned there, -1 for none."""

    view: Ints
    origin: Floats
    direction: Floats
    measured: Floats
    planned: Floats
    owner: Ints

    def __getitem__(self, which: NDArray[np.bool_] | Ints | slice) -> "Rays":
        """Some of the rays."""
        return Rays(
            self.view[which], self.origin[which], self.direction[which], self.measured[which], self.planned[which],
            self.owner[which],
        )  # fmt: skip

    def at(self, ranges: Floats) -> Floats:
        """(N, 3) the places on the rays at these ranges (N,)."""
        return self.origin + ranges[:, None] * self.direction


def rays_of(views: Sequence[View], solids: list["PlannedElement"]) -> Rays:
    """The rays of all views, cast against the solid elements."""
    origin = np.concatenate([np.broadcast_to(v.T_bim_sensor[:3, 3], v.points.shape) for v in views])
    ends = np.concatenate([v.points.astype(np.float64) @ v.T_bim_sensor[:3, :3].T for v in views])
    measured = np.linalg.norm(ends, axis=1)
    direction = ends / np.maximum(measured, 1e-9)[:, None]
    view = np.repeat(np.arange(len(views)), [len(v.points) for v in views])
    if not solids:
        nothing = np.full(len(view), -1)
        return Rays(view, origin, direction, measured, np.full(len(view), np.inf), nothing)
    planned, face = TriangleScene(np.concatenate([e.triangles for e in solids])).faces(origin, direction)
    owner = np.repeat(np.arange(len(solids)), [len(e.triangles) for e in solids])
    return Rays(view, origin, direction, measured, planned, np.where(face >= 0, owner[face], -1))
