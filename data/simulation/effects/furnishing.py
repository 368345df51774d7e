"""Puts into a building what the effects ask for, beside the way that is driven."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.simulation.carriers import Motion
from data.simulation.effects.doors import door_leaves
from data.simulation.effects.furniture import furniture
from data.simulation.effects.people import RATE, People, people
from data.simulation.effects.platforms import Platforms
from data.simulation.effects.returns import Returns
from data.simulation.effects.world import World
from data.simulation.occupancy import Grid
from data.simulation.storey_model import StoreyModel

Array = NDArray[np.float64]
IN_SCENE = frozenset({"glass", "people", "doors", "shelves", "returns", "steps"})  # effects on what rays hit


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
