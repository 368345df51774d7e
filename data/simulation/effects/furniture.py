"""Shelves, cupboards and tables along the walls of rooms."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data.simulation.effects.boxes import UprightBox
from data.simulation.occupancy import CELL, Grid

Array = NDArray[np.float64]
PIECES = (  # depth, width, lowest and highest z above the floor, m
    ((0.3, 0.45), (0.8, 2.4), 0.0, (1.6, 1.9)),  # shelf
    ((0.4, 0.6), (0.8, 1.6), 0.0, (0.8, 1.4)),  # cupboard
    ((0.6, 0.8), (1.2, 1.8), 0.68, (0.72, 0.76)),  # table top
)
EACH = 3.0  # m2 of a room for each piece
MOST = 8  # pieces in a room
TRIES = 12  # places tried for each piece
DOORWAY = 1.0  # m about a door's middle that stays free


def furniture(
    grid: Grid, level: float, way: Array, radius: float, doors: Sequence[Array], rng: np.random.Generator
) -> list[UprightBox]:
    """Pieces that keep `radius` and 5 cm more from the way (N, 2) of the sensor, and from doors, triangles each."""
    trees = [(cKDTree(way), radius + 0.05)]
    if doors:
        trees.append((cKDTree(np.stack([door.reshape(-1, 3)[:, :2].mean(axis=0) for door in doors])), DOORWAY))
    pieces: list[UprightBox] = []
    taken = np.zeros_like(grid.room, dtype=bool)
    for k in range(len(grid.rooms)):
        cells = np.argwhere((grid.room == k) & (grid.clearance > 0) & (grid.clearance < 0.45))
        if not len(cells):
            continue
        count = min(MOST, int((grid.room == k).sum() * CELL**2 / EACH))
        for _ in range(count):
            piece = _placed(grid, cells, level, trees, taken, rng)
            if piece is not None:
                pieces.append(piece)
    return pieces


def _placed(
    grid: Grid, cells: NDArray[np.int_], level: float, trees: list[tuple[cKDTree, float]],
    taken: NDArray[np.bool_], rng: np.random.Generator,
) -> UprightBox | None:  # fmt: skip
    depths, widths, low, tops = PIECES[rng.choice(len(PIECES), p=(0.5, 0.25, 0.25))]
    for row, column in cells[rng.integers(len(cells), size=TRIES)]:
        depth, width, top = rng.uniform(*depths), rng.uniform(*widths), rng.uniform(*tops)
        box = _against_wall(grid, int(row), int(column), depth, width, level + low, level + top)
        if box is None:
            continue
        spots = box.footprint
        at = tuple(np.clip(grid.to_cells(spots), 0, np.array(grid.room.shape) - 1).T)
        stands = grid.clearance[at].min() > 0 and not taken[at].any()
        if stands and all(tree.query(spots)[0].min() > far for tree, far in trees):
            taken[at] = True
            return box
    return None


def _against_wall(
    grid: Grid, row: int, column: int, depth: float, width: float, low: float, high: float
) -> UprightBox | None:
    """A box with its back to the wall near a cell; None where the wall has no clear direction."""
    around = grid.clearance[row - 1 : row + 2, column - 1 : column + 2]
    if around.shape != (3, 3):
        return None
    away = np.array([around[:, 2].sum() - around[:, 0].sum(), around[2].sum() - around[0].sum()])
    if (length := float(np.linalg.norm(away))) < 3 * CELL:  # a corner, or the middle between two walls
        return None
    away /= length
    wall = grid.to_xy(np.array([row, column])) - (grid.clearance[row, column] - CELL) * away
    along = np.array([-away[1], away[0]])
    return UprightBox(wall + (depth / 2 + 0.01) * away, np.stack([depth / 2 * away, width / 2 * along]), low, high)
