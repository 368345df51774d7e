"""Segments rooms in free space: distance transform, seeds, watershed; rooms with a neck too wide for a door are joined.

Bormann et al. (ICRA 2016) compare such room segmentations.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import expand_labels, watershed

from sgslam.config import RoomSettings
from sgslam.config.sensor import BUILDING
from sgslam.mapping.free_space import FreeSpace, Grid

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SeenRoom:
    """A room in the levelled map: label in the segmentation, centroid (2,), outline (M, 2), area m2."""

    label: int
    centroid: Floats
    polygon: Floats
    area: float


@dataclass(frozen=True)
class Passage:
    """A door or neck between two rooms: their labels and its centre (2,)."""

    rooms: tuple[int, int]
    middle: Floats


@dataclass(frozen=True)
class Segmentation:
    """`labels` (rows, columns): the room of each cell, 0 where there is none."""

    grid: Grid
    labels: NDArray[np.int32]
    rooms: list[SeenRoom]
    passages: list[Passage]

    def at(self, points: Floats) -> NDArray[np.int32]:
        """(N,) the labels at points (N, 2)."""
        return self.grid.look_up(self.labels, points)


def segment(space: FreeSpace, visited: Floats, settings: RoomSettings) -> Segmentation:
    """Segments free space into rooms. Only free space connected to the sensor places `visited` (K, 2) is used."""
    free = _reached(space, visited)
    clearance = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, 5) * space.grid.cell
    seeds, _ = _label(clearance > settings.seed_clearance)
    # cells in narrow places belong to the seed that their widest path leads to
    labels = watershed(-clearance, seeds, mask=free).astype(np.int32)
    labels = _join_wide_necks(labels, clearance, settings)
    rooms = _rooms(labels, space.grid, settings)
    kept = {room.label for room in rooms}
    labels[~np.isin(labels, list(kept))] = 0
    passages = [
        Passage(pair, space.grid.to_points(cells.mean(axis=0)[None])[0])
        for pair, cells in _borders(_over_lintels(labels, space)).items()
    ]
    return Segmentation(space.grid, labels, rooms, passages)


def _over_lintels(labels: NDArray[np.int32], space: FreeSpace) -> NDArray[np.int32]:
    """Lets rooms grow towards each other under lintels, so that those joined by a door meet there."""
    depth = BUILDING.door_depth / space.grid.cell
    grown = expand_labels(labels, distance=depth)
    # only the two faces of a lintel are seen, so the gap between them is closed
    window = np.ones((int(depth) + 1,) * 2, np.uint8)
    lintel = cv2.morphologyEx(space.lintel.astype(np.uint8), cv2.MORPH_CLOSE, window) > 0
    return np.where((labels == 0) & lintel & ~space.wall, grown, labels)


def _label(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    return labels, count


def _reached(space: FreeSpace, visited: Floats) -> NDArray[np.bool_]:
    labels, _ = _label(space.free)
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
        centroid = grid.to_points(np.array([[columns.mean(), rows.mean()]]))[0]
        rooms.append(SeenRoom(int(label), centroid, grid.to_points(outline), area))
    return rooms
