"""The level faces of bodies, up to slopes of 15 degrees, and what of them is not hidden by others.

A plane is (a, b, c), z = a + b x + c y, in metres.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.areas import Area, difference, overlap, polygons_of, united
from data.geometry.raycast import area_normals

Array = NDArray[np.float64]
Plane = tuple[float, float, float]
LEVEL = float(np.cos(np.radians(15.0)))  # of the angle between a face and the horizontal; ramps have up to 11 degrees
FLAT = 1e-4  # slope of what is meant to be level
LEAST = 0.5  # m2: of what is a floor or ceiling; a smaller face only hides others
SAME = 0.002  # m: corners of one plane
TOUCH = 0.001  # m between faces that lie on each other
CLEARANCE = 1.3  # m above a floor or below a ceiling: nobody looks at it where there is less
INSIDE = (0.2, 0.34, 0.46)  # weights of a triangle's corners: a point that is hardly on an edge of another one


@dataclass(frozen=True, eq=False)
class LevelFace:
    """A face in plan view with its plane; `is_floor`: it faces up. `source` is the id of its body, `kind` its class."""

    area: Area
    plane: Plane
    is_floor: bool
    source: str
    kind: str

    @property
    def middle(self) -> float:
        """The z of the plane in the middle of the face."""
        a, b, c = self.plane
        return float(a + b * self.area.centroid.x + c * self.area.centroid.y) if b or c else a


def level_faces(triangles: Array, source: str = "", kind: str = "", is_body: bool = True) -> Iterator[LevelFace]:
    """Yields the level faces of triangles (M, 3, 3).

    Those of one connected body (`is_body`) face away from its inside, whichever way they were drawn; a sheet faces both
    ways. Other triangles face as they were drawn.
    """
    normals = area_normals(triangles)
    sizes = np.linalg.norm(normals, axis=1)
    order = np.argsort(-sizes, kind="stable")
    free = (np.abs(normals[:, 2]) > LEVEL * sizes) & (sizes > 0)
    for k in order[free[order]].tolist():
        if not free[k]:
            continue
        own = free & (normals[:, 2] * normals[k, 2] > 0)
        own[own] = _off(triangles[own], _plane(normals[k : k + 1], triangles[k : k + 1])).max(axis=1) < SAME
        own[k] = True
        free &= ~own
        area = united(shapely.polygons(triangles[own, :, :2]))
        plane = _plane(normals[own] * np.sign(normals[own, 2:]), triangles[own])
        above, below = _crossings(triangles, INSIDE @ triangles[k])
        sides = [bool(normals[k, 2] > 0)]
        if is_body:
            sides = [above % 2 == 0] if (above + below) % 2 else [True, False]
        for is_floor in sides:
            yield LevelFace(area, plane, is_floor, source, kind)


def _plane(normals: Array, triangles: Array) -> Plane:
    """The plane with the sum of area normals (M, 3) through the middle of triangles (M, 3, 3)."""
    n = normals.sum(axis=0)
    x, y, z = np.average(triangles.mean(axis=1), axis=0, weights=np.abs(normals[:, 2])).tolist()
    b, c = (-n[:2] / n[2]).tolist()
    return (z, 0.0, 0.0) if np.hypot(b, c) < FLAT else (z - b * x - c * y, b, c)


def _off(points: Array, plane: Plane) -> Array:
    """(...,) how far points (..., 3) are above or below a plane."""
    return np.asarray(np.abs(points[..., 2] - plane[0] - points[..., :2] @ plane[1:]))


def _crossings(triangles: Array, point: Array) -> tuple[int, int]:
    """How often a vertical line through a point meets triangles (M, 3, 3) above it, and below it, without those that it
    lies on."""
    a, b, c = (triangles[:, k, :2] - point[:2] for k in range(3))
    w = np.stack([u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] for u, v in ((b, c), (c, a), (a, b))], axis=1)
    total = w.sum(axis=1)
    met = ((w > 0).all(axis=1) | (w < 0).all(axis=1)) & (total != 0)
    z = (w[met] * triangles[met, :, 2]).sum(axis=1) / total[met]
    return int((z > point[2] + SAME).sum()), int((z < point[2] - SAME).sum())


def visible(faces: Sequence[LevelFace]) -> list[LevelFace]:
    """The faces without what lies on them, and without what another one covers so closely that nobody looks between
    them: a slab under a floor covering, or over a suspended ceiling. Of equal faces the first one stays."""
    tree = shapely.STRtree([f.area for f in faces])
    found = []
    for k, face in enumerate(faces):
        if face.area.area < LEAST:
            continue
        near = sorted(tree.query(face.area, predicate="intersects").tolist())
        hidden = [part for j in near if j != k for part in _hidden(face, faces[j], j < k)]
        shown = replace(face, area=polygons_of(difference(face.area, united(hidden)))) if hidden else face
        found += [shown] if shown.area.area > LEAST else []
    return found


def _hidden(face: LevelFace, other: LevelFace, first: bool) -> Iterator[Area]:
    """What `other`, which comes `first` or not, hides of a face."""
    side, (x0, y0, x1, y1) = 1.0 if face.is_floor else -1.0, face.area.bounds
    a, b, c = between = tuple(side * (theirs - own) for theirs, own in zip(other.plane, face.plane, strict=True))
    apart = [a + b * x + c * y for x in (x0, x1) for y in (y0, y1)]
    if max(apart) < -TOUCH or min(apart) > CLEARANCE:
        return
    shared = overlap(face.area, other.area)
    yield within(shared, between, TOUCH, CLEARANCE)
    if face.source != other.source and (face.is_floor != other.is_floor or first):
        yield within(shared, between, -TOUCH, TOUCH)


def within(area: Area, plane: tuple[float, ...], low: float, high: float) -> Area:
    """The part of an area in which a plane is between two heights."""
    a, b, c = plane
    area, slope = polygons_of(area), float(np.hypot(b, c))
    if area.is_empty:
        return area
    if slope < FLAT:
        return area if low < a + b * area.centroid.x + c * area.centroid.y < high else shapely.Polygon()
    x0, y0, x1, y1 = area.buffer(1.0).bounds
    middle, reach = np.array([(x0 + x1) / 2, (y0 + y1) / 2]), x1 - x0 + y1 - y0
    up, along = np.array([b, c]) / slope, np.array([-c, b]) / slope
    ends = np.clip((np.array([low, high]) - a - middle @ (b, c)) / slope, -reach, reach)
    corners = [middle + u * up + v * along for u, v in ((ends[0], -reach), (ends[1], -reach), (ends[1], reach))]
    strip = shapely.Polygon([*corners, middle + ends[0] * up + reach * along])
    return polygons_of(overlap(area, strip)) if strip.area > 0 else shapely.Polygon()
