"""People: upright cylinders that walk about in the rooms that are entered, and one who follows the sensor."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.simulation.route import Grid
from data.simulation.way import Way

Array = NDArray[np.float64]
HEIGHT, RADIUS = 1.7, 0.25  # m
PACE = 1.0  # m/s
RATE = 10.0  # places a second
BEHIND = (1.0, 1.5)  # m by which the follower is behind, along the way
APART = 0.8  # m that people keep from the sensor
IN_A_ROOM = 2  # people, at most
NEAR = 15.0  # m: of those further away no ray is looked for
TRIES = 30  # for a straight walk to another place in the room


@dataclass(frozen=True, eq=False)
class People:
    """`places` (K, M, 3) are where they stand, RATE a second."""

    places: Array

    def distances(self, origins: Array, directions: Array, seconds: Array | float) -> Array:
        """(N,) metres along the rays to the nearest person; inf for none. Times (N,) or one for all."""
        nearest = np.full(len(directions), np.inf)
        at = np.broadcast_to(np.asarray(seconds, dtype=float), (len(directions),)) * RATE
        first = np.clip(at.astype(int), 0, self.places.shape[1] - 2)
        share = np.clip(at - first, 0.0, 1.0)[:, None]
        origins = np.broadcast_to(origins, directions.shape)
        middle, origin = int(first[len(first) // 2]), origins[0]
        for place in self.places[np.linalg.norm(self.places[:, middle, :2] - origin[:2], axis=1) < NEAR]:
            feet = (1 - share) * place[first] + share * place[first + 1]
            nearest = np.minimum(nearest, _cylinder(origins - feet, directions))
        return nearest


def people(way: Way, rooms: Collection[str], track: Array, rng: np.random.Generator) -> People:
    """Who is about in the `rooms` (ids) that are entered while the sensor is over `track` (M, 3), RATE a second."""
    tracks = [_follower(way.planners[0].grid, track, rng.uniform(*BEHIND), rng)]
    for planner in way.planners:
        for k, room in enumerate(planner.grid.rooms):
            for _ in range(rng.integers(IN_A_ROOM + 1) if room.id in rooms else 0):
                walk = _walk(planner.grid, k, len(track), rng)
                if walk is not None:
                    ground = np.column_stack([walk, np.full(len(walk), planner.model.level)])
                    tracks.append(ground + way.raised.rise(ground)[:, None] * [0.0, 0.0, 1.0])
    return People(np.stack([_kept_apart(walked, track) for walked in tracks]))


def _follower(grid: Grid, way: Array, behind: float, rng: np.random.Generator) -> Array:
    """(M, 3) the sensor's own way, `behind` metres later; at first from a free place beside its beginning."""
    cells = np.argwhere(grid.clearance > RADIUS)
    far = np.abs(np.linalg.norm(grid.to_xy(cells) - way[0, :2], axis=1) - behind)
    start = grid.to_xy(rng.choice(cells[far <= max(0.1, float(far.min()))]))
    whole = np.vstack([[*start, way[0, 2]], way])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(whole[:, :2], axis=0), axis=1))])
    rising = along + 1e-9 * np.arange(len(along))
    at = np.maximum(along[1:] - behind, 0.0)
    return np.column_stack([np.interp(at, rising, column) for column in whole.T])


def _walk(grid: Grid, room: int, count: int, rng: np.random.Generator) -> Array | None:
    """(count, 2) to and fro in a room along straight lines; None where there is no room for a walk."""
    cells = np.argwhere((grid.room == room) & (grid.clearance > RADIUS + 0.05))
    if len(cells) < 100:  # a quarter of a square metre
        return None
    here = grid.to_xy(cells[rng.integers(len(cells))])
    parts: list[Array] = []
    while sum(map(len, parts)) < count:
        for there in grid.to_xy(cells[rng.integers(len(cells), size=TRIES)]):
            steps = max(2, int(np.linalg.norm(there - here) / PACE * RATE))
            line = here + np.linspace(0, 1, steps)[:, None] * (there - here)
            if grid.clearance_at(line).min() > RADIUS:
                parts.append(line)
                here = there
                break
        parts.append(np.repeat(here[None], int(rng.uniform(0.5, 3.0) * RATE), axis=0))
    return np.concatenate(parts)[:count]


def _kept_apart(track: Array, way: Array) -> Array:
    """The track, a step aside where the sensor comes near."""
    off = track[:, :2] - way[:, :2]
    far = np.linalg.norm(off, axis=1, keepdims=True)
    aside = np.where(far > 1e-6, off / np.maximum(far, 1e-6), [1.0, 0.0])
    near = (far[:, 0] < APART) & (np.abs(track[:, 2] - way[:, 2]) < HEIGHT)
    moved = track.copy()
    moved[near, :2] = (way[:, :2] + APART * aside)[near]
    return moved


def _cylinder(origins: Array, directions: Array) -> Array:
    """(N,) metres to the upright cylinder on (0, 0, 0), seen from outside; inf where it is missed."""
    flat = np.sum(directions[:, :2] ** 2, axis=1)
    b = np.sum(origins[:, :2] * directions[:, :2], axis=1)
    root = b * b - flat * (np.sum(origins[:, :2] ** 2, axis=1) - RADIUS**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        side = (-b - np.sqrt(root)) / flat
        top = (HEIGHT - origins[:, 2]) / directions[:, 2]
    z = origins[:, 2] + side * directions[:, 2]
    hit = (root > 0) & (side > 0) & (z > 0) & (z < HEIGHT)
    falls = (directions[:, 2] < 0) & (top > 0)
    top = np.where(falls, top, 0.0)
    falls &= np.sum((origins[:, :2] + top[:, None] * directions[:, :2]) ** 2, axis=1) < RADIUS**2
    return np.minimum(np.where(hit, side, np.inf), np.where(falls, top, np.inf))
