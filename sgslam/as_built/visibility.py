"""Visibility of planned walls: where they were seen through, and where something was seen at them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.as_built.wall_solids import Key, Side
from sgslam.geometry.frames import transform_points
from sgslam.mapping import KeyframeNode

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
STEP = 0.1  # m between the sampled places of a wall
_LEAST_LENGTH = 0.5  # m of a wall that is tested
_DOOR = 0.75  # m around a door's centre that are left out
_FRAME = 0.5  # m that are left out where the plan gives the extent of the wall beside its doors
_BEHIND = 0.6  # m behind a wall from which on a range went through it; panes in niches of moved walls are nearer
_BLOCKED = 0.35  # m around a planned wall; a range that ends there may have hit the wall
_REACH = 10.0  # m up to which single columns are used
_GRAZING = 0.3  # least sine of the viewing angle
MIN_KEYFRAMES = 3  # keyframes that must agree


@dataclass(frozen=True)
class Visibility:
    """Visibility of N places along a side of a wall, doors left out.

    `along` (N,) are metres as the spans in `Side`; `through` (N,) flags places that are seen through, `at` (N,) places
    where something stands.
    """

    along: Floats
    through: Flags
    at: Flags

    @property
    def length(self) -> float:
        """Length (m) outside doors."""
        return STEP * len(self.along)

    @property
    def open(self) -> float:
        """Length (m) that is seen through."""
        return STEP * float(self.through.sum())

    @property
    def longest_opening(self) -> float:
        """The longest contiguous stretch (m) that is seen through."""
        if not self.through.any():
            return 0.0
        where = np.sort(self.along[self.through])
        stretches = np.split(where, np.flatnonzero(np.diff(where) > 1.5 * STEP) + 1)
        return max(STEP * len(stretch) for stretch in stretches)


def wall_visibility(
    floor: SceneGraph, sides: list[Side], keyframes: list[KeyframeNode], T_level_map: Floats, place: Floats,
    origin: Floats,
) -> dict[Key, Visibility]:  # fmt: skip
    """The visibility of the sides of a storey's walls, the shortest left out.

    `place` (3,) is that of the levelled map in the local frame, which is the BIM frame moved by -`origin` (2,). A place
    is seen through where at least three keyframes saw something well behind it, and twice as many as saw something at
    it.
    """
    asked = [side for side in sides if sum(high - low for low, high in side.spans) >= _LEAST_LENGTH]
    if not asked:
        return {}
    doors = np.array([d.centroid for d in floor.doors]).reshape(-1, 2)
    alongs = [_places(side, doors) for side in asked]
    owner = np.repeat(np.arange(len(asked)), [len(along) for along in alongs])
    along = np.concatenate(alongs)
    normals = np.array([side.surface.normal for side in asked])[owner]
    middles = np.array([side.surface.centroid for side in asked])[owner] - origin
    places = middles + along[:, None] * np.column_stack([-normals[:, 1], normals[:, 0]])
    looks = np.zeros((2, len(places)), dtype=np.int64)
    for sensor, outline in _outlines(keyframes, T_level_map, place):
        looks += _observed(sensor, outline, places, normals)
    through, at = (looks[0] >= MIN_KEYFRAMES) & (looks[0] > 2 * looks[1]), looks[1] >= MIN_KEYFRAMES
    mine = [np.flatnonzero(owner == k) for k in range(len(asked))]
    return {s.key: Visibility(along[i], through[i], at[i] & ~through[i]) for s, i in zip(asked, mine, strict=True)}


def _outlines(keyframes: list[KeyframeNode], T_level_map: Floats, place: Floats) -> Iterator[tuple[Floats, Floats]]:
    """The position (2,) and outline (M, 2) of each keyframe in the local frame."""
    c, s = np.cos(place[0]), np.sin(place[0])
    R = np.array([[c, -s], [s, c]])
    for keyframe in keyframes:
        T = T_level_map @ keyframe.T_map_sensor
        if len(keyframe.outline):
            yield R @ T[:2, 3] + place[1:], transform_points(T, keyframe.outline)[:, :2] @ R.T + place[1:]


def _observed(sensor: Floats, outline: Floats, places: Floats, normals: Floats) -> NDArray[np.int64]:
    """(2, N) whether one keyframe saw through walls at `places` (N, 2), and whether it saw something at them."""
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


def _places(side: Side, doors: Floats) -> Floats:
    """(N,) places (m) along a side, without its ends and doors (K, 2)."""
    along = np.concatenate([
        low + (high - low) * np.arange(1, count) / count
        for low, high in side.spans for count in [max(int((high - low) / STEP), 1)]
    ])  # fmt: skip
    n = np.array(side.surface.normal)
    places = side.surface.centroid + along[:, None] * np.array([-n[1], n[0]])
    clear = np.linalg.norm(places[:, None] - doors, axis=2) > (_FRAME if side.surface.parts else _DOOR)
    return np.asarray(along[clear.all(axis=1)])


def _range_towards(sensor: Floats, outline: Floats, places: Floats) -> Floats:
    """(N,) ranges (m) from a sensor in the directions of places; NaN where no column of the scan is near."""
    away, to = outline - sensor, places - sensor
    wall_status = np.arctan2(away[:, 1], away[:, 0])
    order = np.argsort(wall_status, kind="stable")
    wall_status, distance = wall_status[order], np.hypot(away[:, 0], away[:, 1])[order]
    asked = np.arctan2(to[:, 1], to[:, 0])
    after = np.searchsorted(wall_status, asked) % len(wall_status)
    gaps = [np.abs((wall_status[k] - asked + np.pi) % (2 * np.pi) - np.pi) for k in (after, after - 1)]
    nearest = np.where(gaps[0] < gaps[1], after, after - 1)
    return np.where(np.minimum(*gaps) < np.radians(1.0), distance[nearest], np.nan)
