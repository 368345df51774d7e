"""The building as it stands: with glass, things and people in it, and how rays come back from it."""

from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.simulation.carriers import Motion
from data.simulation.effects.furniture import door_leaves, furniture
from data.simulation.effects.people import RATE, People, people
from data.simulation.effects.platforms import Platforms
from data.simulation.route import Grid
from data.simulation.sensor import Scene, Sensor
from data.simulation.storey_model import StoreyModel

Array = NDArray[np.float64]
IN_SCENE = frozenset({"glass", "people", "doors", "shelves", "returns", "steps"})  # effects on what rays hit
PASS = 0.7  # share of rays that pass a pane
NOISE, BIAS = 0.03, 0.01  # m, standard deviations: of each range, and of each beam for good
REACH = 30.0  # m
EDGE = 0.3  # m between the ranges of neighbours: an edge
MIXED = 0.3  # share of the rays at an edge that give a range between
GRAZING = np.cos(np.radians([80.0, 88.0]))  # up to the first no ray is lost, from the second on all are


@dataclass(frozen=True, eq=False)
class Returns:
    """Ray i is cast by laser `i % beams`; `bias` (beams,) in metres."""

    bias: Array

    @staticmethod
    def of(beams: int, seed: int) -> "Returns":
        """A sensor's own biases."""
        return Returns(np.random.default_rng([seed, 51]).normal(0.0, BIAS, beams))

    def measured(self, ranges: Array, cosines: Array, rng: np.random.Generator) -> Array:
        """(N,) ranges (N,) as the sensor tells them, without their noise; `cosines` (N,) are those of the incidence."""
        lost = rng.random(len(ranges)) < (GRAZING[0] - cosines) / (GRAZING[0] - GRAZING[1])
        measured, beams = ranges.copy(), len(self.bias)
        both = np.isfinite(ranges[beams:]) & np.isfinite(ranges[:-beams])
        step = np.where(both, ranges[beams:], 0.0) - np.where(both, ranges[:-beams], 0.0)
        mixed = (np.abs(step) > EDGE) & (rng.random(len(step)) < MIXED)
        measured[:-beams][mixed] += rng.random(int(mixed.sum())) * step[mixed]
        measured += np.resize(self.bias, len(measured))
        return np.where(lost, np.inf, measured)


def noisy(sensor: Sensor) -> Sensor:
    """The sensor with more noise and less reach."""
    assert is_dataclass(sensor) and not isinstance(sensor, type)
    return replace(sensor, range_noise=NOISE, max_range=min(REACH, sensor.max_range))


@dataclass(frozen=True, eq=False)
class World:
    """What rays can hit during a drive."""

    solid: TriangleScene
    glass: TriangleScene | None = None
    people: People | None = None
    returns: Returns | None = None

    def at(self, seconds: Array | float, rng: np.random.Generator) -> Scene:
        """The scene for rays at these times, (N,) or one for all, in seconds since the drive's beginning."""
        if self.glass is None and self.people is None and self.returns is None:
            return self.solid
        return _Instant(self, seconds, rng)


@dataclass(frozen=True, eq=False)
class _Instant:
    world: World
    seconds: Array | float
    rng: np.random.Generator

    def distances(self, origins: Array, directions: Array) -> Array:
        world, cosines = self.world, np.ones(len(directions))
        if world.returns is None:
            ranges = world.solid.distances(origins, directions)
        else:
            ranges, cosines = world.solid.incidences(origins, directions)
        if world.glass is not None:
            panes = world.glass.distances(origins, directions)
            stopped = (panes < ranges) & (self.rng.random(len(ranges)) > PASS)
            ranges, cosines = np.where(stopped, panes, ranges), np.where(stopped, 1.0, cosines)
        if world.people is not None:
            bodies = world.people.distances(origins, directions, self.seconds)
            ranges, cosines = np.minimum(ranges, bodies), np.where(bodies < ranges, 1.0, cosines)
        return ranges if world.returns is None else world.returns.measured(ranges, cosines, self.rng)


@dataclass(frozen=True, eq=False)
class Driven:
    """What was driven: `legs` (N, 2 or 3) each, the ids of the rooms entered, up to the last stamp in seconds."""

    grids: dict[StoreyModel, Grid]
    legs: Sequence[Array]
    motion: Motion
    rooms: Sequence[str]
    until: float
    radius: float


def furnished(effects: frozenset[str], drive: Driven, raised: Platforms | None, beams: int, seed: int) -> World:
    """The world with these effects; each draws on a chance of its own, so that one does not change another."""
    raised = Platforms(()) if raised is None else raised
    way = np.concatenate(drive.legs)[::5, :2]
    added = [raised.triangles]
    for k, (model, grid) in enumerate(drive.grids.items()):
        if "doors" in effects:
            leaves = door_leaves(model.doors, way, np.random.default_rng([seed, 53, k]))
            added += [leaf.triangles for leaf in leaves]
        if "shelves" in effects:
            pieces = furniture(grid, model.level, way, drive.radius, model.doors, np.random.default_rng([seed, 54, k]))
            added += [piece.triangles for piece in pieces]
    solid = np.concatenate([model.solid for model in drive.grids])
    glazed = np.concatenate([model.glazed for model in drive.grids])
    panes = None
    if "glass" in effects and glazed.any():
        panes, solid = TriangleScene(solid[glazed]), solid[~glazed]
    about = _people(drive, raised, seed) if "people" in effects else None
    returns = Returns.of(beams, seed) if "returns" in effects else None
    return World(TriangleScene(np.concatenate([solid, *added])), panes, about, returns)


def _people(drive: Driven, raised: Platforms, seed: int) -> People:
    way = drive.motion.ground(np.arange(int(drive.until * RATE) + 2) / RATE)
    level = next(iter(drive.grids)).level
    ground = way[:, [0, 1, 3]] if way.shape[1] == 4 else np.column_stack([way[:, :2], np.full(len(way), level)])
    entered = set(drive.rooms)
    grids = [
        (grid, model.level, [k for k, room in enumerate(grid.rooms) if room.id in entered])
        for model, grid in drive.grids.items()
    ]
    return people(grids, ground, raised, np.random.default_rng([seed, 55]))
