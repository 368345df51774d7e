"""Filled openings: walls in the plane of a planned one where the plan has an opening, or far beyond its ends."""

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import Xy
from sgslam.anchoring import AlignedWall, WallAlignment
from sgslam.as_built.deviation_entries import ExtraDeviation
from sgslam.as_built.deviations import STEP, along_planned
from sgslam.as_built.wall_solids import Side
from sgslam.config import Config
from sgslam.mapping import Scene, WallMap

Floats = NDArray[np.float64]
_LEAST = 1.0  # m in one stretch without margins; closed doors are narrower
_LEAST_BEYOND = 1.2  # m in one stretch beyond a planned wall's end, where rooms may be divided differently
_DOOR = 0.75  # m around a door's middle
_DOOR_IN_PLANE = 0.4  # m from it to the surface of its wall; others are doors of walls across
_MARGIN = 0.1  # m beside a planned wall's end
_IN_PLANE = 0.12  # m; mapped surfaces may join faces that are a step apart


def filled_openings(
    sides: list[Side],
    doors: Floats,
    alignment: WallAlignment,
    scene: Scene,
    walls: WallMap,
    origin: Floats,
    config: Config,
) -> list[ExtraDeviation]:
    """The entries of deviations.json, as extra walls, of filled openings.

    These are surfaces that stand as planned and continue through an opening of the planned one, or far beyond its end.
    `doors` (K, 2) are in the BIM frame; `origin` (2,) is the local frame's origin in it. Planned walls without known
    openings are skipped.
    """
    covered = walls.coverage(STEP)
    found: list[ExtraDeviation] = []
    for aligned in alignment.walls:
        if not aligned.planned.parts or abs(aligned.offset) > max(config.anchors.tolerance, config.as_built.tolerance):
            continue
        wall = scene.wall_of_surface[aligned.surface.id]
        middle = np.subtract(aligned.planned.centroid, origin)
        seen, _ = along_planned(aligned, covered[wall], walls, wall, alignment.place, middle)
        free = ~_beside_planned(aligned, seen, sides) & ~_at_door(aligned, seen, doors)
        inside = np.abs(seen) < 0.5 * (aligned.planned.length or 0.0)
        within, beyond = _longest(seen[free & inside]), _longest(seen[free & ~inside])
        fills = _length(within) >= _LEAST
        if fills or _length(beyond) >= _LEAST_BEYOND:
            where = "where the plan has an opening in its wall" if fills else "beyond the end of its wall"
            stretch = within if fills else beyond
            found.append({
                "s_id": aligned.surface.id, "a_id": None, "source": "", "kind": "extra",
                "trace": _trace(aligned, stretch), "offset_m": None, "tilt_rad": None, "sigma_m": None,
                "significant": True, "reason": f"{_length(stretch):.1f} m of it stand {where}",
            })  # fmt: skip
    return found


def _trace(aligned: AlignedWall, stretch: Floats) -> tuple[Xy, Xy]:
    """The ends in the BIM frame of places (N,) along the planned surface, the left one first."""
    n = np.array(aligned.planned.normal)
    face = np.array(aligned.planned.centroid) + aligned.offset * n
    tangent = np.array([-n[1], n[0]])
    low, high = stretch.min() - STEP / 2, stretch.max() + STEP / 2
    (ax, ay), (bx, by) = (face + high * tangent).tolist(), (face + low * tangent).tolist()
    return (ax, ay), (bx, by)


def _beside_planned(aligned: AlignedWall, seen: Floats, sides: list[Side]) -> NDArray[np.bool_]:
    """(N,) flags of the places (N,) along the planned surface at which some planned wall stands in its plane."""
    n, centre = np.array(aligned.planned.normal), np.array(aligned.planned.centroid)
    tangent = np.array([-n[1], n[0]])
    beside = np.zeros(len(seen), dtype=bool)
    for surface in {side.surface.id: side.surface for side in sides}.values():
        away = np.subtract(surface.centroid, centre)
        if n @ surface.normal < 0.99 or abs(away @ n) > _IN_PLANE:
            continue
        half = 0.5 * (surface.length or 0.0)
        for _, low, high, _ in surface.parts or (("", -half, half, True),):
            shift = float(away @ tangent)
            beside |= (seen > low + shift - _MARGIN) & (seen < high + shift + _MARGIN)
    return beside


def _at_door(aligned: AlignedWall, seen: Floats, doors: Floats) -> NDArray[np.bool_]:
    """(N,) flags of the places (N,) along the planned surface at which a door of its plane is; `doors` (K, 2)."""
    n = np.array(aligned.planned.normal)
    away = doors - aligned.planned.centroid
    along = (away @ np.array([-n[1], n[0]]))[np.abs(away @ n) < _DOOR_IN_PLANE]
    return np.asarray((np.abs(seen[:, None] - along) < _DOOR).any(axis=1))


def _longest(places: Floats) -> Floats:
    """(M,) the longest stretch of places (N,) that are one step apart."""
    places = np.sort(places)
    return max(np.split(places, np.flatnonzero(np.diff(places) > 1.5 * STEP) + 1), key=len)


def _length(stretch: Floats) -> float:
    return STEP * len(stretch)
