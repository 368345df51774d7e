"""The planned walls where the map has them too: one may walk, and look, where a planned wall was not built.

In a sound map at its place, these walls are opaque. In one that is warped, or in which two places are mapped as one,
scans look through the walls that others saw, for metres. A sliding door that is a wall in the plan is a narrow gap.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from data import SceneGraph
from data.scene_graph import WallSurface
from sgslam.anchoring import AlignedWall, WallAlignment
from sgslam.mapping import Floors, KeyframeClouds, WallMap
from sgslam.mapping.scene import STEP

Floats = NDArray[np.float64]
_KEYFRAMES, _RAYS = 80, 150  # that are looked at, evenly spaced
_BEYOND = 0.4  # m beyond a wall from which on a ray leads through it
_NEAR = 0.3  # m from the sensor within which a wall tells nothing: it may stand in a door
_STRETCH = 0.3  # m, in which walls are judged
_SEVERAL = 3  # rays through a stretch, for it to be looked through
_DOOR = 0.8  # m from the middle of a planned door, up to which the way leads through it
Part = tuple[str, float, float, bool]  # as in `WallSurface.parts`


def standing_walls(
    plan: SceneGraph, alignments: dict[int, WallAlignment], floors: Floors, origin: Floats
) -> SceneGraph:
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


def walls_crossed(way: Floats, a_graph: SceneGraph) -> Floats:
    """(N, 2) where a way (M, 3) in the BIM frame leads through planned walls, elsewhere than at doors and openings."""
    crossings = []
    for storey, own in _by_storey(way, a_graph):
        solid = [line for wall in a_graph.wall_surfaces if wall.floor == storey for line in _solid(wall)]
        doors = shapely.MultiPoint([door.centroid for door in a_graph.doors])
        steps = shapely.linestrings(np.stack([own[:-1, :2], own[1:, :2]], axis=1))
        for k in np.unique(shapely.STRtree(solid).query(steps, predicate="intersects")[0]):
            if not shapely.dwithin(doors, shapely.Point(own[k, :2]), _DOOR):  # False of a plan without doors
                crossings.append(own[k, :2])
    return np.reshape(crossings, (-1, 2))


def share_looked_through(poses: Floats, keyframes: list[int], clouds: KeyframeClouds, standing: SceneGraph) -> float:
    """The share of the length of `standing` walls through which rays of keyframes, at T_bim_sensor `poses` (K, 4, 4),
    lead."""
    lines: dict[str | None, list[Floats]] = {}
    for wall in standing.wall_surfaces:
        own = [_segment(wall, a, b) for _, a, b, whole in wall.parts if whole and a < b]
        lines.setdefault(wall.floor, []).extend(own)
    trees = {floor: shapely.STRtree(shapely.linestrings(np.stack(own))) for floor, own in lines.items() if own}
    through: dict[tuple[str | None, int, int], int] = {}
    elevations, storeys = _storeys(standing)
    for k in np.unique(np.linspace(0, len(poses) - 1, min(len(poses), _KEYFRAMES)).astype(int)).tolist():
        points, T = clouds[keyframes[k]], poses[k]
        floor = storeys[max(int(np.searchsorted(elevations, T[2, 3], side="right")) - 1, 0)]
        if not len(points) or floor not in trees:
            continue
        rays = (points[:: -(-len(points) // _RAYS)] @ T[:3, :3].T)[:, :2]
        length = np.hypot(*rays.T)
        rays, length = rays[length > _NEAR + _BEYOND], length[length > _NEAR + _BEYOND]
        begin, end = (T[:2, 3] + rays * (at / length)[:, None] for at in (np.full(len(rays), _NEAR), length - _BEYOND))
        segments = shapely.linestrings(np.stack([begin, end], axis=1))
        i, j = trees[floor].query(segments, predicate="intersects")
        walls = trees[floor].geometries[j]
        at = shapely.line_locate_point(walls, shapely.centroid(shapely.intersection(segments[i], walls)))
        for line, step in zip(j.tolist(), (at // _STRETCH).astype(int).tolist(), strict=True):
            through[floor, line, step] = through.get((floor, line, step), 0) + 1
    stretches = sum(int(shapely.length(line) // _STRETCH) + 1 for tree in trees.values() for line in tree.geometries)
    return sum(count >= _SEVERAL for count in through.values()) / max(stretches, 1)


def _by_storey(way: Floats, a_graph: SceneGraph) -> Iterator[tuple[str | None, Floats]]:
    """The pieces of a way (N, 3) on each storey: that whose floor is next below."""
    elevations, storeys = _storeys(a_graph)
    level = np.searchsorted(elevations, way[:, 2], side="right") - 1
    for piece in np.split(np.arange(len(way)), np.flatnonzero(np.diff(level)) + 1):
        if len(piece) > 1:
            yield storeys[max(int(level[piece[0]]), 0)], way[piece]


def _storeys(graph: SceneGraph) -> tuple[Floats, list[str | None]]:
    """The elevations (N,) of the storeys, ascending, and their ids; one without a name where no elevation is known."""
    floors = sorted((f.elevation, f.id) for f in graph.floors if f.elevation is not None)
    return np.array([elevation for elevation, _ in floors]), [name for _, name in floors] or [None]


def _solid(wall: WallSurface) -> list[shapely.LineString]:
    """The footprints (lines) of what stands along a planned surface, without its openings."""
    if not wall.parts:
        return [] if wall.length is None else [shapely.LineString(wall.ends())]
    return [shapely.LineString(_segment(wall, a, b)) for _, a, b, _ in wall.parts if a != b]


def _segment(wall: WallSurface, a: float, b: float) -> Floats:
    """(2, 2) the places at `a` and `b` (m) along a surface from its middle."""
    centre, left = np.array(wall.centroid), np.array([-wall.normal[1], wall.normal[0]])
    return np.stack([centre + a * left, centre + b * left])
