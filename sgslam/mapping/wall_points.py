"""What keyframes saw of planned walls: the points near each, and how far they lie off it."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import WALL_HEIGHT, SceneGraph, WallSurface
from data.scene_graph.segments import Segments, straight_walls, wall_names
from sgslam.config.sensor import SENSOR
from sgslam.geometry.frames import transform_points

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_EDGE = 0.2  # m at a wall's ends, floor and ceiling that are left out: other surfaces begin there
_LEAST_POINTS = 6  # of a face in a keyframe
_BIN = SENSOR.range_noise / 4  # of the search for the distance at which most points lie


@dataclass(frozen=True, eq=False)
class Faces:
    """M upright faces: `wall` numbers the walls that they are of, `sign` (M,) is 1 where a wall's offset is along the
    face's normal, -1 where it is against it. `centre` and `normal` (M, 2) are in plan view, `half` (M,) half their
    lengths, `heights` (M, 2) their lower and upper edges, in the plan's frame. `surface` has the ids of
    their surfaces, `body` the names of the walls that these are of."""

    wall: Ints
    sign: Floats
    centre: Floats
    normal: Floats
    half: Floats
    heights: Floats
    surface: tuple[str, ...]
    body: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class WallPoints:
    """N means, one for each face that a keyframe saw.

    `face` and `keyframe` (N,) are indices, `offset` (N,) is the mean distance (m) of the `count` points from the face,
    along its normal, and `place` (N, 2) their mean in plan view.
    """

    face: Ints
    keyframe: Ints
    offset: Floats
    count: Ints
    place: Floats


def faces_of(plan: SceneGraph) -> Faces:
    """The faces of full height of the walls of a plan. Those of one straight wall move together, as a wall is built
    elsewhere as a whole."""
    level = {floor.id: floor.elevation or 0.0 for floor in plan.floors}
    pieces, heights = list[WallSurface](), list[tuple[float, float]]()
    for surface in plan.wall_surfaces:
        half, below = 0.5 * (surface.length or 0.0), level.get(surface.floor or "", 0.0)
        (nx, ny), (x, y) = surface.normal, surface.centroid
        for source, first, last, is_whole in surface.parts or ((surface.source, -half, half, True),):
            if is_whole and last - first > 2 * _EDGE:
                middle = (first + last) / 2
                place = (x - ny * middle, y + nx * middle)
                pieces.append(replace(surface, source=source, centroid=place, length=last - first))
                heights.append(surface.height or (below, below + WALL_HEIGHT))
    wall, sign = straight_walls(pieces)
    drawn = Segments.of(pieces)
    names = wall_names(plan.wall_surfaces)
    columns = wall, sign, drawn.centre, drawn.normal, drawn.half, np.array(heights).reshape(-1, 2)
    return Faces(*columns, tuple(own.id for own in pieces), tuple(names[own.id] for own in pieces))


def wall_points(faces: Faces, clouds: Iterable[tuple[Floats, NDArray[np.float32]]]) -> WallPoints:
    """The points of all keyframes, as pairs of T_plan_sensor (4, 4) and points (N, 3) in the sensor frame, at the
    distance from each face at which most points lie."""
    # in single precision, so from a round place nearby: a site may lie hundreds of kilometres from zero
    near = np.round(faces.centre.mean(axis=0), -3) if len(faces.wall) else np.zeros(2)
    parts = [_near_faces(faces, T, points, k, near) for k, (T, points) in enumerate(clouds)]
    rows = np.concatenate([part for part in parts if len(part)] or [np.empty((0, 5), np.float32)])
    found = list[Floats]()
    order = np.argsort(rows[:, 0], kind="stable")
    for own in np.split(order, np.flatnonzero(np.diff(rows[order, 0])) + 1):
        if len(own):
            found += _means(rows[own].astype(np.float64))
    table = np.array(found).reshape(-1, 6)
    whole = table[:, [0, 1, 5]].astype(np.int64)
    return WallPoints(whole[:, 0], whole[:, 1], table[:, 2], whole[:, 2], table[:, 3:5] + near)


def _near_faces(
    faces: Faces, T_plan_sensor: Floats, points: NDArray[np.float32], number: int, origin: Floats
) -> NDArray[np.float32]:
    """(K, 5) of the points near a face: its number, that of the keyframe, the distance from the face, and x and y from
    `origin` (2,)."""
    sensor = T_plan_sensor[:3, 3]
    ahead = np.sum((sensor[:2] - faces.centre) * faces.normal, axis=1)
    own = np.flatnonzero((ahead > 0) & (ahead < SENSOR.furthest))
    seen = transform_points(T_plan_sensor, points)
    away = seen[:, :2] - sensor[:2]
    length = np.linalg.norm(seen - sensor, axis=1)
    near = length < SENSOR.furthest
    seen, away, length = seen[near], away[near], length[near]
    found = []
    for face in own.tolist():
        n, to = faces.normal[face], seen[:, :2] - faces.centre[face]
        off, along, (low, high) = to @ n, to @ np.array([-n[1], n[0]]), faces.heights[face]
        near = (np.abs(off) < SENSOR.apart) & (np.abs(along) < faces.half[face] - _EDGE)
        near &= (seen[:, 2] > low + _EDGE) & (seen[:, 2] < high - _EDGE) & (-(away @ n) > SENSOR.least_cosine * length)
        count = int(near.sum())
        if count:
            same = np.tile([face, number], (count, 1))
            found.append(np.column_stack([same, off[near], seen[near, :2] - origin]).astype(np.float32))
    return np.concatenate(found or [np.empty((0, 5), np.float32)])


def _means(rows: Floats) -> list[Floats]:
    """The means in each keyframe of what was seen of one face, (K, 5) as from `_near_faces`, with their counts."""
    shift = _most(rows[:, 2])
    rows = rows[np.abs(rows[:, 2] - shift) < 3 * SENSOR.range_noise]
    found = []
    for own in np.split(rows, np.flatnonzero(np.diff(rows[:, 1])) + 1):
        if len(own) >= _LEAST_POINTS:
            found.append(np.array([*own.mean(axis=0), len(own)]))
    return found


def _most(offset: Floats) -> float:
    """The distance near which most points lie."""
    edges = np.arange(-SENSOR.apart, SENSOR.apart + _BIN / 2, _BIN)
    counts, _ = np.histogram(offset, edges)
    reach = np.arange(-3 * SENSOR.range_noise, 3 * SENSOR.range_noise + _BIN / 2, _BIN)
    near = np.convolve(counts, np.exp(-0.5 * (reach / SENSOR.range_noise) ** 2), "same")
    return float(edges[np.argmax(near)] + _BIN / 2)
