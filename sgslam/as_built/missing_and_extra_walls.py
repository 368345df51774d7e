"""Missing walls: planned ones that the scans see through. Extra walls: mapped ones where the plan has none."""

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.anchoring import WallAlignment
from sgslam.anchoring.wall_association import WallArrays
from sgslam.as_built.deviation_entries import AbsentDeviation, ExtraDeviation
from sgslam.as_built.deviation_tests import OPENING, DeviationTest, in_place, longest_opening
from sgslam.as_built.deviations import Piece
from sgslam.as_built.visibility import MIN_KEYFRAMES, STEP, Visibility
from sgslam.as_built.wall_solids import Key, Side, WallSolid
from sgslam.config import Config
from sgslam.mapping import Scene, WallMap

Floats = NDArray[np.float64]
_LEAST_OPEN = 1.2, 0.6  # m and share of a surface's length that must be seen through
_MIN_IN_PLACE = 0.45  # m in place; a side of which so much stands is there
_STANDING = 0.25  # of the open length; a wall of which more stands in its place is there
_MIN_OPEN = 0.3  # m of a surface of a missing wall that are seen through, for the surface to be listed
_LEAST_EXTRA = 1.2  # m
_NO_FURNITURE = 2.0  # m above the floor; cupboards end below
_SCREEN = 1.3  # m above the floor; what is lower is no wall, however thin
_THIN = 0.25  # m between both sides of a wall; furniture is thicker
_LEAST_BACK = 1.0  # m of its other side
_MAX_TURN = 0.1  # rad between both sides of a wall
_PARALLEL = 0.35  # rad; pieces of a niche are seen at an angle
_ALONG = 0.35  # of an extra wall's length that may have planned walls along it
_NEAR_PLANNED = 0.8  # m; before a planned wall this near stand cupboards


def missing_walls(
    sides: list[Side], solids: list[WallSolid], alignment: WallAlignment, pieces: list[Piece],
    results: list[DeviationTest], visibility: dict[Key, Visibility], config: Config,
) -> list[AbsentDeviation]:  # fmt: skip
    """The entries of deviations.json of the sides of missing walls of a storey.

    A side is missing where most of its length was seen through. A whole wall is missing where hardly any of it stands
    in place on either side, none of it was moved, and a stretch of it was seen through: furniture may hide the rest.
    """
    gone = {key for key, s in visibility.items() if s.open >= max(_LEAST_OPEN[0], _LEAST_OPEN[1] * s.length)}
    gone -= {p.key for p in pieces if in_place(p, config) and p.length >= _MIN_IN_PLACE}
    for solid in solids:
        own = [(p, v) for p, v in zip(pieces, results, strict=True) if p.key in solid.facing]
        if any(v.significant for _, v in own):
            gone -= solid.facing.keys()
        elif _is_gone(solid, [p for p, _ in own], alignment, visibility, config):
            gone |= {key for key in solid.facing if key in visibility and visibility[key].open >= _MIN_OPEN}
    return [
        {
            "s_id": None, "a_id": side.surface.id, "source": side.source, "kind": "absent", "offset_m": None,
            "tilt_rad": None, "sigma_m": None, "significant": True,
            "reason": f"seen through over {visibility[side.key].open:.1f} m of {visibility[side.key].length:.1f} m",
        }
        for side in sides if side.key in gone
    ]  # fmt: skip


def _is_gone(
    solid: WallSolid, own: list[Piece], alignment: WallAlignment, visibility: dict[Key, Visibility], config: Config
) -> bool:
    """Whether a wall with no moved piece is missing."""
    if longest_opening(solid, visibility) < OPENING:
        return False
    asked = [key for key in solid.facing if key in visibility]
    open_ = sum(visibility[key].open for key in asked)
    standing = sum(p.length for p in own if in_place(p, config))
    at = sum(_unexplained(visibility[key], [p for p in own if p.key == key]) for key in asked)
    return standing < _STANDING * open_ and at <= open_


def _unexplained(visibility: Visibility, own: list[Piece]) -> float:
    """Metres at which something stands other than the pieces, which are known to be furniture."""
    at = visibility.at.copy()
    for piece in own:
        at &= (visibility.along < piece.span[0]) | (visibility.along > piece.span[1])
    return STEP * float(at.sum())


def extra_walls(
    scene: Scene, walls: WallMap, floor: SceneGraph, alignment: WallAlignment, origin: Floats
) -> list[ExtraDeviation]:
    """The entries of deviations.json of mapped wall surfaces where the plan has none.

    Such a surface is long and seen from three keyframes or more. It is taller than cupboards, or its other side is seen
    too, as thin as a wall. No planned wall lies along it that it could be, or that it could be furniture of.
    """
    aligned = {h.surface.id for h in alignment.walls}
    surfaces = list(scene.graph.wall_surfaces)
    s = WallArrays.of(surfaces, {}, np.zeros(2)).moved(alignment.place)
    a = WallArrays.of(list(floor.wall_surfaces), {}, origin)
    heights, count = walls.heights(), walls.counts()
    of = [scene.wall_of_surface[surface.id] for surface in surfaces]
    tall = np.array([heights[wall][1] > _SCREEN and count[wall] > MIN_KEYFRAMES for wall in of], dtype=bool)
    found: list[ExtraDeviation] = []
    for i, surface in enumerate(surfaces):
        wall = of[i]
        if surface.id in aligned or 2 * s.half[i] < _LEAST_EXTRA or count[wall] < MIN_KEYFRAMES:
            continue
        if _planned_near(s, i, a) or (heights[wall][1] < _NO_FURNITURE and not has_other_side(s, i, tall)):
            continue
        low, high = heights[wall]
        found.append({
            "s_id": surface.id, "a_id": None, "source": "", "kind": "extra", "offset_m": None, "tilt_rad": None,
            "sigma_m": None, "significant": True,
            "reason": f"{2 * s.half[i]:.1f} m long, seen from {low:.1f} to {high:.1f} m above the floor",
        })  # fmt: skip
    return found


def has_other_side(s: WallArrays, i: int, tall: NDArray[np.bool_]) -> bool:
    """Whether surface i is tall, and another tall one faces away behind it, at the distance of a wall's other side."""
    behind = -np.sum((s.centre - s.centre[i]) * s.normal[i], axis=1)
    t = np.array([-s.normal[i][1], s.normal[i][0]])
    beside = s.half + s.half[i] - np.abs((s.centre - s.centre[i]) @ t)
    back = (s.normal @ s.normal[i] < -np.cos(_MAX_TURN)) & (behind > 0) & (behind < _THIN)
    return bool(tall[i] and np.any(tall & back & (beside > _LEAST_BACK)))


def _planned_near(s: WallArrays, i: int, a: WallArrays) -> bool:
    """Whether planned walls lie along a good part of a mapped one, near enough to be the same or to be behind it."""
    parallel = np.abs(a.normal @ s.normal[i]) > np.cos(_PARALLEL)
    away = s.centre[i] - a.centre
    across = np.abs(np.sum(away * a.normal, axis=1))
    along = np.abs(away[:, 1] * a.normal[:, 0] - away[:, 0] * a.normal[:, 1])
    beside = np.clip(a.half + s.half[i] - along, 0.0, 2 * np.minimum(a.half, s.half[i]))
    return bool(beside[parallel & (across < _NEAR_PLANNED)].sum() > _ALONG * 2 * s.half[i])
