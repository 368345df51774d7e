"""Where a robot can drive on a storey's floor, and smooth paths through its rooms there."""

from dataclasses import dataclass

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage
from skimage.graph import MCP_Geometric

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.simulation.storey_model import Space, StoreyModel, Triangles

CELL = 0.05  # m
LOWEST = 0.15  # m above the floor: lower things are driven over
WALL_REACH = 0.5  # m: half the thickest wall between two rooms whose doorway counts as interior
STEP = 0.1  # m: the floor may differ so much from the storey's level
INSIDE = 0.2  # m: so far within its footprint a room counts as entered
MOST_CELLS = 40_000_000  # 300 x 300 m
_SHIFT = 4  # binary digits after the point in OpenCV's coordinates
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


@dataclass(frozen=True)
class Grid:
    """Cell (row, column) has its centre at `origin + CELL * (column, row)`, x y in the BIM frame.

    `clearance` (H, W) is the distance in metres to the nearest obstacle or edge of the interior; `room`
    (H, W) is the index of the storey's space entered there, -1 where there is none.
    """

    origin: NDArray[np.float64]
    clearance: NDArray[np.float64]
    room: NDArray[np.int32]

    def to_xy(self, cells: NDArray[np.int_]) -> NDArray[np.float64]:
        """(..., 2) rows and columns to x y in the BIM frame."""
        return self.origin + CELL * np.asarray(cells)[..., ::-1]

    def to_cells(self, xy: NDArray[np.float64]) -> NDArray[np.int_]:
        """(..., 2) x y in the BIM frame to rows and columns."""
        return np.rint((xy - self.origin) / CELL).astype(int)[..., ::-1]

    def cell(self, place: NDArray[np.float64]) -> Cell:
        """The row and column at a place (2,) or (3,)."""
        row, column = self.to_cells(place[:2]).tolist()
        return row, column

    def clearance_at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) clearance in metres at x y (N, 2), interpolated between cells."""
        at = ((xy - self.origin) / CELL)[:, ::-1].T
        return np.asarray(ndimage.map_coordinates(self.clearance, at, order=1, mode="nearest"))

    def room_at(self, xy: NDArray[np.float64]) -> NDArray[np.int32]:
        """(N,) indices of spaces, -1 for none, at x y (N, 2)."""
        rows, columns = self.to_cells(xy).T
        return self.room[rows, columns]


def build_grid(storey: StoreyModel, scene: TriangleScene, height: float) -> Grid:
    """Slices the building from LOWEST to `height` metres above the floor; keeps what is inside, on a floor.

    Inside is what the storey's spaces cover, with the doorways between them. Raises UserError for a storey too large
    for a grid.
    """
    origin = storey.extent[0] - 1.0
    columns, rows = np.ceil((storey.extent[1] + 1.0 - origin) / CELL).astype(int)
    if rows * columns > MOST_CELLS:
        size = f"{columns * CELL:.0f} x {rows * CELL:.0f} m"
        raise UserError(f"storey '{storey.name}' measures {size}, too large for a drive; choose another storey")
    blank = np.zeros((rows, columns), np.uint8)
    walls = _draw(blank, origin, _slice(storey.solid, storey.level + LOWEST, storey.level + height))
    footprint = _footprints(blank, origin, storey.spaces)
    reach = _disc(WALL_REACH)
    interior = cv2.morphologyEx((footprint >= 0).astype(np.uint8), cv2.MORPH_CLOSE, reach)
    floor = _floor(interior, origin, storey.level, scene)
    floored = cv2.morphologyEx(floor, cv2.MORPH_CLOSE, reach)
    clearance = ndimage.distance_transform_edt((walls == 0) & (interior > 0) & (floored > 0)) * CELL
    return Grid(origin, clearance, _well_inside(footprint))


def _slice(triangles: Triangles, low: float, high: float) -> Triangles:
    """The parts of the triangles between two heights."""
    z = triangles[:, :, 2]
    kept = triangles[(z.max(axis=1) > low) & (z.min(axis=1) < high)]
    for normal, height in (((0, 0, 1), low), ((0, 0, -1), high)):
        faces = np.arange(3 * len(kept)).reshape(-1, 3)
        vertices, faces, _ = trimesh.intersections.slice_faces_plane(
            kept.reshape(-1, 3), faces, np.array(normal, float), np.array([0, 0, height])
        )
        kept = vertices[faces]
    return kept


def _draw(blank: NDArray[np.uint8], origin: NDArray[np.float64], triangles: Triangles) -> NDArray[np.uint8]:
    """1 in every cell that the triangles, seen from above, touch."""
    image = blank.copy()
    corners = np.rint((triangles[:, :, :2] - origin) / CELL * 2**_SHIFT).astype(np.int32)
    for corner in corners:  # one by one: together, overlapping ones would cancel out
        cv2.fillConvexPoly(image, corner, 1, shift=_SHIFT)
    cv2.polylines(image, list(corners), True, 1, shift=_SHIFT)
    return image


def _footprints(blank: NDArray[np.uint8], origin: NDArray[np.float64], spaces: tuple[Space, ...]) -> NDArray[np.int32]:
    """The index of the space over each cell, -1 for none; where spaces overlap, the smaller one."""
    drawn = [_draw(blank, origin, s.bottom) for s in spaces]
    label = np.full(blank.shape, -1, np.int32)
    for k in sorted(range(len(drawn)), key=lambda k: -int(drawn[k].sum())):
        label[drawn[k] > 0] = k
    return label


def _well_inside(footprint: NDArray[np.int32]) -> NDArray[np.int32]:
    """The footprints without their outer INSIDE metres."""
    disc = _disc(INSIDE)
    label = footprint.astype(np.float32)  # of the kinds that OpenCV takes, the one that holds every index
    alone = cv2.erode(label, disc) == cv2.dilate(label, disc)
    return np.where(alone, footprint, -1)


def _disc(radius: float) -> NDArray[np.uint8]:
    side = 2 * round(radius / CELL) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), dtype=np.uint8)


def _floor(
    interior: NDArray[np.uint8], origin: NDArray[np.float64], level: float, scene: TriangleScene
) -> NDArray[np.uint8]:
    """1 in the cells of the interior that have a floor within STEP of the level: not over stairwells."""
    cells = np.argwhere(interior)
    above = np.column_stack([origin + CELL * cells[:, ::-1], np.full(len(cells), level + STEP)])
    floor = np.zeros_like(interior)
    floor[tuple(cells.T)] = scene.distances(above, np.array([0.0, 0.0, -1.0])) <= 2 * STEP
    return floor


def tour(
    planner: "Planner", start: Cell, end: Cell, min_rooms: int, min_length: float, shortest: float
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

    def __init__(self, model: StoreyModel, grid: Grid, radius: float, rng: np.random.Generator) -> None:
        self.model, self.grid, self.need, self.rng = model, grid, radius + MARGIN, rng
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
