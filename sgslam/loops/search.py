"""Searches for the place of a later pass in the plan view of an earlier one, as far as the map may have drifted.

Correlative scan matching (Olson, ICRA 2009) of contours on a grid of wall, free and unknown cells, where points in free
cells count against a place. A place is accepted only if no other one is nearly as good.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sgslam.config.loop_settings import LoopSettings
from sgslam.mapping.free_space import Grid

Floats = NDArray[np.float64]
_CELL = 0.1  # m
_REACH = 10.0  # m of each contour that is used; beyond, neighbouring columns are far apart
_WALL, _CLEAR = 0.15, 0.35  # m from a contour: up to here wall, from here on free
_STEP, _TURN = 0.2, 0.0175  # m, rad: of the coarse search
_FINE = ((0.05, 2, 0.006, 3), (0.02, 3, 0.003, 2))  # step, steps to each side, turn, turns to each side
_DISTINCT, _DISTINCT_TURN = 0.6, 0.1  # m, rad from the best place, beyond which a place is a different one
_CHUNK = 4_000_000  # look-ups at once


@dataclass(frozen=True)
class SeenSpace:
    """The plan view of one pass: cells are +1 at walls, -1 in free space, 0 where unknown."""

    grid: Grid
    cells: NDArray[np.int8]
    points: Floats  # (N, 2) of its contours, one for each cell

    @staticmethod
    def of(sensors: Floats, contours: list[Floats]) -> "SeenSpace":
        """Draws contours (M, 2) around sensors (K, 2), all in one frame."""
        near = [c[np.linalg.norm(c - s, axis=1) < _REACH] for s, c in zip(sensors, contours, strict=True)]
        cut = [_cut(s, c) for s, c in zip(sensors, contours, strict=True)]
        grid = Grid.around(np.concatenate([sensors, *cut]), _CELL)
        free = np.zeros(grid.shape, np.uint8)
        for outline in cut:
            if len(outline) >= 3:
                cv2.fillPoly(free, [grid.to_cells(outline)], 1)
        points = np.concatenate(near) if near else np.empty((0, 2))
        wall = np.ones(grid.shape, np.uint8)
        at = np.unique(grid.to_cells(points), axis=0)
        wall[at[:, 1], at[:, 0]] = 0
        away = cv2.distanceTransform(wall, cv2.DIST_L2, 3) * _CELL if len(at) else np.full(grid.shape, np.inf)
        cells = np.where(away <= _WALL, 1, np.where((free > 0) & (away > _CLEAR), -1, 0)).astype(np.int8)
        return SeenSpace(grid, cells, grid.to_points(at))

    def at(self, points: Floats) -> NDArray[np.int8]:
        """(...,) the values at points (..., 2); 0 beyond the grid."""
        at = np.rint((points - self.grid.origin) * (1 / self.grid.cell)).astype(np.int32)
        inside = ((at >= 0) & (at < [self.grid.shape[1], self.grid.shape[0]])).all(axis=-1)
        return np.where(inside, self.cells[at[..., 1] * inside, at[..., 0] * inside], 0)


@dataclass(frozen=True)
class Fit:
    """The best place of a later pass: `motion` (3,), yaw x y, moves it onto the earlier one.

    `overlap` is the share of its points in known space, `agreement` the share of these on walls less the share in free
    space, `runner_up` the agreement of the next best place.
    """

    motion: Floats
    overlap: float
    agreement: float
    runner_up: float


def agreement(space: SeenSpace, points: Floats) -> tuple[float, float]:
    """Overlap and agreement (see `Fit`) of points (N, 2) in the frame of `space`."""
    value = space.at(points).astype(np.int64)
    known = int(np.abs(value).sum())
    return known / max(len(value), 1), float(value.sum()) / max(known, 1)


def search(space: SeenSpace, points: Floats, centre: Floats, drift: float, turn: float, settings: LoopSettings) -> Fit:
    """The best place of points (N, 2), turned about `centre` (2,) by up to `turn` and moved by up to `drift`."""
    shifts = np.arange(-np.ceil(drift / _STEP), np.ceil(drift / _STEP) + 1) * _STEP
    moves = np.stack(np.meshgrid(shifts, shifts, indexing="ij"), axis=-1).reshape(-1, 2)
    moves = moves[np.hypot(*moves.T) <= drift + _STEP]
    turns = np.arange(-np.ceil(turn / _TURN), np.ceil(turn / _TURN) + 1) * _TURN
    known, total = _scores(space, points - centre, turns, moves + centre)
    # a small overlap is no evidence, however well it fits
    possible = known >= 0.5 * settings.overlap * len(points)
    score = np.where(possible, total / np.maximum(known, 1), -1.0)
    support = np.where(known >= settings.overlap * len(points), total, -len(points))
    best = np.unravel_index(int(support.argmax()), support.shape)
    elsewhere = np.hypot(*(moves - moves[best[1]]).T)[None] > _DISTINCT
    elsewhere = elsewhere | (np.abs(turns - turns[best[0]]) > _DISTINCT_TURN)[:, None]
    runner_up = float(np.where(elsewhere, score, -1.0).max())
    motion = np.array([turns[best[0]], *moves[best[1]]])
    for step, count, angle, angles in _FINE:
        side = np.arange(-count, count + 1) * step
        finer = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2) + motion[1:]
        about = np.arange(-angles, angles + 1) * angle + motion[0]
        known, total = _scores(space, points - centre, about, finer + centre)
        # the middle of what is equally good: the walls are as wide as the tolerance
        top = np.argwhere(total >= total.max() - 0.005 * len(points))
        motion = np.array([about[top[:, 0]].mean(), *finer[top[:, 1]].mean(axis=0)])
    placed = _moved(points, motion, centre)
    overlap, agreed = agreement(space, placed)
    return Fit(_about_origin(motion, centre), overlap, agreed, runner_up)


def _scores(space: SeenSpace, points: Floats, turns: Floats, moves: Floats) -> tuple[Floats, Floats]:
    """(A, S) how many points (N, 2) lie in known space, and how many more on walls than in free space, turned by each
    of (A,) and then moved by each of (S, 2)."""
    rows, columns = space.grid.shape
    reach = int(np.ceil(np.hypot(*points.T).max(initial=0.0) / _CELL)) + 1
    base = np.rint((moves - space.grid.origin) / _CELL).astype(np.int64)
    pad = np.maximum(0, np.stack([reach - base.min(axis=0), base.max(axis=0) + reach - [columns - 1, rows - 1]]))
    padded = np.pad(space.cells, ((pad[0, 1], pad[1, 1]), (pad[0, 0], pad[1, 0])))
    flat, width = padded.ravel(), padded.shape[1]
    # the residue of a move within its cell counts, or fine steps would all be one
    residue = moves - space.grid.origin - base * _CELL
    fine = np.abs(residue).max(initial=0.0) > 1e-9
    base += pad[0]
    known, total = np.empty((len(turns), len(moves))), np.empty((len(turns), len(moves)))
    for row, turn in enumerate(turns):
        c, s = np.cos(turn), np.sin(turn)
        turned = points @ np.array([[c, s], [-s, c]])
        for first in range(0, len(moves), chunk := max(1, _CHUNK // max(len(points), 1))):
            part = slice(first, first + chunk)
            if fine:
                cells = np.rint((turned[None] + residue[part, None]) / _CELL).astype(np.int32)
                where = (cells[..., 1] + base[part, 1, None]) * width + cells[..., 0] + base[part, 0, None]
            else:
                cells = np.rint(turned / _CELL).astype(np.int32)
                offsets = (base[part, 1] * width + base[part, 0]).astype(np.int32)
                where = offsets[:, None] + (cells[:, 1] * width + cells[:, 0])[None]
            value = flat.take(where)
            total[row, part] = value.sum(axis=1, dtype=np.int32)
            known[row, part] = np.count_nonzero(value, axis=1)
    return known, total


def _moved(points: Floats, motion: Floats, centre: Floats) -> Floats:
    c, s = np.cos(motion[0]), np.sin(motion[0])
    return (points - centre) @ np.array([[c, s], [-s, c]]) + centre + motion[1:]


def _about_origin(motion: Floats, centre: Floats) -> Floats:
    c, s = np.cos(motion[0]), np.sin(motion[0])
    return np.array([motion[0], *(motion[1:] + centre - np.array([[c, -s], [s, c]]) @ centre)])


def _cut(sensor: Floats, contour: Floats) -> Floats:
    away = contour - sensor
    distance = np.hypot(away[:, 0], away[:, 1])
    return sensor + away * np.minimum(1.0, _REACH / np.maximum(distance, 1e-9))[:, None]
