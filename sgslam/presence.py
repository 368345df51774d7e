"""Walls of the plan that are not there, because one sees through them; and walls that stand there unplanned."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, WallSurface
from sgslam.frames import transform_points
from sgslam.holding import Holding
from sgslam.keyframes import KeyframeNode
from sgslam.position import WallArrays
from sgslam.scene import Scene
from sgslam.wall_map import WallMap

Floats = NDArray[np.float64]
_STEP = 0.1  # m between the places of a wall that are looked at
_DOOR = 0.75  # m around a door's middle; one looks through there anyway
_BEHIND = 0.5  # m; what is seen so far behind a wall is seen through it
_BLOCKED = 0.35  # m around a planned wall; what ends there may be the wall
_REACH = 10.0  # m at which single columns still tell
_GRAZING = 0.3  # sine of the angle at which a wall is looked at, at the least
_LOOKS = 3  # keyframes that must agree
_LEAST_OPEN = 1.2, 0.6  # m, and share of a wall's length, that must be seen through
_LEAST_EXTRA = 1.2  # m
_NO_FURNITURE = 2.0  # m above the floor; cupboards end below
_PARALLEL = 0.35  # rad; pieces of a niche are seen askew
_NEAR_PLANNED = 0.8  # m; before a planned wall this near stand cupboards


def absent(
    floor: SceneGraph, standing: set[str], keyframes: list[KeyframeNode], T_level_map: Floats, place: Floats,
    origin: Floats,
) -> list[dict[str, Any]]:  # fmt: skip
    """The entries of deviations.json of a storey's wall surfaces through which most of their length was looked.

    `standing` are the ids of those that are known to stand; `place` (3,) is the levelled map's in the local frame,
    which is the BIM's moved by -`origin` (2,). A place of a wall is open where at least three keyframes have seen
    something well behind it, through it, and more than have seen something at it. Doors are left out.
    """
    asked = [w for w in floor.wall_surfaces if w.id not in standing and (w.length or 0.0) >= _LEAST_OPEN[0]]
    if not asked:
        return []
    per_wall = [_places(wall, origin) for wall in asked]
    places = np.concatenate(per_wall)
    owner = np.repeat(np.arange(len(asked)), [len(p) for p in per_wall])
    normals = np.array([w.normal for w in asked])[owner]
    looks = np.zeros((2, len(places)), dtype=np.int64)
    for sensor, outline in _outlines(keyframes, T_level_map, place):
        looks += _looked(sensor, outline, places, normals)
    doors = np.array([d.centroid for d in floor.doors]).reshape(-1, 2) - origin
    solid = ~np.any(np.linalg.norm(places[:, None] - doors, axis=2) < _DOOR, axis=1)
    through = solid & (looks[0] >= _LOOKS) & (looks[0] > 2 * looks[1])
    length, open_ = (np.bincount(owner, what, len(asked)) * _STEP for what in (solid, through))
    gone = open_ >= np.maximum(_LEAST_OPEN[0], _LEAST_OPEN[1] * length)
    return [
        {
            "s_id": None, "a_id": wall.id, "source": wall.source, "kind": "absent", "offset_m": None,
            "tilt_rad": None, "sigma_m": None, "significant": True,
        }
        for wall, is_gone in zip(asked, gone.tolist(), strict=True) if is_gone
    ]  # fmt: skip


def extra(
    scene: Scene, walls: WallMap, floor: SceneGraph, holding: Holding, origin: Floats
) -> list[dict[str, Any]]:
    """The entries of deviations.json of seen wall surfaces where the plan has none.

    A long surface that is seen higher than cupboards are, from three keyframes or more, with no planned wall along
    it that it could be, or that it could be furniture of.
    """
    held = {h.surface.id for h in holding.walls}
    surfaces = list(scene.graph.wall_surfaces)
    s = WallArrays.of(surfaces, {}, np.zeros(2)).moved(holding.place)
    a = WallArrays.of(list(floor.wall_surfaces), {}, origin)
    heights, count = walls.heights(), walls.counts()
    found = []
    for i, surface in enumerate(surfaces):
        wall = scene.wall_of_surface[surface.id]
        if surface.id in held or 2 * s.half[i] < _LEAST_EXTRA or count[wall] < _LOOKS:
            continue
        if heights[wall][1] < _NO_FURNITURE or _planned_near(s, i, a):
            continue
        found.append({
            "s_id": surface.id, "a_id": None, "source": "", "kind": "extra", "offset_m": None, "tilt_rad": None,
            "sigma_m": None, "significant": True,
        })  # fmt: skip
    return found


def _outlines(
    keyframes: list[KeyframeNode], T_level_map: Floats, place: Floats
) -> Iterator[tuple[Floats, Floats]]:
    """Where the keyframes stood (2,), and their outlines (M, 2), in the plan's local frame."""
    c, s = np.cos(place[0]), np.sin(place[0])
    R = np.array([[c, -s], [s, c]])
    for keyframe in keyframes:
        T = T_level_map @ keyframe.T_map_sensor
        if len(keyframe.outline):
            yield R @ T[:2, 3] + place[1:], transform_points(T, keyframe.outline)[:, :2] @ R.T + place[1:]


def _looked(sensor: Floats, outline: Floats, places: Floats, normals: Floats) -> NDArray[np.int64]:
    """(2, N) whether one keyframe looked through walls at `places` (N, 2), and whether it saw something at them."""
    looks = np.zeros((2, len(places)), dtype=np.int64)
    away = sensor - places
    distance = np.hypot(away[:, 0], away[:, 1])
    ahead = np.sum(away * normals, axis=1)
    near = np.flatnonzero((distance < _REACH) & (ahead > _GRAZING * distance))
    if len(near):
        sine = ahead[near] / distance[near]
        beyond = (_range_towards(sensor, outline, places[near]) - distance[near]) * sine  # across the wall
        looks[:, near] = beyond > _BEHIND, np.abs(beyond) < _BLOCKED
    return looks


def _places(wall: WallSurface, origin: Floats) -> Floats:
    """(N, 2) places along a wall, its ends left out."""
    first, last = (np.array(end) - origin for end in wall.ends())
    count = max(int(np.linalg.norm(last - first) / _STEP), 2)
    share = (np.arange(1, count) / count)[:, None]
    return np.asarray(first + share * (last - first))


def _range_towards(sensor: Floats, outline: Floats, places: Floats) -> Floats:
    """(N,) how far one sees from a sensor in the directions of places; nan where no column of the scan is near."""
    away, to = outline - sensor, places - sensor
    bearing = np.arctan2(away[:, 1], away[:, 0])
    order = np.argsort(bearing, kind="stable")
    bearing, distance = bearing[order], np.hypot(away[:, 0], away[:, 1])[order]
    asked = np.arctan2(to[:, 1], to[:, 0])
    after = np.searchsorted(bearing, asked) % len(bearing)
    gaps = [np.abs((bearing[k] - asked + np.pi) % (2 * np.pi) - np.pi) for k in (after, after - 1)]
    nearest = np.where(gaps[0] < gaps[1], after, after - 1)
    return np.where(np.minimum(*gaps) < np.radians(1.0), distance[nearest], np.nan)


def _planned_near(s: WallArrays, i: int, a: WallArrays) -> bool:
    """Whether a planned wall of either side lies along a seen one, near enough to be meant or to have it before it."""
    parallel = np.abs(a.normal @ s.normal[i]) > np.cos(_PARALLEL)
    away = s.centre[i] - a.centre
    across = np.abs(np.sum(away * a.normal, axis=1))
    along = np.abs(away[:, 1] * a.normal[:, 0] - away[:, 0] * a.normal[:, 1])
    beside = along < a.half + 0.5 * s.half[i]
    return bool(np.any(parallel & (across < _NEAR_PLANNED) & beside))

