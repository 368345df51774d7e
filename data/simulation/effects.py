"""What real sensors meet and an ideal simulation leaves out: the building as it stands, with glass, things and people
in it, and how rays come back from it.

People are upright cylinders that walk about in the rooms that are entered, and one who follows the sensor.
"""

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.simulation.drive import Motion
from data.simulation.furniture import door_leaves, furniture
from data.simulation.route import Grid
from data.simulation.sensor import Sensor
from data.simulation.way import Way

Array = NDArray[np.float64]
ALL = "all"
EFFECTS = {
    "rolling": "the sensor moves during a scan, and each point has its time (formats pcd and ply)",
    "glass": "windows and curtain walls let seven of ten rays pass",
    "people": "some people walk about in the rooms, one follows the sensor",
    "doors": "doors have leaves: shut, ajar, or wide open where the route leads through",
    "shelves": "shelves, cupboards and tables along the walls, clear of the route",
    "tolerance": "each wall is off its planned position, by 1.5 cm (standard deviation)",
    "returns": "3 cm of noise, a bias per beam, mixed pixels, loss at grazing angles, 30 m of range",
    "steps": "raised floors of 0.3 m in some rooms",
}
PASS = 0.7  # share of rays that pass a pane
NOISE, BIAS = 0.03, 0.01  # m, standard deviations: of each range, and of each beam for good
REACH = 30.0  # m
EDGE = 0.3  # m between the ranges of neighbours: an edge
MIXED = 0.3  # share of the rays at an edge that give a range between
GRAZING = np.cos(np.radians([80.0, 88.0]))  # up to the first no ray is lost, from the second on all are
HEIGHT, RADIUS = 1.7, 0.25  # m
PACE = 1.0  # m/s
RATE = 10.0  # places a second
BEHIND = (1.0, 1.5)  # m by which the follower is behind, along the way
APART = 0.8  # m that people keep from the sensor
IN_A_ROOM = 2  # people, at most
NEAR = 15.0  # m: of those further away no ray is looked for
TRIES = 30  # for a straight walk to another place in the room


def checked(effects: Collection[str]) -> frozenset[str]:
    """The effects; `all` stands for all of them. Raises UserError for an unknown name."""
    for name in effects:
        if name not in (*EFFECTS, ALL):
            raise UserError(f"'{name}' is not an effect; give some of {', '.join(EFFECTS)}, or {ALL}")
    return frozenset(EFFECTS if ALL in effects else effects)


def noisy(sensor: Sensor) -> Sensor:
    """The sensor with more noise and less reach."""
    return replace(sensor, range_noise=NOISE, max_range=min(REACH, sensor.max_range))


@dataclass(frozen=True, eq=False)
class World:
    """What rays can hit during a drive: a `Scene` at `seconds` since its beginning, (N,) those of each ray or one for
    all. `bias` (beams,) are the errors (m) of a sensor with imperfect returns, whose ray i is cast by laser
    `i % beams`; `people` (K, M, 3) are the places of people, RATE a second."""

    solid: TriangleScene
    glass: TriangleScene | None = None
    people: Array | None = None
    bias: Array | None = None
    seconds: Array | float = 0.0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def at(self, seconds: Array | float, rng: np.random.Generator) -> "World":
        """The world at these times, and the chance by which rays pass or are lost."""
        return replace(self, seconds=seconds, rng=rng)

    def distances(self, origins: Array, directions: Array) -> Array:
        cosines = np.ones(len(directions))
        if self.bias is None:
            ranges = self.solid.distances(origins, directions)
        else:
            ranges, cosines = self.solid.incidences(origins, directions)
        if self.glass is not None:
            panes = self.glass.distances(origins, directions)
            stopped = (panes < ranges) & (self.rng.random(len(ranges)) > PASS)
            ranges, cosines = np.where(stopped, panes, ranges), np.where(stopped, 1.0, cosines)
        if self.people is not None:
            bodies = _to_people(self.people, origins, directions, self.seconds)
            ranges, cosines = np.minimum(ranges, bodies), np.where(bodies < ranges, 1.0, cosines)
        return ranges if self.bias is None else _returned(ranges, cosines, self.bias, self.rng)


def _returned(ranges: Array, cosines: Array, bias: Array, rng: np.random.Generator) -> Array:
    """(N,) ranges (N,) as the sensor gives them, without their noise; `cosines` (N,) are those of the incidence."""
    lost = rng.random(len(ranges)) < (GRAZING[0] - cosines) / (GRAZING[0] - GRAZING[1])
    measured, beams = ranges.copy(), len(bias)
    both = np.isfinite(ranges[beams:]) & np.isfinite(ranges[:-beams])
    step = np.where(both, ranges[beams:], 0.0) - np.where(both, ranges[:-beams], 0.0)
    mixed = (np.abs(step) > EDGE) & (rng.random(len(step)) < MIXED)
    measured[:-beams][mixed] += rng.random(int(mixed.sum())) * step[mixed]
    return np.where(lost, np.inf, measured + np.resize(bias, len(measured)))


def furnished(
    effects: frozenset[str], way: Way, motion: Motion, rooms: Collection[str], until: float, beams: int, seed: int
) -> World:
    """The world of a drive that enters `rooms` (ids) and ends after `until` seconds; each effect draws on a chance of
    its own, so that one does not change another."""
    track = np.concatenate(way.legs)[::5, :2]
    added = [way.raised.triangles]
    for k, planner in enumerate(way.planners):
        if "doors" in effects:
            added += door_leaves(planner.model.doors, track, np.random.default_rng([seed, 53, k]))
        if "shelves" in effects:
            added += furniture(planner, track, np.random.default_rng([seed, 54, k]))
    solid = np.concatenate([planner.model.solid for planner in way.planners])
    glazed = np.concatenate([planner.model.glazed for planner in way.planners])
    panes, about = None, None
    if "glass" in effects and glazed.any():
        panes, solid = TriangleScene(solid[glazed]), solid[~glazed]
    if "people" in effects:
        ground = motion.ground(np.arange(int(until * RATE) + 2) / RATE)[:, [0, 1, 3]]
        about = _people(way, rooms, ground, np.random.default_rng([seed, 55]))
    bias = np.random.default_rng([seed, 51]).normal(0.0, BIAS, beams) if "returns" in effects else None
    return World(TriangleScene(np.concatenate([solid, *added])), panes, about, bias)


def _people(way: Way, rooms: Collection[str], track: Array, rng: np.random.Generator) -> Array:
    """(K, M, 3) who is about in the `rooms` (ids) that are entered, while the sensor is over `track` (M, 3)."""
    tracks = [_follower(way.planners[0].grid, track, rng.uniform(*BEHIND), rng)]
    for planner in way.planners:
        for k, room in enumerate(planner.model.spaces):
            for _ in range(rng.integers(IN_A_ROOM + 1) if room.id in rooms else 0):
                walk = _walk(planner.grid, k, len(track), rng)
                if walk is not None:
                    ground = np.column_stack([walk, np.full(len(walk), planner.model.level)])
                    tracks.append(ground + way.raised.rise(ground)[:, None] * [0.0, 0.0, 1.0])
    return np.stack([_kept_apart(walked, track) for walked in tracks])


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


def _to_people(people: Array, origins: Array, directions: Array, seconds: Array | float) -> Array:
    """(N,) metres along the rays to the nearest of `people` (K, M, 3); inf for none. Times (N,) or one for all."""
    nearest = np.full(len(directions), np.inf)
    at = np.broadcast_to(np.asarray(seconds, dtype=float), (len(directions),)) * RATE
    first = np.clip(at.astype(int), 0, people.shape[1] - 2)
    share = np.clip(at - first, 0.0, 1.0)[:, None]
    origins = np.broadcast_to(origins, directions.shape)
    middle, origin = int(first[len(first) // 2]), origins[0]
    for place in people[np.linalg.norm(people[:, middle, :2] - origin[:2], axis=1) < NEAR]:
        feet = (1 - share) * place[first] + share * place[first + 1]
        nearest = np.minimum(nearest, _cylinder(origins - feet, directions))
    return nearest


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
