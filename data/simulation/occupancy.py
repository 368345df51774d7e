"""The storey's floor as a grid: where a robot fits, and which room each cell belongs to."""

from dataclasses import dataclass

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.simulation.storey_model import RoomLabel, Space, StoreyModel, Triangles

CELL = 0.05  # m
LOWEST = 0.15  # m above the floor: lower things are driven over
WALL_REACH = 0.5  # m: half the thickest wall between two rooms whose doorway counts as interior
STEP = 0.1  # m: the floor may differ so much from the storey's level
INSIDE = 0.2  # m: so far within its footprint a room counts as entered
MOST_CELLS = 40_000_000  # 300 x 300 m
_SHIFT = 4  # binary digits after the point in OpenCV's coordinates


@dataclass(frozen=True)
class Grid:
    """Cell (row, column) has its centre at `origin + CELL * (column, row)`, x y in the BIM frame.

    `clearance` (H, W) is the distance in metres to the nearest obstacle or edge of the interior; `room`
    (H, W) is the index into `rooms` of the room entered there, -1 where there is none.
    """

    origin: NDArray[np.float64]
    clearance: NDArray[np.float64]
    room: NDArray[np.int32]
    rooms: tuple[RoomLabel, ...]

    def to_xy(self, cells: NDArray[np.int_]) -> NDArray[np.float64]:
        """(..., 2) rows and columns to x y in the BIM frame."""
        return self.origin + CELL * np.asarray(cells)[..., ::-1]

    def to_cells(self, xy: NDArray[np.float64]) -> NDArray[np.int_]:
        """(..., 2) x y in the BIM frame to rows and columns."""
        return np.rint((xy - self.origin) / CELL).astype(int)[..., ::-1]

    def clearance_at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) clearance in metres at x y (N, 2), interpolated between cells."""
        at = ((xy - self.origin) / CELL)[:, ::-1].T
        return np.asarray(ndimage.map_coordinates(self.clearance, at, order=1, mode="nearest"))

    def room_at(self, xy: NDArray[np.float64]) -> NDArray[np.int32]:
        """(N,) indices into `rooms`, -1 for none, at x y (N, 2)."""
        rows, columns = self.to_cells(xy).T
        return self.room[rows, columns]


def build_grid(storey: StoreyModel, scene: TriangleScene, height: float) -> Grid:
    """Slices the building from LOWEST to `height` metres above the floor; keeps what is inside, on a floor.

    Inside is what the storey's spaces cover, with the doorways between them; on a storey without spaces, what
    walls and shut doors enclose. Raises UserError for a storey too large for a grid.
    """
    origin = storey.extent[0] - 1.0
    columns, rows = np.ceil((storey.extent[1] + 1.0 - origin) / CELL).astype(int)
    if rows * columns > MOST_CELLS:
        size = f"{columns * CELL:.0f} x {rows * CELL:.0f} m"
        raise UserError(f"storey '{storey.name}' measures {size}, too large for a drive; choose another storey")
    blank = np.zeros((rows, columns), np.uint8)
    walls = _draw(blank, origin, _slice(storey.solid, storey.level + LOWEST, storey.level + height))
    if storey.spaces:
        rooms = tuple(s.label for s in storey.spaces)
        footprint = _footprints(blank, origin, storey.spaces)
    else:
        footprint = _enclosed(walls, [_draw(blank, origin, d) for d in storey.doors])
        rooms = tuple(RoomLabel(f"enclosed-{k + 1}") for k in range(int(footprint.max()) + 1))
    reach = _disc(WALL_REACH)
    interior = cv2.morphologyEx((footprint >= 0).astype(np.uint8), cv2.MORPH_CLOSE, reach)
    floor = _floor(interior, origin, storey.level, scene)
    floored = cv2.morphologyEx(floor, cv2.MORPH_CLOSE, reach)
    clearance = ndimage.distance_transform_edt((walls == 0) & (interior > 0) & (floored > 0)) * CELL
    return Grid(origin, clearance, _well_inside(footprint), rooms)


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


def _enclosed(walls: NDArray[np.uint8], doors: list[NDArray[np.uint8]]) -> NDArray[np.int32]:
    """Rooms of a storey without spaces: areas of at least 1 m2 that walls and shut doors enclose."""
    shut = np.maximum.reduce([walls, *(cv2.dilate(d, np.ones((3, 3), np.uint8)) for d in doors)])
    areas, count = ndimage.label(shut == 0)
    sizes = np.bincount(areas.ravel(), minlength=count + 1) * CELL**2
    sizes[0] = 0
    sizes[np.unique(np.concatenate([areas[0], areas[-1], areas[:, 0], areas[:, -1]]))] = 0
    number = np.full(count + 1, -1, np.int32)
    large = np.flatnonzero(sizes >= 1.0)
    number[large] = np.arange(len(large))
    return number[areas]


def _floor(
    interior: NDArray[np.uint8], origin: NDArray[np.float64], level: float, scene: TriangleScene
) -> NDArray[np.uint8]:
    """1 in the cells of the interior that have a floor within STEP of the level: not over stairwells."""
    cells = np.argwhere(interior)
    above = np.column_stack([origin + CELL * cells[:, ::-1], np.full(len(cells), level + STEP)])
    down = np.tile([0.0, 0.0, -1.0], (len(cells), 1))
    floor = np.zeros_like(interior)
    floor[tuple(cells.T)] = scene.distances(above, down) <= 2 * STEP
    return floor
