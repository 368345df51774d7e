"""A drive over several storeys of a building, and the stairs between them."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.simulation.route import Cell, tour
from data.simulation.stairs import Storey, Way, stair_way


def plan_storeys(
    storeys: Sequence[Storey], scene: TriangleScene, radius: float, min_rooms: int, min_length: float,
    rng: np.random.Generator,
) -> tuple[Way, ...]:  # fmt: skip
    """The legs (N, 3) of a drive over the storeys in their order, from a random place on the first.

    On each storey the robot enters `min_rooms` rooms and drives `min_length` metres (see `tour`); on the last one it
    ends where it arrived. Raises UserError where a stair is missing, or a storey cannot be driven.
    """
    ways = [stair_way(a, b, scene, radius) for a, b in pairwise(storeys)]
    planner = storeys[0].planner
    start = planner.random_cell(planner.rooms[rng.integers(len(planner.rooms))])
    legs: list[Way] = []
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
