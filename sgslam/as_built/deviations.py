"""As built against as planned: how far each matched wall lies from its place in the plan, and how sure that is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.anchoring.wall_alignment import AlignedWall, WallAlignment
from sgslam.as_built.wall_solids import Key, Side, sides_of
from sgslam.backend.covariances import Uncertainty
from sgslam.config import Config
from sgslam.mapping.scene import Scene
from sgslam.mapping.wall_map import WallMap

Floats = NDArray[np.float64]
_HEIGHT = 1.2  # m above the storey's floor, where offsets are measured
STEP = 0.1  # m along a wall
_LEAST_PART = 0.3  # m of a wall that is seen beside another one in its plane
_BESIDE = 0.3  # m from a wall's ends
_OVER_PARAPET = 0.6  # m above the floor; what is never seen lower stands over something: a pane over its parapet
_SHORT = 1.0, 0.02  # m and rad; what is shorter and turned more than this is badly seen


@dataclass(frozen=True)
class Piece:
    """A seen wall surface at its planned one, as far as that is of the wall `source`. `offset` (m) along the planned
    inward normal, with its `sigma`, the matched wall's own anchor left out; `tilt` (rad) in plan view; `span` (m) where
    it lies along the planned surface, as in `Side`; `length` (m) how much of that was seen; `over_parapet`: never seen
    low."""

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
        """The side of the planned wall that it stands at."""
        return self.aligned.planned.id, self.source

    @property
    def doubtful(self) -> bool:
        """Whether it is too short and too skew to be told from what stands beside it."""
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
    """What the final graph says of each wall that stands at a planned one.

    The sigma is the graph's own, of the wall in the BIM frame, the scatter of its observations, and the extraction's
    floor. `origin` (3,) is where the graph's BIM frame lies in the BIM's, and `height` (m) the storey's floor in it.
    """
    scatter, lows, covered = walls.scatter(), walls.lower_ends(), walls.coverage(STEP)
    tight: dict[int, int] = {}
    for aligned in alignment.walls:
        wall = scene.wall_of_surface[aligned.surface.id]
        tight[wall] = tight.get(wall, 0) + aligned.agrees
    pieces = []
    for aligned in alignment.walls:
        if aligned.drifted or not uncertainty.knows(scene.wall_of_surface[aligned.surface.id]):
            continue
        wall, normal = scene.wall_of_surface[aligned.surface.id], np.array([*aligned.planned.normal, 0.0])
        centre = np.array([*aligned.planned.centroid, 0.0]) - origin
        point = np.array([*_along(aligned, alignment.place, centre), height + _HEIGHT])
        offset, variance = uncertainty.wall_offset(wall, np.array([*normal[:3], -normal @ centre]), point)
        offset, variance = _without_anchor(offset, variance, tight[wall] if aligned.agrees else 0, config)
        sigma = float(np.sqrt(variance + scatter.get(wall, 0.0) ** 2 + config.anchors.sigma_extraction**2))
        over_parapet = lows.get(wall, 0.0) > _OVER_PARAPET
        seen, whole = along_planned(aligned, covered[wall], walls, wall, alignment.place, centre)
        pieces += [
            Piece(aligned, source, offset, sigma, _tilt(aligned, alignment.place), span, length, over_parapet)
            for source, span, length in _by_source(sides_of(aligned.planned), seen, whole)
        ]
    return pieces


def _without_anchor(offset: float, variance: float, anchors: int, config: Config) -> tuple[float, float]:
    """The estimate before the wall's own anchors, which said that it stands as planned, were fused into it."""
    settings = config.anchors
    information = 1 / max(variance, 1e-12)
    weight = anchors / settings.sigma_offset**2
    weight /= (1 + (offset / (settings.sigma_offset * settings.redescending)) ** 2) ** 2
    left = max(information - weight, 0.1 * information)
    return offset * information / left, 1 / left


def _along(aligned: AlignedWall, place: Floats, centre: Floats) -> Floats:
    """(2,) the planned wall's point that is nearest to the middle of the seen one, local frame."""
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
    """The places at which a surface was seen, and its ends, along the planned one, whose middle is `centre` in the
    local frame. `covered` are those places of the whole wall, along its own tangent."""
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
    """Which walls a seen surface is of: each with the span, and the metres that were seen there.

    Every place is of the wall whose hull is nearest, unless that is further than `_BESIDE`; what is less than
    `_LEAST_PART` of another wall is left out.
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
