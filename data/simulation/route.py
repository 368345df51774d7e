"""A tour of the rooms through open doors, along smooth curves that keep the robot's clearance."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.graph import MCP_Geometric

from data.common.errors import UserError
from data.simulation.occupancy import CELL, Grid

SPACING = 0.01  # m between the points of a leg
COMFORT = 0.8  # m: nearer to obstacles than this, a way costs more
NEARNESS = 8.0  # how much more, at the obstacle itself
WIDTHS = (0.4, 0.3, 0.2, 0.14, 0.1, 0.06)  # m: smoothing kernels, the widest that keeps the distance is taken
VISITED = 1.0  # m: a room whose goal was passed as near as this needs no leg of its own
SHORTEST = 0.5  # m: no leg is shorter
TRIES = 100  # goals in a row without a leg before the search ends
WHIM = 20  # cells: over this distance the robot's taste for a way changes
MARGIN = CELL  # m: more than the grid's error, half a cell's diagonal

Array = NDArray[np.float64]
Curve = NDArray[np.float64]  # (N, 2) x y in the BIM frame, SPACING apart
Cell = tuple[int, int]


def plan_tour(
    grid: Grid, radius: float, min_rooms: int, min_length: float, rng: np.random.Generator
) -> tuple[Curve, ...]:
    """The legs, between which the robot stops and turns: from a random free place and back to it; see `tour`."""
    planner = Planner(grid, radius, rng)
    start = planner.random_cell(planner.rooms[rng.integers(len(planner.rooms))])
    return tour(planner, start, start, min_rooms, min_length)


def tour(
    planner: "Planner", start: Cell, end: Cell, min_rooms: int, min_length: float, shortest: float = SHORTEST
) -> tuple[Curve, ...]:
    """The legs from one free place to another; the last one is left out where it is not longer than `shortest` (m).

    The next room is the nearest of a random part of those not yet visited. The tour ends when `min_rooms`
    rooms (all, where fewer can be reached) have been entered and `min_length` metres driven; rooms are
    visited again, at other places, where they are too few for the length. Raises UserError where no room can
    be reached.
    """
    grid, rng = planner.grid, planner.rng
    legs: list[Curve] = []
    here, length, fruitless = start, 0.0, 0
    entered: set[int] = set()
    goals = planner.random_goals()
    while len(entered) < min(min_rooms, len(planner.rooms)) or length < min_length:
        goals = goals or planner.random_goals()
        kept = [k for k in goals if rng.random() < 0.7] or list(goals)
        leg, there = planner.nearest(here, [goals[k] for k in kept])
        goals = _not_passed(grid, goals, leg)
        fruitless = fruitless + 1 if curve_length(leg) < SHORTEST else 0
        if fruitless > TRIES:
            raise UserError("the reachable free space is too small to drive in; choose another storey")
        if not fruitless:
            legs.append(leg)
            entered |= set(grid.room_at(leg).tolist()) - {-1}
            here, length = there, length + curve_length(leg)
    home, _ = planner.nearest(here, [end])
    return (*legs, home) if curve_length(home) > shortest else tuple(legs)


def _not_passed(grid: Grid, goals: dict[int, Cell], leg: Curve) -> dict[int, Cell]:
    """The goals further than VISITED from the leg."""
    places = grid.to_xy(np.array(list(goals.values())))
    distance = np.linalg.norm(leg[::10, None] - places, axis=2).min(axis=0)
    return {k: goal for (k, goal), d in zip(goals.items(), distance, strict=True) if d > VISITED}


def curve_length(curve: Curve) -> float:
    """Metres along a curve (N, 2)."""
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


class Planner:
    """Paths through the largest connected part of the cells where the robot fits, measured in rooms."""

    def __init__(self, grid: Grid, radius: float, rng: np.random.Generator) -> None:
        self.grid, self.need, self.rng = grid, radius + MARGIN, rng
        parts, _ = ndimage.label(grid.clearance > self.need, np.ones((3, 3)))
        in_room = (parts > 0) & (grid.room >= 0)
        reached = np.unique(np.column_stack([parts[in_room], grid.room[in_room]]), axis=0)
        if not len(reached):
            raise UserError(f"no room can be reached by a robot of {radius} m radius; choose another storey")
        most = np.argmax(np.bincount(reached[:, 0]))
        self.rooms: list[int] = reached[reached[:, 0] == most, 1].tolist()
        self.free = parts == most
        near = np.clip(1 - (grid.clearance - radius) / COMFORT, 0, 1)
        self._costs = np.where(self.free, 1 + NEARNESS * near**2, -1.0)

    def random_cell(self, room: int) -> Cell:
        """A free cell of the room with at least half of the best clearance there."""
        cells = np.argwhere(self.free & (self.grid.room == room))
        clearance = self.grid.clearance[tuple(cells.T)]
        row, column = self.rng.choice(cells[clearance >= clearance.max() / 2])
        return int(row), int(column)

    def random_goals(self) -> dict[int, Cell]:
        """One cell for each room."""
        return {k: self.random_cell(k) for k in self.rooms}

    def nearest(self, here: Cell, goals: list[Cell]) -> tuple[Curve, Cell]:
        """The smooth path to the goal with the lowest cost, and that goal; paths vary at random."""
        rows, columns = self.free.shape
        whim = cv2.resize(self.rng.random((rows // WHIM + 2, columns // WHIM + 2)), (columns, rows))
        planner = MCP_Geometric(self._costs * (1 + whim))
        costs, _ = planner.find_costs([here], goals, find_all_ends=False)
        there = min(goals, key=lambda g: costs[g])
        return self._smooth(self.grid.to_xy(np.array(planner.traceback(there)))), there

    def _smooth(self, way: Curve) -> Curve:
        """Gaussian smoothing along the path with fixed ends; narrower where it would come too close to obstacles."""
        way = resampled(way)
        curves = np.stack([smoothed(way, width) for width in WIDTHS])
        narrower = np.zeros(len(way))  # index into WIDTHS at each point
        for _ in range(3 * len(WIDTHS)):
            index = np.clip(ndimage.gaussian_filter1d(narrower, 0.2 / SPACING), 0, len(WIDTHS) - 1)
            below = np.minimum(index.astype(int), len(WIDTHS) - 2)
            part, at = (index - below)[:, None], np.arange(len(way))
            curve = (1 - part) * curves[below, at] + part * curves[below + 1, at]
            tight = self.grid.clearance_at(curve) < self.need
            if not tight.any():
                return resampled(curve)
            narrower = ndimage.maximum_filter1d(narrower + tight, round(1.0 / SPACING))
        return way


def smoothed(way: Array, width: float) -> Array:
    """Values (N,) or points (N, K), smoothed along the way by a Gaussian (m), the ends held."""
    reach = min(int(4 * width / SPACING), len(way) - 1)
    padded = np.pad(way, [(reach, reach), *[(0, 0)] * (way.ndim - 1)], mode="reflect", reflect_type="odd")
    smooth = ndimage.gaussian_filter1d(padded, width / SPACING, axis=0, radius=reach)
    return np.asarray(smooth[reach : len(padded) - reach])


def resampled(curve: Array) -> Array:
    """Points (N, 2 or 3) as others that are SPACING apart in plan."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve[:, :2], axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], max(2, round(along[-1] / SPACING) + 1))
    return np.stack([np.interp(at, along, column) for column in curve.T], axis=1)
