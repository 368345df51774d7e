"""Layouts like those on which the published combinatorial search was measured: grids of uneven or equal rooms."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from data import Room, SceneGraph, WallSurface
from data.geometry import se2

WALL_M, CELL_M = 0.2, 6.5


@dataclass(frozen=True)
class Noise:
    """Standard deviations of each wall's offset (m) and of its normal (degrees)."""

    metres: float = 0.03
    degrees: float = 0.5


def grid(columns: int, rows: int, side_m: float | None = None, seed: int = 0) -> SceneGraph:
    """An A-graph of rooms in columns and rows: squares with `side_m`, or rectangles of random sizes and offsets."""
    rng = np.random.default_rng(seed)
    rings = []
    for k in range(rows):
        for j in range(columns):
            pitch = CELL_M if side_m is None else side_m + WALL_M
            w, d = rng.uniform(2.5, CELL_M - WALL_M, 2).tolist() if side_m is None else (side_m, side_m)
            x, y = (rng.uniform(0, pitch - WALL_M - size) + pitch * n for size, n in ((w, j), (d, k)))
            rings.append([(x, y), (x + w, y), (x + w, y + d), (x, y + d)])
    return of_rings(rings)


def polygons(count: int, walls: int, seed: int = 0) -> SceneGraph:
    """An A-graph of `count` rooms in a row with `walls` walls each, irregular polygons on circles of 2.5 m."""
    rng = np.random.default_rng(seed)
    rings = []
    for k in range(count):
        angles = 2 * np.pi * (np.arange(walls) + rng.uniform(-0.15, 0.15, walls)) / walls
        x, y = 6.0 * k + rng.uniform(0, 0.5), rng.uniform(0, 1.0)
        rings.append([(float(x + 2.5 * np.cos(t)), float(y + 2.5 * np.sin(t))) for t in angles])
    return of_rings(rings)


def of_rings(rings: Sequence[Sequence[tuple[float, float]]]) -> SceneGraph:
    """An A-graph of one floor: rooms by their counter-clockwise rings, a wall surface for each edge."""
    rooms, walls = [], []
    for k, ring in enumerate(rings):
        points = np.array(ring)
        x, y = ((points.min(axis=0) + points.max(axis=0)) / 2).tolist()
        rooms.append(Room(f"room{k}", (x, y), polygon=tuple(ring)))
        for n, (p, q) in enumerate(zip(points, np.roll(points, -1, axis=0), strict=True)):
            length = float(np.hypot(*(q - p)))
            along, middle = ((q - p) / length).tolist(), ((p + q) / 2).tolist()
            walls.append(WallSurface(f"room{k}/{n}", f"room{k}", (middle[0], middle[1]), (-along[1], along[0]), length))
    return SceneGraph("bim", tuple(rooms), tuple(walls))


def seen(
    plan: SceneGraph,
    rooms: Sequence[int],
    seed: int = 0,
    noise: Noise | None = None,
    turned: float = 0.0,
    mirrored: bool = False,
) -> SceneGraph:
    """An S-graph of some of the rooms, with noise, rotated (rad) about the origin, or mirrored in x.

    Ids are the plan's with the prefix "s:". The centre of a room is that of its noisy walls.
    """
    noise = noise or Noise()
    rng = np.random.default_rng([seed, 1])
    flip = np.array([-1.0 if mirrored else 1.0, 1.0])
    kept = [plan.rooms[k] for k in rooms]
    walls: list[WallSurface] = []
    centre = {}
    for room in kept:
        own = plan.surfaces_of_room[room.id]
        off = rng.normal(0.0, noise.metres, len(own))
        shift = np.mean([d * np.array(w.normal) for d, w in zip(off, own, strict=True)], axis=0)
        centre[room.id] = se2.rotate(turned, flip * (np.array(room.centroid) + shift))
        for w, d in zip(own, off, strict=True):
            normal = se2.rotate(np.radians(rng.normal(0.0, noise.degrees)), np.array(w.normal))
            place = se2.rotate(turned, flip * (np.array(w.centroid) + d * np.array(w.normal)))
            facing = se2.rotate(turned, flip * normal)
            walls.append(replace(w, id=f"s:{w.id}", room=f"s:{room.id}", centroid=_xy(place), normal=_xy(facing)))
    found = tuple(Room(f"s:{r.id}", _xy(centre[r.id])) for r in kept)
    return SceneGraph("map", found, tuple(walls))


def subset(plan: SceneGraph, count: int, seed: int = 0) -> list[int]:
    """The indices of `count` random rooms of the plan."""
    rng = np.random.default_rng([seed, 2])
    return [int(k) for k in rng.permutation(len(plan.rooms))[:count]]


def _xy(point: np.ndarray) -> tuple[float, float]:
    x, y = point.tolist()
    return x, y
