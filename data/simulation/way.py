"""The way through a building that is driven, over one or several storeys: by their floors, and over the stairs.

On stairs it leads where a robot can stand on the building's triangles, from one storey to the next.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.simulation.drive import Robot
from data.simulation.furniture import Platforms, platforms
from data.simulation.route import SHORTEST, Planner, build_grid, resampled, smoothed, tour
from data.simulation.storey_model import StoreyModel, Triangles

CELL = 0.1  # m
AROUND = 1.5  # m about the stairs, where the way may begin and end
HEADROOM = 1.7  # m
RISE = 0.25  # m from cell to cell, at most
RIM = 0.4  # m by which the ground may differ a robot's radius away: what is lower is an edge to fall from
SAME = 0.05  # m from a storey's level
HEIGHTS = (0.45, 0.9, 1.4)  # m above the ground, at which the robot needs room
COMFORT, NEARNESS = 0.35, 8.0  # m more than needed to what stands aside; how much more a way costs there
SMOOTH_XY, SMOOTH_Z = 0.15, 0.3  # m along the way
LAYERS = 12  # of surfaces over each other that are looked for

_DOWN, _UP = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
Leg = NDArray[np.float64]  # (N, 3) x y z of the ground in the BIM frame


@dataclass(frozen=True)
class _Ground:
    """Places (N, 3) where the robot can stand, their cells (N, 2), and the room (N,) it has there."""

    places: Leg
    cells: NDArray[np.int64]
    room: NDArray[np.float64]


def stair_way(start: Planner, end: Planner, scene: TriangleScene, radius: float) -> Leg:
    """The easiest way from a storey to the next over the building's stairs, `SPACING` apart in plan.

    It begins and ends where the robot can drive on either storey. Raises UserError where there is no stair between
    them, or none that the robot can climb.
    """
    between = f"from storey '{start.model.name}' to '{end.model.name}'"
    low, high = sorted((start.model.level, end.model.level))
    stairs = [s for s in start.model.stairs if s[..., 2].min() < high - 0.5 and s[..., 2].max() > low + 0.5]
    if not stairs or high - low < 0.5:
        raise UserError(f"there is no stair {between}; choose storeys that a stair joins")
    ground = _ground(_columns(stairs), scene, (low, high), radius)
    way = _easiest(ground, _on(ground, start), _on(ground, end), radius)
    if way is None:
        raise UserError(f"no stair {between} can be climbed by a robot of {radius} m radius; choose other storeys")
    first, last = (
        [*storey.grid.to_xy(storey.grid.to_cells(place[:2])), storey.model.level]
        for storey, place in ((start, way[0]), (end, way[-1]))
    )
    columns = resampled(np.vstack([first, way, last])).T
    widths = (SMOOTH_XY, SMOOTH_XY, SMOOTH_Z)
    return np.stack([smoothed(column, width) for column, width in zip(columns, widths, strict=True)], axis=1)


def _columns(stairs: list[Triangles]) -> NDArray[np.int64]:
    """(N, 2) the cells about the stairs."""
    corners = np.concatenate([s.reshape(-1, 3)[:, :2] for s in stairs])
    lowest = np.floor((corners.min(axis=0) - AROUND) / CELL).astype(np.int64)
    highest = np.ceil((corners.max(axis=0) + AROUND) / CELL).astype(np.int64)
    x, y = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(lowest, highest, strict=True)), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()])


def _ground(columns: NDArray[np.int64], scene: TriangleScene, levels: tuple[float, float], radius: float) -> _Ground:
    """All surfaces in the columns on which the robot can stand."""
    places, cells = [], []
    z = np.full(len(columns), levels[1] + HEADROOM / 2)
    for _ in range(LAYERS):
        origins = np.column_stack([CELL * columns, z])
        z = z - scene.distances(origins, _DOWN)
        found = z > levels[0] - SAME
        columns, z = columns[found], z[found]
        if not len(z):
            break
        known = z < levels[1] + SAME
        places.append(np.column_stack([CELL * columns, z])[known])
        cells.append(columns[known])
        z = z - 0.01
    ground, at = np.concatenate(places), np.concatenate(cells)
    free = scene.distances(ground + 0.02 * _UP, _UP) > HEADROOM
    ground, at = ground[free], at[free]
    # ground all around at about the same height
    rim = (scene.distances(ground + radius * aside + RIM * _UP, _DOWN) < 2 * RIM for aside in _around(8))
    firm = np.logical_and.reduce(list(rim))
    ground, at = ground[firm], at[firm]
    beside = (scene.distances(ground + height * _UP, aside) for height in HEIGHTS for aside in _around(16))
    room = np.minimum(radius + COMFORT, np.minimum.reduce(list(beside)))
    stands = room > radius
    return _Ground(ground[stands], at[stands], room[stands])


def _around(count: int) -> NDArray[np.float64]:
    angle = np.arange(count) * 2 * np.pi / count
    return np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def _on(ground: _Ground, storey: Planner) -> NDArray[np.int64]:
    """Which places lie on the storey's floor, where the robot can drive."""
    cells = storey.grid.to_cells(ground.places[:, :2])
    within = ((cells >= 0) & (cells < storey.free.shape)).all(axis=1)
    rows, columns = np.where(within[:, None], cells, 0).T
    level = np.abs(ground.places[:, 2] - storey.model.level) < SAME
    return np.flatnonzero(within & storey.free[rows, columns] & level)


def _easiest(ground: _Ground, first: NDArray[np.int64], last: NDArray[np.int64], radius: float) -> Leg | None:
    """The cheapest path from any of the first places to any of the last; None if there is none.

    Within the storeys' floors their own planners are responsible: starting or ending there costs nothing.
    """
    if not len(first) or not len(last):
        return None
    i, j = cKDTree(ground.cells).query_pairs(1.0, p=np.inf, output_type="ndarray").T
    is_step = (ground.cells[i] != ground.cells[j]).any(axis=1)
    is_step &= np.abs(ground.places[i, 2] - ground.places[j, 2]) < RISE
    i, j = i[is_step], j[is_step]
    near = np.clip(1 - (np.minimum(ground.room[i], ground.room[j]) - radius) / COMFORT, 0, 1)
    cost = np.linalg.norm(ground.places[i] - ground.places[j], axis=1) * (1 + NEARNESS * near**2)
    count = len(ground.places)
    graph = coo_matrix((cost, (i, j)), shape=(count, count)).tocsr()
    costs, before, _ = dijkstra(graph, directed=False, indices=first, min_only=True, return_predecessors=True)
    there = int(last[np.argmin(costs[last])])
    if not np.isfinite(costs[there]):
        return None
    way = [there]
    while before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return ground.places[way[::-1]]


@dataclass(frozen=True, eq=False)
class Way:
    """The way through a building: where the robot can drive on each storey, the `legs` of the tour (N, 3), the heading
    at the start (rad), and the floors that are `raised`."""

    planners: list[Planner]
    legs: tuple[Leg, ...]
    start_yaw: float
    raised: Platforms


def way_through(
    models: list[StoreyModel], top: float, robot: Robot, min_rooms: int, min_length: float, has_steps: bool, seed: int
) -> Way:
    """A random tour of the storeys, in their order, below `top` (m above the floor), from a random place on the first.

    On each storey the robot enters `min_rooms` rooms and drives `min_length` metres (see `tour`); on the last one it
    ends where it arrived. Raises UserError where the robot cannot move, or cannot climb from storey to storey.
    """
    own = list(dict.fromkeys(models))
    scene = TriangleScene(np.concatenate([model.solid for model in own]))
    rng = np.random.default_rng(seed)
    start_yaw = float(rng.uniform(-np.pi, np.pi))
    planners = [Planner(model, build_grid(model, scene, top), robot.radius, rng) for model in own]
    tour_of = [planners[own.index(model)] for model in models]
    ways = [stair_way(a, b, scene, robot.radius) for a, b in pairwise(tour_of)]
    start = tour_of[0].random_cell(tour_of[0].rooms[rng.integers(len(tour_of[0].rooms))])
    legs: list[Leg] = []
    for k, storey in enumerate(tour_of):
        end = storey.grid.cell(ways[k][0]) if k < len(ways) else start
        on_floor = tour(storey, start, end, min_rooms, min_length, 0.0 if ways else SHORTEST)
        legs += [np.column_stack([leg, np.full(len(leg), storey.model.level)]) for leg in on_floor]
        if k < len(ways):
            legs.append(ways[k])
            start = tour_of[k + 1].grid.cell(ways[k][-1])
    raised = platforms(own, legs, scene, seed) if has_steps else Platforms(())
    return Way(planners, tuple(raised.over(leg) for leg in legs), start_yaw, raised)
