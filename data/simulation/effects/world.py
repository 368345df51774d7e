"""The building as it stands: with glass, things and people in it, and how rays come back from it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.simulation.effects.people import People
from data.simulation.effects.returns import Returns
from data.simulation.sensor import Scene

Array = NDArray[np.float64]
PASS = 0.7  # share of rays that pass a pane


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
        """As in `Scene`."""
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
