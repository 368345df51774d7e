"""Sorts a levelled scan into azimuth columns: points on upright surfaces, and a virtual 2D scan."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled

Floats = NDArray[np.float64]
Contour = tuple[NDArray[np.int64], Floats]  # columns (M,), and x y (M, 2) of the one point of each
_RING_STEP = 0.014  # of z over distance; closer points of one column belong to one ring
_WIDEST = 8 * _RING_STEP  # likewise; no surface is followed across wider gaps, unless the rings are as far apart
_MISSING = 1.5  # of the usual step between rings: below it, no ring between two points is missing
_LAGS = 4  # neighbours within a column that are compared


@dataclass(frozen=True)
class ColumnScan:
    """Points sorted by azimuth column, low elevations first within a column."""

    points: Floats  # (N, 3)
    column: NDArray[np.int64]  # (N,)
    columns: int
    upright: NDArray[np.bool_]  # (N,) a neighbour above or below is at the same distance


def sort_into_columns(points: Floats, columns: int) -> ColumnScan:
    """Sorts roughly levelled points (N, 3) by azimuth; classifies each by its neighbours in its column."""
    # single precision is sufficient and several times faster
    x, y, z = (np.ascontiguousarray(points[:, i], dtype=np.float32) for i in range(3))
    # the x axis is at the centre of a column, not between two: beams at regular angles begin there
    azimuth = np.arctan2(y, x)
    column = (azimuth * np.float32(columns / (2 * np.pi)) + np.float32(columns / 2 + 0.5)).astype(np.uint16)
    column[column >= columns] = 0
    distance = np.sqrt(x * x + y * y) + np.float32(1e-9)
    slope = z / distance
    # numpy sorts 16 bits stably by radix, several times faster than one comparison sort of both keys
    rank = (np.clip(slope + 2, 0, 4) * 16000).astype(np.uint16)
    order = np.argsort(rank, kind="stable")
    order = order[np.argsort(column[order], kind="stable")]
    points, column = points.take(order, axis=0), column[order]
    distance, slope, z = distance[order], slope[order], z[order]
    upright = np.zeros(len(points), bool)
    steps = np.diff(slope)[column[1:] == column[:-1]]
    rings = steps[steps > _RING_STEP]
    widest = max(_WIDEST, _MISSING * float(np.median(rings))) if len(rings) else _WIDEST
    for lag in range(1, min(_LAGS, len(points) - 1) + 1):
        step = slope[lag:] - slope[:-lag]
        pair = (column[lag:] == column[:-lag]) & (step > _RING_STEP) & (step < widest)
        away = np.abs(distance[lag:] - distance[:-lag])
        rise = np.abs(z[lag:] - z[:-lag])
        holds = pair & (away < 0.06 + 0.1 * rise)
        upright[lag:] |= holds
        upright[:-lag] |= holds
        if 2 * np.count_nonzero(pair) > len(points):
            break  # the rings are far enough apart for the nearest neighbours to decide
    return ColumnScan(points, column.astype(np.int64), columns, upright)


def contour(scan: ColumnScan, band: tuple[float, float]) -> Contour:
    """The columns (M,) with upright points between the heights of `band` (m), and the x y (M, 2) of each one's point of
    median distance."""
    return _contour(scan.points, scan.column, scan.upright, scan.columns, *band)


@compiled
def _contour(
    points: Floats, column: NDArray[np.int64], upright: NDArray[np.bool_], columns: int, low: float, high: float
) -> Contour:
    filled, xy = np.empty(columns, np.int64), np.empty((columns, 2))
    squared, own = np.empty(len(points)), np.empty(len(points), np.int64)  # of one column's points, nearest first
    count, found = 0, 0
    for i in range(len(points)):
        if upright[i] and low < points[i, 2] < high:
            k, away = found, points[i, 0] ** 2 + points[i, 1] ** 2
            while k and squared[k - 1] > away:
                squared[k], own[k] = squared[k - 1], own[k - 1]
                k -= 1
            squared[k], own[k] = away, i
            found += 1
        if found and (i + 1 == len(points) or column[i + 1] != column[i]):
            median = own[found // 2]
            filled[count], xy[count, 0], xy[count, 1] = column[i], points[median, 0], points[median, 1]
            count, found = count + 1, 0
    return filled[:count], xy[:count]


@compiled
def _length(v: Floats) -> float:
    return math.hypot(v[0], v[1])


@compiled
def split_chains(xy: Floats, column: NDArray[np.int64], step_angle: float, tolerance: float) -> list[tuple[int, int]]:
    """Splits an ordered contour (M, 2) into straight pieces [first, last], by jumps, then by distance to the chord.

    `step_angle` is the angle between two columns. (Split of split-and-merge; Pavlidis and Horowitz 1974.)
    """
    pieces, first = [(0, 0) for _ in range(0)], 0
    for end in range(1, len(xy) + 1):
        if end < len(xy):
            step, apart = _length(xy[end] - xy[end - 1]), column[end] - column[end - 1]
            nearer = min(_length(xy[end]), _length(xy[end - 1]))
            # neighbouring beams on a wall met at 8 degrees are this far apart; beyond it the contour is broken
            if step <= 0.10 + nearer * apart * step_angle * 7.0 and apart <= 6:
                continue
        pending = [(first, end - 1)]
        first = end
        while pending:  # the front part is the last that was put there
            a, b = pending.pop()
            if b - a < 2:
                continue
            dx, dy = xy[b] - xy[a]
            worst, most = a, -1.0
            for i in range(a, b + 1):  # across the chord, times its length
                across = abs((xy[i, 1] - xy[a, 1]) * dx - (xy[i, 0] - xy[a, 0]) * dy)
                if across > most:
                    worst, most = i, across
            if most <= tolerance * (math.hypot(dx, dy) + 1e-9):
                pieces.append((a, b))
            else:
                pending.append((worst, b))
                pending.append((a, worst))
    return pieces
