"""The rays of all keyframes, in the BIM frame, what they would meet first in the plan, and what they met."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from data.common.bars import steps
from data.geometry.raycast import TriangleScene
from data.plans.bodies import PlannedElement
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_MOST_VIEWS = 150  # the nearest; more tell the same again, and a long run has thousands
CELL = 0.25  # m, side of the cells of a surface that count once for each keyframe
NORMAL_STEPS = 10  # of a unit vector's components, by which the faces of an element are distinguished


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
        return Rays(*(getattr(self, own.name)[which] for own in fields(Rays)))

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
        self._met = [_met(view, scene) for view in steps(views, "rays in the plan")]
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
        return self._through(
            body, BUILDING.displaced + BUILDING.around, np.array(self._seen_by.get(solid, []), dtype=np.int64)
        )

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
        kept = (own[which] for own in (direction, measured, planned, owner))
        return Rays(np.full(count, number), np.tile(sensor, (count, 1)), *kept)


def _met(view: View, scene: TriangleScene | None) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """The range (m) at which each ray would meet a solid, and the triangle; inf and -1 where there is none."""
    if scene is None:
        return np.full(len(view.points), np.inf, np.float32), np.full(len(view.points), -1, np.int32)
    planned, face = scene.faces(view.sensor, view.rays()[0])
    return planned.astype(np.float32), face.astype(np.int32)


def towards(seen: SeenRays, bodies: Sequence[Floats]) -> Ints:
    """(B, 2) how many rays go towards each of some bodies (M, 3, 3) and reach it, and how many end before it; a ray
    counts for the nearest of the bodies."""
    counts = np.zeros((len(bodies), 2), np.int64)
    scene = TriangleScene(np.concatenate(bodies)) if bodies else None
    owner = np.repeat(np.arange(len(bodies)), [len(body) for body in bodies])
    for view in seen.views:
        away, face = _met(view, scene)
        near = (face >= 0) & (away < SENSOR.furthest)
        is_hidden = view.rays()[1] < away - SENSOR.apart
        np.add.at(counts, (owner[face[near]], is_hidden[near].astype(np.int64)), 1)
    return counts


@dataclass(frozen=True)
class Sightings:
    """N sightings, one for each keyframe, cell of a surface: what was measured in it, in the median.

    `element`, `view` are indices. `offset` (m) is the place of what was met, along the planned normal towards the
    sensor: negative where rays go on behind the surface. `normal` (N, 3) is that normal, `cell` (N, 3) the cell.
    """

    element: Ints
    view: Ints
    offset: Floats
    normal: Floats
    cell: Ints


def sightings(seen: SeenRays) -> Sightings:
    """All sightings of the solids that the rays were compared with."""
    parts = [_of_view(seen, k) for k in range(len(seen.views))]
    rows = np.concatenate([np.empty((0, 9)), *parts])
    whole = rows[:, [0, 1, 6, 7, 8]].astype(np.int64)
    return Sightings(whole[:, 0], whole[:, 1], rows[:, 2], rows[:, 3:6], whole[:, 2:])


def _of_view(seen: SeenRays, number: int) -> Floats:
    """(M, 9) element, view, offset, normal and cell."""
    rays, measured, planned, face = seen.of_view(number)
    met = (face >= 0) & (planned < SENSOR.furthest)
    rays, measured, planned, face = rays[met], measured[met], planned[met], face[met]
    normal = seen.normal[face]
    cosine = -np.sum(normal * rays, axis=1)
    normal = np.where(cosine[:, None] < 0, -normal, normal)
    cosine = np.abs(cosine)
    good = cosine > SENSOR.least_cosine
    rays, normal, face = rays[good], normal[good], face[good]
    offset = (planned[good] - measured[good]) * cosine[good]
    cell = np.floor((seen.views[number].sensor + planned[good, None] * rays) / CELL).astype(np.int64)
    key = np.column_stack([seen.owner[face], np.rint(NORMAL_STEPS * normal).astype(np.int64), cell])
    _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
    order = np.lexsort((offset, group.ravel()))
    counts = np.bincount(group.ravel(), minlength=len(first))
    last = np.cumsum(counts) - 1
    median = (offset[order[last - counts // 2]] + offset[order[last - (counts - 1) // 2]]) / 2
    columns = seen.owner[face][first], np.full(len(first), number), median, normal[first], cell[first]
    return np.column_stack(columns)
