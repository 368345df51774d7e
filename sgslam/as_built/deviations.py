"""Measures how far each aligned wall is from its place in the plan, with the standard deviation."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.anchoring import AlignedWall, WallAlignment
from sgslam.as_built.wall_solids import Key, Side, sides_of
from sgslam.backend import Uncertainty
from sgslam.config import Config
from sgslam.mapping import Scene, WallMap

Floats = NDArray[np.float64]
_HEIGHT = 1.2  # m above the storey's floor, where offsets are measured
STEP = 0.1  # m along a wall
_LEAST_PART = 0.3  # m of a second wall in the same plane for a piece of its own
_BESIDE = 0.3  # m beyond a wall's ends that still count as it
_OVER_PARAPET = 0.6  # m above the floor; a surface never seen lower is a pane over a parapet
_SHORT = 1.0, 0.02  # m and rad; a piece that is shorter and turned more is poorly observed


@dataclass(frozen=True)
class Piece:
    """The part of an aligned wall surface that belongs to the planned wall `source`.

    `offset` (m) is along the planned inward normal, with standard deviation `sigma` (m), the wall's own anchor left
    out. `tilt` (rad) is in plan view. `span` (m) is its extent along the planned surface, as in `Side`, and `length`
    (m) how much of that was seen. `over_parapet`: it was never seen close to the floor.
    """

    aligned: AlignedWall
    source: str
    offset: float
    sigma: float
    tilt: float
    span: tuple[float, float]
    length: float
    over_parapet: bool

    @property
    def key(self) -> Key:
        """The side of the planned wall."""
        return self.aligned.planned.id, self.source

    @property
    def doubtful(self) -> bool:
        """Whether it is too short and too tilted to be distinguished from what stands beside it."""
        return self.length < _SHORT[0] and abs(self.tilt) > _SHORT[1]


def measured_pieces(
    alignment: WallAlignment,
    scene: Scene,
    walls: WallMap,
    uncertainty: Uncertainty,
    origin: Floats,
    height: float,
    config: Config,
) -> list[Piece]:
    """Measures each aligned wall in the final graph.

    The sigma combines the graph's covariance of the wall in the BIM frame, the scatter of its observations, and the
    bias of the extraction. `origin` (3,) is the local frame's origin in the BIM frame, `height` (m) the storey's floor
    in the local frame.
    """
    scatter, lows, covered = walls.scatter(), walls.lower_ends(), walls.coverage(STEP)
    anchors = Counter(scene.wall_of_surface[aligned.surface.id] for aligned in alignment.walls)
    pieces = []
    for aligned in alignment.walls:
        if not uncertainty.knows(scene.wall_of_surface[aligned.surface.id]):
            continue
        wall, normal = scene.wall_of_surface[aligned.surface.id], np.array([*aligned.planned.normal, 0.0])
        centre = np.array([*aligned.planned.centroid, 0.0]) - origin
        point = np.array([*_along(aligned, alignment.place, centre), height + _HEIGHT])
        offset, variance = uncertainty.wall_offset(wall, np.array([*normal[:3], -normal @ centre]), point)
        offset, variance = _without_anchor(offset, variance, anchors[wall], config)
        sigma = float(np.sqrt(variance + scatter.get(wall, 0.0) ** 2 + config.anchors.sigma_extraction**2))
        over_parapet = lows.get(wall, 0.0) > _OVER_PARAPET
        seen, whole = along_planned(aligned, covered[wall], walls, wall, alignment.place, centre)
        pieces += [
            Piece(aligned, source, offset, sigma, _tilt(aligned, alignment.place), span, length, over_parapet)
            for source, span, length in _by_source(sides_of(aligned.planned), seen, whole)
        ]
    return pieces


def _without_anchor(offset: float, variance: float, anchors: int, config: Config) -> tuple[float, float]:
    """The offset and variance without the wall's own anchors, which assume that it stands as planned."""
    settings = config.anchors
    information = 1 / max(variance, 1e-12)
    weight = anchors / settings.sigma_offset**2
    weight /= (1 + (offset / (settings.sigma_offset * settings.redescending)) ** 2) ** 2
    left = max(information - weight, 0.1 * information)
    return offset * information / left, 1 / left


def _along(aligned: AlignedWall, place: Floats, centre: Floats) -> Floats:
    """(2,) the point of the planned wall nearest to the centre of the mapped one, local frame."""
    c, s = np.cos(place[0]), np.sin(place[0])
    x, y = aligned.surface.centroid
    seen = np.array([c * x - s * y, s * x + c * y]) + place[1:]
    n = np.array(aligned.planned.normal)
    return np.asarray(seen - ((seen - centre[:2]) @ n) * n)


def _tilt(aligned: AlignedWall, place: Floats) -> float:
    (x, y), (nx, ny) = aligned.surface.normal, aligned.planned.normal
    turn = np.arctan2(y, x) + place[0] - np.arctan2(ny, nx)
    return float((turn + np.pi) % (2 * np.pi) - np.pi)


def along_planned(
    aligned: AlignedWall, covered: Floats, walls: WallMap, wall: int, place: Floats, centre: Floats
) -> tuple[Floats, tuple[float, float]]:
    """The places (N,) at which a surface was seen and its ends, both in metres along the planned surface.

    `centre` is that of the planned surface in the local frame. `covered` are the places of the whole wall along its own
    tangent.
    """
    n = walls.normal_in_level(wall)
    tangent = np.array([-n[1], n[0]])
    ends = np.array(aligned.surface.ends())
    first, last = np.sort(ends @ tangent)
    c, s = np.cos(place[0]), np.sin(place[0])
    planned = np.array([-aligned.planned.normal[1], aligned.planned.normal[0]])
    ends_along = (ends @ np.array([[c, s], [-s, c]]) + place[1:] - centre[:2]) @ planned
    shift = float(ends_along.mean() - (first + last) / 2)  # both tangents point the same way, to a few degrees
    seen = covered[(covered > first) & (covered < last)] + shift
    return seen, (float(ends_along.min()), float(ends_along.max()))


def _by_source(
    sides: list[Side], seen: Floats, whole: tuple[float, float]
) -> list[tuple[str, tuple[float, float], float]]:
    """The planned walls that a mapped surface belongs to, each with its span and the length (m) seen there.

    Each place belongs to the wall whose hull is nearest, up to `_BESIDE`; parts shorter than `_LEAST_PART` are left
    out.
    """
    if len(sides) == 1 or not len(seen):
        return [(sides[0].source, whole, STEP * len(seen))]
    hulls = np.array([side.hull for side in sides])
    away = np.maximum(np.maximum(hulls[:, :1] - seen, seen - hulls[:, 1:]), 0.0)
    nearest = np.argmin(away, axis=0)
    beside = away.min(axis=0) < _BESIDE
    if beside.any():
        seen, nearest = seen[beside], nearest[beside]
    lengths = np.bincount(nearest, minlength=len(sides)) * STEP
    least = min(_LEAST_PART, float(lengths.max()))
    return [
        (sides[k].source, (float(seen[nearest == k].min()), float(seen[nearest == k].max())), float(lengths[k]))
        for k in np.flatnonzero(lengths >= least).tolist()
    ]
