"""What real sensors meet and an ideal simulation leaves out: the building as it stands, with glass, things and people
in it, and how rays come back from it."""

from collections.abc import Collection
from dataclasses import dataclass, field, is_dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.simulation.furniture import door_leaves, furniture
from data.simulation.motion import Motion
from data.simulation.people import RATE, People, people
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


def checked(effects: Collection[str]) -> frozenset[str]:
    """The effects; `all` stands for all of them. Raises UserError for an unknown name."""
    for name in effects:
        if name not in (*EFFECTS, ALL):
            raise UserError(f"'{name}' is not an effect; give some of {', '.join(EFFECTS)}, or {ALL}")
    return frozenset(EFFECTS if ALL in effects else effects)


def noisy(sensor: Sensor) -> Sensor:
    """The sensor with more noise and less reach."""
    assert is_dataclass(sensor) and not isinstance(sensor, type)
    return replace(sensor, range_noise=NOISE, max_range=min(REACH, sensor.max_range))


@dataclass(frozen=True, eq=False)
class World:
    """What rays can hit during a drive: a `Scene` at `seconds` since its beginning, (N,) those of each ray or one for
    all. `bias` (beams,) are the errors (m) of a sensor with imperfect returns, whose ray i is cast by laser
    `i % beams`."""

    solid: TriangleScene
    glass: TriangleScene | None = None
    people: People | None = None
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
            bodies = self.people.distances(origins, directions, self.seconds)
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
        about = people(way, rooms, ground, np.random.default_rng([seed, 55]))
    bias = np.random.default_rng([seed, 51]).normal(0.0, BIAS, beams) if "returns" in effects else None
    return World(TriangleScene(np.concatenate([solid, *added])), panes, about, bias)
