"""The rays of all keyframes, in the BIM frame, with what they would meet first in the plan."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from sgslam.as_built.elements.sightings import FURTHEST_RAY, View

if TYPE_CHECKING:
    from data.plans.elements import PlannedElement  # loads ifcopenshell

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_AROUND = 0.9  # m around a body: as far as it may be displaced, and the edges of what it stands in
_MOST_VIEWS = 150  # the nearest; more tell the same again, and a long run has thousands


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


class SeenRays:
    """The rays of all views, with what they would meet first among the `solids`; eight bytes for each ray."""

    def __init__(self, views: Sequence[View], solids: list["PlannedElement"]) -> None:
        self._views = views
        self._sensors = np.array([view.T_bim_sensor[:3, 3] for view in views]).reshape(-1, 3)
        scene = TriangleScene(np.concatenate([e.triangles for e in solids])) if solids else None
        owner = np.repeat(np.arange(len(solids), dtype=np.int32), [len(e.triangles) for e in solids])
        self._met = [_met(view, scene, owner) for view in views]
        self._seen_by: dict[int, list[int]] = {}
        for k, (_, owners) in enumerate(self._met):
            for solid in np.unique(owners).tolist():
                self._seen_by.setdefault(solid, []).append(k)

    def near(self, body: Floats, solid: int) -> Rays:
        """The rays that pass a body (M, 3, 3) closely, of the nearest views that would see the `solid` (index) in which
        it lies."""
        corners = body.reshape(-1, 3)
        low, high = corners.min(axis=0) - _AROUND, corners.max(axis=0) + _AROUND
        views = np.array(self._seen_by.get(solid, []), dtype=np.int64)
        sensors = self._sensors[views]
        away = np.linalg.norm(np.maximum(np.maximum(low - sensors, sensors - high), 0.0), axis=1)
        own = np.argsort(away, kind="stable")[:_MOST_VIEWS]
        found = [self._passing(int(k), low, high) for k in np.sort(views[own[away[own] < FURTHEST_RAY]])]
        return _joined(found or [self._passing(None, low, high)])

    def _passing(self, number: int | None, low: Floats, high: Floats) -> Rays:
        """Those of one view that pass through a box, None for no view."""
        if number is None:
            nothing = np.empty(0, np.int64)
            return Rays(nothing, np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0), nothing)
        view, (planned, owner) = self._views[number], self._met[number]
        sensor, direction, measured = self._sensors[number], *_directions(view)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (low - sensor) / direction, (high - sensor) / direction
        enters, leaves = np.fmin(first, second).max(axis=1), np.fmax(first, second).min(axis=1)
        which = (enters <= leaves) & (leaves > 0)
        count = int(which.sum())
        return Rays(
            np.full(count, number), np.tile(sensor, (count, 1)), direction[which], measured[which],
            planned[which].astype(np.float64), owner[which].astype(np.int64),
        )  # fmt: skip


def _directions(view: View) -> tuple[Floats, Floats]:
    """(N, 3) unit vectors in the BIM frame, and (N,) the measured ranges."""
    ends = view.points.astype(np.float64) @ view.T_bim_sensor[:3, :3].T
    measured = np.linalg.norm(ends, axis=1)
    return ends / np.maximum(measured, 1e-9)[:, None], measured


def _met(
    view: View, scene: TriangleScene | None, owner: NDArray[np.int32]
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """The range (m) at which each ray would meet a solid, and its index; inf and -1 where there is none."""
    if scene is None:
        return np.full(len(view.points), np.inf, np.float32), np.full(len(view.points), -1, np.int32)
    planned, face = scene.faces(view.T_bim_sensor[:3, 3], _directions(view)[0])
    return planned.astype(np.float32), np.where(face >= 0, owner[face], -1).astype(np.int32)


def _joined(parts: Sequence[Rays]) -> Rays:
    return Rays(*(np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(Rays)))
