"""The free space of a storey as a grid, and its rooms: distance transform, seeds, watershed; wide necks are joined.

Bormann et al. (ICRA 2016) compare such room segmentations.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import expand_labels, watershed

from sgslam.config import RoomSettings
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
_CELL = 0.05  # m, of the grid


@dataclass(frozen=True)
class Grid:
    """Cells of the levelled map: cell (row, column) has its centre at `origin` + (column, row) * `cell`."""

    origin: Floats  # (2,)
    cell: float
    shape: tuple[int, int]

    @staticmethod
    def around(points: Floats, cell: float) -> "Grid":
        """A grid that contains all points (N, 2) with a margin."""
        low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
        columns, rows = np.ceil((high - low) / cell).astype(int) + 1
        return Grid(low, cell, (int(rows), int(columns)))

    def to_cells(self, points: NDArray[np.floating]) -> NDArray[np.int32]:
        """(N, 2) column and row of points (N, 2), clipped to the grid."""
        cells = np.rint((points - self.origin) / self.cell).astype(np.int32)
        return np.clip(cells, 0, [self.shape[1] - 1, self.shape[0] - 1])

    def to_points(self, cells: NDArray[np.int32] | Floats) -> Floats:
        """(N, 2) or (2,) points of (column, row) cells."""
        return np.asarray(cells, dtype=float) * self.cell + self.origin

    def look_up(self, image: NDArray[np.int32], points: Floats) -> NDArray[np.int32]:
        """(N,) the image's values at points (N, 2)."""
        cells = self.to_cells(points)
        return image[cells[:, 1], cells[:, 0]]


@dataclass(frozen=True)
class FreeSpace:
    """Masks (rows, columns) on a grid; `free` cells were seen free and are neither wall nor lintel."""

    grid: Grid
    free: NDArray[np.bool_]
    wall: NDArray[np.bool_]
    lintel: NDArray[np.bool_]


def free_space(sensors: Floats, outlines: Iterable[Floats], segments: Floats, lintels: Iterable[Floats]) -> FreeSpace:
    """Draws the free space of keyframes at `sensors` (K, 2), all in the levelled map.

    `outlines` are the K contours (M, 2) around them, `segments` (S, 2, 2) the observed wall pieces, `lintels` the K
    sets of points (L, 2) above doors. A cell is a lintel where three keyframes or more have seen one.
    """
    # single precision, one after another: a long run has thousands
    near = [_within_reach(place, outline).astype(np.float32) for place, outline in zip(sensors, outlines, strict=True)]
    extent = [corner for outline in near if len(outline) for corner in (outline.min(axis=0), outline.max(axis=0))]
    grid = Grid.around(np.concatenate([sensors, np.array(extent).reshape(-1, 2)]), _CELL)
    free = np.zeros(grid.shape, np.uint8)
    for outline in near:
        if len(outline) >= 3:
            cv2.fillPoly(free, [grid.to_cells(outline)], 1)
    wall = np.zeros(grid.shape, np.uint8)
    for first, last in np.rint((segments - grid.origin) / grid.cell).astype(int).tolist():
        cv2.line(wall, first, last, 1, 1)  # clips at the border; clipping the ends instead would turn the line
    seen = np.zeros(grid.shape, np.int32)
    for points in lintels:
        if len(points):
            cells = grid.to_cells(points)
            once = np.unique(cells[:, 1].astype(np.int64) * grid.shape[1] + cells[:, 0])
            seen.ravel()[once] += 1
    over_door = cv2.morphologyEx((seen >= 3).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return FreeSpace(grid, (free > 0) & (wall == 0) & (over_door == 0), wall > 0, over_door > 0)


def _within_reach(sensor: Floats, outline: Floats) -> Floats:
    away = outline - sensor
    distance = np.hypot(away[:, 0], away[:, 1])
    return sensor + away * np.minimum(1.0, SENSOR.furthest / np.maximum(distance, 1e-9))[:, None]


@dataclass(frozen=True)
class SeenRoom:
    """A room in the levelled map: label in the segmentation, centroid (2,), outline (M, 2), area m2."""

    label: int
    centroid: Floats
    polygon: Floats
    area: float


@dataclass(frozen=True)
class Segmentation:
    """`labels` (rows, columns): the room of each cell, 0 where there is none. `passages` are the centres (2,) of doors
    and necks between two rooms, by their labels."""

    grid: Grid
    labels: NDArray[np.int32]
    rooms: list[SeenRoom]
    passages: dict[tuple[int, int], Floats]

    def at(self, points: Floats) -> NDArray[np.int32]:
        """(N,) the labels at points (N, 2)."""
        return self.grid.look_up(self.labels, points)


def segment(space: FreeSpace, visited: Floats, settings: RoomSettings) -> Segmentation:
    """Segments free space into rooms. Only free space connected to the sensor places `visited` (K, 2) is used."""
    free = _reached(space, visited)
    clearance = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, 5) * space.grid.cell
    seeds = _label(clearance > settings.seed_clearance)
    # cells in narrow places belong to the seed that their widest path leads to
    labels = watershed(-clearance, seeds, mask=free).astype(np.int32)
    labels = _join_wide_necks(labels, clearance, settings)
    rooms = _rooms(labels, space.grid, settings)
    kept = {room.label for room in rooms}
    labels[~np.isin(labels, list(kept))] = 0
    borders = _borders(_over_lintels(labels, space)).items()
    passages = {pair: space.grid.to_points(cells.mean(axis=0)) for pair, cells in borders}
    return Segmentation(space.grid, labels, rooms, passages)


def _over_lintels(labels: NDArray[np.int32], space: FreeSpace) -> NDArray[np.int32]:
    """Lets rooms grow towards each other under lintels, so that those joined by a door meet there."""
    depth = BUILDING.door_depth / space.grid.cell
    grown = expand_labels(labels, distance=depth)
    # only the two faces of a lintel are seen, so the gap between them is closed
    window = np.ones((int(depth) + 1,) * 2, np.uint8)
    lintel = cv2.morphologyEx(space.lintel.astype(np.uint8), cv2.MORPH_CLOSE, window) > 0
    return np.where((labels == 0) & lintel & ~space.wall, grown, labels)


def _label(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)[1]


def _reached(space: FreeSpace, visited: Floats) -> NDArray[np.bool_]:
    labels = _label(space.free)
    names = set(space.grid.look_up(labels, visited).tolist()) - {0}
    return np.isin(labels, list(names))


def _borders(labels: NDArray[np.int32]) -> dict[tuple[int, int], NDArray[np.int32]]:
    """The cells (column, row) at which two labels meet, by the pair of labels."""
    meeting: dict[tuple[int, int], list[NDArray[np.int32]]] = {}
    for here, there in ((labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])):
        rows, columns = np.nonzero((here != there) & (here > 0) & (there > 0))
        low = np.minimum(here[rows, columns], there[rows, columns])
        high = np.maximum(here[rows, columns], there[rows, columns])
        for pair in set(zip(low.tolist(), high.tolist(), strict=True)):
            mine = (low == pair[0]) & (high == pair[1])
            meeting.setdefault(pair, []).append(np.column_stack([columns[mine], rows[mine]]).astype(np.int32))
    return {pair: np.concatenate(cells) for pair, cells in sorted(meeting.items())}


def _join_wide_necks(labels: NDArray[np.int32], clearance: Floats, settings: RoomSettings) -> NDArray[np.int32]:
    """Joins rooms whose border is wider than a door, or hardly narrower than the smaller of the two."""
    count = int(labels.max()) + 1
    depth = np.asarray(ndimage.maximum(clearance, labels, np.arange(count)))
    widths = {pair: 2 * float(clearance[cells[:, 1], cells[:, 0]].max()) for pair, cells in _borders(labels).items()}
    name = np.arange(count, dtype=np.int32)
    while True:
        most = {(a, b): min(settings.neck, 0.85 * 2 * min(depth[a], depth[b])) for a, b in widths}
        wide = [(width, pair) for pair, width in widths.items() if width > most[pair]]
        if not wide:
            return name[labels]
        _, (kept, gone) = max(wide)
        name[name == gone] = kept
        depth[kept] = max(depth[kept], depth[gone])
        joined: dict[tuple[int, int], float] = {}
        for (a, b), width in widths.items():
            a, b = (kept if a == gone else a), (kept if b == gone else b)
            if a != b:
                pair = (min(a, b), max(a, b))
                joined[pair] = max(width, joined.get(pair, 0.0))
        widths = joined


def _rooms(labels: NDArray[np.int32], grid: Grid, settings: RoomSettings) -> list[SeenRoom]:
    rooms = []
    for label in np.unique(labels[labels > 0]):
        mask = (labels == label).astype(np.uint8)
        area = float(mask.sum()) * grid.cell**2
        if area < settings.min_area:
            continue
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        outline = cv2.approxPolyDP(max(contours, key=cv2.contourArea), 2.0, True)[:, 0]
        rows, columns = np.nonzero(mask)
        centroid = grid.to_points(np.array([columns.mean(), rows.mean()]))
        rooms.append(SeenRoom(int(label), centroid, grid.to_points(outline), area))
    return rooms
