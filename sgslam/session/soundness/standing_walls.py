"""The planned walls where the map has them too: one may walk where a planned wall was not built."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.anchoring import AlignedWall, WallAlignment
from sgslam.mapping import Floors, WallMap

Floats = NDArray[np.float64]
STEP = 0.1  # m along a wall
Part = tuple[str, float, float, bool]  # as in `WallSurface.parts`


def standing_walls(
    plan: SceneGraph, alignments: dict[int, WallAlignment], floors: Floors, origin: Floats
) -> SceneGraph:  # fmt: skip
    """The plan with those stretches of its walls at which mapped ones were seen that agree with it.

    `alignments` are by floor number, `origin` (3,) is that of the local frame in the BIM frame.
    """
    standing: dict[str, list[Part]] = {}
    for floor in floors.maps:
        alignment, scene = alignments.get(floor.number), floor.scene
        if alignment is None or scene is None:
            continue
        covered = floor.walls.coverage(STEP)
        for aligned in (own for own in alignment.walls if own.agrees):
            wall, planned = scene.wall_of_surface[aligned.surface.id], aligned.planned
            middle = np.subtract(planned.centroid, origin[:2])
            seen = along_planned(aligned, covered[wall], floor.walls, wall, alignment.place, middle)
            half = 0.5 * (planned.length or 0.0)
            own = planned.parts or ((planned.source, -half, half, True),)
            standing.setdefault(planned.id, []).extend(seen_parts(own, seen))
    walls = [w for w in plan.wall_surfaces if standing.get(w.id)]
    return replace(plan, wall_surfaces=tuple(replace(w, parts=tuple(standing[w.id])) for w in walls))


def along_planned(
    aligned: AlignedWall, covered: Floats, walls: WallMap, wall: int, place: Floats, centre: Floats
) -> Floats:
    """The places (N,) at which a surface was seen, in metres along the planned surface.

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
    return np.asarray(covered[(covered > first) & (covered < last)] + shift)


def seen_parts(parts: tuple[Part, ...], seen: Floats) -> list[Part]:
    """What of the parts lies where the wall was `seen` (N,), in places `STEP` apart."""
    if not len(seen):
        return []
    places = np.sort(seen)
    stretches = np.split(places, np.flatnonzero(np.diff(places) > 1.5 * STEP) + 1)
    found = []
    for source, low, high, is_whole in parts:
        for stretch in stretches:
            first, last = max(low, float(stretch[0]) - STEP / 2), min(high, float(stretch[-1]) + STEP / 2)
            if first < last:
                found.append((source, first, last, is_whole))
    return found
