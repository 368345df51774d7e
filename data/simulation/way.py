"""The way through a building that is driven, over one or several of its storeys."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.simulation.drive import Robot
from data.simulation.effects.platforms import Platforms, platforms
from data.simulation.occupancy import Grid, build_grid
from data.simulation.route import Cell, Planner, plan_tour, tour
from data.simulation.stairs import Storey, stair_way
from data.simulation.storey_model import StoreyModel

Grids = dict[StoreyModel, Grid]
Leg = NDArray[np.float64]  # (N, 2 or 3)


@dataclass(frozen=True, eq=False)
class Way:
    """The way through a building: its surfaces, the floor of each storey, the `legs` of the tour, (N, 2) on one storey,
    (N, 3) over several, the heading at the start (rad), and the floors that are `raised`, None without any."""

    scene: TriangleScene
    grids: Grids
    legs: tuple[Leg, ...]
    start_yaw: float
    raised: Platforms | None


def way_through(
    models: list[StoreyModel],
    top: float,
    robot: Robot,
    min_rooms: int,
    min_length: float,
    and_back: bool,
    has_steps: bool,
    seed: int,
) -> Way:
    """A random tour of the storeys, in their order, below `top` (m above the floor); see `plan_tour`.

    Raises UserError where the robot cannot move, or cannot climb from storey to storey.
    """
    own = list(dict.fromkeys(models))
    scene = TriangleScene(np.concatenate([model.solid for model in own]))
    grids = {model: build_grid(model, scene, top) for model in own}
    rng = np.random.default_rng(seed)
    start_yaw = float(rng.uniform(-np.pi, np.pi))
    if len(models) == 1:
        legs = plan_tour(grids[models[0]], robot.radius, min_rooms, min_length, rng)
    else:
        of = {model: Storey(model, Planner(grid, robot.radius, rng)) for model, grid in grids.items()}
        legs = _plan_storeys([of[model] for model in models], scene, robot.radius, min_rooms, min_length, rng)
    if and_back:
        legs = (*legs, *(leg[::-1] for leg in reversed(legs)))
    raised = platforms(models, legs, scene, seed) if has_steps else None
    if raised is not None:
        legs = tuple(raised.over(leg, models[0].level) for leg in legs)
    return Way(scene, grids, legs, start_yaw, raised)


def _plan_storeys(
    storeys: Sequence[Storey],
    scene: TriangleScene,
    radius: float,
    min_rooms: int,
    min_length: float,
    rng: np.random.Generator,
) -> tuple[Leg, ...]:
    """The legs (N, 3) of a drive over the storeys in their order, from a random place on the first.

    On each storey the robot enters `min_rooms` rooms and drives `min_length` metres (see `tour`); on the last one it
    ends where it arrived. Raises UserError where a stair is missing, or a storey cannot be driven.
    """
    ways = [stair_way(a, b, scene, radius) for a, b in pairwise(storeys)]
    planner = storeys[0].planner
    start = planner.random_cell(planner.rooms[rng.integers(len(planner.rooms))])
    legs: list[Leg] = []
    for k, storey in enumerate(storeys):
        end = _cell(storey, ways[k][0]) if k < len(ways) else start
        on_floor = tour(storey.planner, start, end, min_rooms, min_length, shortest=0.0)
        legs += [np.column_stack([leg, np.full(len(leg), storey.model.level)]) for leg in on_floor]
        if k < len(ways):
            legs.append(ways[k])
            start = _cell(storeys[k + 1], ways[k][-1])
    return tuple(legs)


def _cell(storey: Storey, place: NDArray[np.float64]) -> Cell:
    row, column = storey.planner.grid.to_cells(place[:2]).tolist()
    return row, column
