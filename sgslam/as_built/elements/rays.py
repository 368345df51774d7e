"""The rays of all keyframes, in the BIM frame, with what they would meet first in the plan."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.plans.bodies import PlannedElement
from sgslam.config.sensor import SENSOR

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_AROUND = 0.9  # m around a body: as far as it may be displaced, and the edges of what it stands in
_MOST_VIEWS = 150  # the nearest; more tell the same again, and a long run has thousands


@dataclass(frozen=True)
class View:
    """One keyframe: `points` (N, 3) in the sensor frame, `T_bim_sensor` (4, 4), standard deviations `sigma` (3,) of its
    position along x, y, z of the BIM frame (m), and `sigma_heading` (rad) of its turn about the vertical."""

    points: NDArray[np.float32]
    T_bim_sensor: Floats
    sigma: Floats
    sigma_heading: float

    @property
    def sensor(self) -> Floats:
        """(3,) its place in the BIM frame."""
        return self.T_bim_sensor[:3, 3]

    def rays(self) -> tuple[Floats, Floats]:
        """(N, 3) unit vectors in the BIM frame, and (N,) the measured ranges."""
        ends = self.points.astype(np.float64) @ self.T_bim_sensor[:3, :3].T
        measured = np.linalg.norm(ends, axis=1)
        return ends / np.maximum(measured, 1e-9)[:, None], measured


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
    """The rays of all views, with what they would meet first among the `solids`; eight bytes for each ray.

    `owner` (M,) and `normal` (M, 3) are of the solids' triangles: the index of the solid, and the unit normal.
    """

    def __init__(self, views: Sequence[View], solids: Sequence[PlannedElement]) -> None:
        self.views = views
        triangles = np.concatenate([np.empty((0, 3, 3)), *(element.triangles for element in solids)])
        self.owner = np.repeat(np.arange(len(solids)), [len(element.triangles) for element in solids])
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        self.normal = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        self._sensors = np.array([view.sensor for view in views]).reshape(-1, 3)
        scene = TriangleScene(triangles) if len(triangles) else None
        self._met = [_met(view, scene) for view in views]
        self._seen_by: dict[int, list[int]] = {}
        for k, (_, faces) in enumerate(self._met):
            for solid in np.unique(self.owner[np.unique(faces[faces >= 0])]).tolist():
                self._seen_by.setdefault(solid, []).append(k)

    def of_view(self, number: int) -> tuple[Floats, Floats, Floats, Ints]:
        """Of each ray of a view the direction (N, 3), the measured and the planned range (N,), and the triangle that is
        planned there (N,), -1 for none."""
        planned, faces = self._met[number]
        return *self.views[number].rays(), planned.astype(np.float64), faces.astype(np.int64)

    def near(self, body: Floats, solid: int) -> Rays:
        """The rays that pass a body (M, 3, 3) closely, of the nearest views that would see the `solid` (index) in which
        it lies."""
        return self._through(body, _AROUND, np.array(self._seen_by.get(solid, []), dtype=np.int64))

    def crossing(self, body: Floats, around: float) -> Rays:
        """The rays of the nearest views that pass the box about a body (M, 3, 3), wider by `around` (m)."""
        return self._through(body, around, np.arange(len(self.views)))

    def _through(self, body: Floats, around: float, views: Ints) -> Rays:
        corners = body.reshape(-1, 3)
        low, high = corners.min(axis=0) - around, corners.max(axis=0) + around
        sensors = self._sensors[views]
        away = np.linalg.norm(np.maximum(np.maximum(low - sensors, sensors - high), 0.0), axis=1)
        own = np.argsort(away, kind="stable")[:_MOST_VIEWS]
        found = [self._passing(int(k), low, high) for k in np.sort(views[own[away[own] < SENSOR.furthest]])]
        nothing = np.empty(0, np.int64)
        empty = Rays(nothing, np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0), nothing)
        return Rays(*(np.concatenate([getattr(part, own.name) for part in (empty, *found)]) for own in fields(Rays)))

    def _passing(self, number: int, low: Floats, high: Floats) -> Rays:
        """Those of one view that pass through a box."""
        direction, measured, planned, faces = self.of_view(number)
        sensor = self._sensors[number]
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (low - sensor) / direction, (high - sensor) / direction
        enters, leaves = np.fmin(first, second).max(axis=1), np.fmax(first, second).min(axis=1)
        which = (enters <= leaves) & (leaves > 0)
        owner = np.where(faces >= 0, self.owner[faces], -1) if len(self.owner) else faces
        count = int(which.sum())
        return Rays(
            np.full(count, number), np.tile(sensor, (count, 1)), direction[which], measured[which], planned[which],
            owner[which],
        )  # fmt: skip


def _met(view: View, scene: TriangleScene | None) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """The range (m) at which each ray would meet a solid, and the triangle; inf and -1 where there is none."""
    if scene is None:
        return np.full(len(view.points), np.inf, np.float32), np.full(len(view.points), -1, np.int32)
    planned, face = scene.faces(view.sensor, view.rays()[0])
    return planned.astype(np.float32), face.astype(np.int32)
