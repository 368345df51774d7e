"""The nearest walls of each wall: candidates from points along the walls, ranked by the gaps between walls."""

import numpy as np

from data.common.compiled import compiled
from data.geometry.se2 import Array
from matching.arrays.walls import Index, Walls, points_along

SAMPLED_M, SEARCHED = 2.0, 48  # points on walls, among the nearest of which the neighbours are looked up
IN_CELL = 16  # points, in the mean, of a cell of the grid that they are kept in


def nearest_walls(walls: Walls, size: int) -> tuple[Index, Array]:
    """Returns (N, size) the nearest other walls, -1 where there are fewer, and their gaps in metres.

    The gap is the distance from the nearest of one wall's ends and mid point to the other wall, the smaller of both
    directions. Only walls are ranked that have a point among the SEARCHED nearest points of the other one.
    """
    count = 2 + np.ceil(2 * walls.half / SAMPLED_M).astype(np.int64)
    points, owner = points_along(walls.centre, walls.tangent, walls.half, count)
    points -= points.min(axis=0)
    wide, high = points.max(axis=0)
    side = max(np.sqrt(wide * high * IN_CELL / len(points)), (wide + high) * IN_CELL / len(points), 1e-3)
    column, row = (points / side).astype(np.int64).T
    columns = int(column.max()) + 1
    cell = row * columns + column
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange((int(row.max()) + 1) * columns + 1))
    return _nearest(
        np.ascontiguousarray(points[order].T), owner[order], np.argsort(order), first, columns, float(side),
        walls.centre, walls.normal, walls.tangent, walls.half, size,
    )  # fmt: skip


@compiled
def _nearest(
    point: Array, owner: Index, place: Index, first: Index, columns: int, side: float,
    centre: Array, normal: Array, tangent: Array, half: Array, size: int,
) -> tuple[Index, Array]:  # fmt: skip
    """Finds the nearest walls. `point` (2, P) is in the order of cells, which begin at `first`; `place` (P,) says where
    the points of the first wall are, then those of the second, and so on.
    """
    walls = len(half)
    nearest, gaps, cost = np.full((walls, size), -1), np.full((walls, size), np.inf), np.full((walls, size), np.inf)
    met, among, square = np.full(walls, -1), np.empty_like(owner), np.empty(len(owner))
    for p in place:
        one = owner[p]
        for near in _within(p, point, first, columns, side, among, square):
            other = owner[near]
            if other == one or met[other] == one:
                continue
            met[other] = one
            x, y = centre[other, 0] - centre[one, 0], centre[other, 1] - centre[one, 1]
            gap = np.sqrt(
                min(_gap(x, y, one, other, normal, tangent, half), _gap(-x, -y, other, one, normal, tangent, half))
            )
            _ranked(one, other, gap, x, y, normal, tangent, nearest, gaps, cost)
            _ranked(other, one, gap, -x, -y, normal, tangent, nearest, gaps, cost)
    return nearest, gaps


@compiled
def _within(p: int, point: Array, first: Index, columns: int, side: float, among: Index, square: Array) -> Index:
    """The SEARCHED points nearest to p, itself and ties included; `among` and `square` (P,) are room to work in."""
    rows, points = (len(first) - 1) // columns, point.shape[1]
    x, y = point[0, p], point[1, p]
    column, row = int(x / side), int(y / side)
    reach = 0
    while True:
        reach += 1
        count = 0
        for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
            begin = first[r * columns + max(column - reach, 0)]
            end = first[r * columns + min(column + reach, columns - 1) + 1]
            for k in range(begin, end):
                among[count], square[count] = k, (point[0, k] - x) ** 2 + (point[1, k] - y) ** 2
                count += 1
        limit = (reach * side) ** 2  # points as near as that are all among them
        if count == points or _inside(square[:count], limit) >= SEARCHED:
            break
    if count <= SEARCHED:
        return among[:count]
    # The least bound that SEARCHED are within, by bisection: counting is faster than sorting.
    low, high = 0.0, limit if count < points else square[:count].max()
    while high - low > 1e-9 * max(high, 1e-9):
        middle = (low + high) / 2
        inside = _inside(square[:count], middle)
        low, high = (middle, high) if inside < SEARCHED else (low, middle)
        if inside == SEARCHED:
            break
    kept = 0
    for k in range(count):
        among[kept] = among[k]
        kept += square[k] <= high
    return among[:kept]


@compiled
def _inside(square: Array, limit: float) -> int:
    """How many of the squares are not above a limit; compiles to vector code."""
    count = 0
    for k in range(len(square)):
        count += square[k] <= limit
    return count


@compiled
def _ranked(
    one: int, other: int, gap: float, x: float, y: float, normal: Array, tangent: Array,
    nearest: Index, gaps: Array, cost: Array,
) -> None:  # fmt: skip
    """Inserts another wall at (x, y) from a wall's centre into its ranking."""
    # Walls that meet have no gap; other properties decide, so that rounding does not.
    beside = x * (normal[one, 0] + 2 * tangent[one, 0]) + y * (normal[one, 1] + 2 * tangent[one, 1])
    new = gap + 0.03 * np.sqrt(x * x + y * y) + 0.001 * beside
    size = at = nearest.shape[1]
    if not new < cost[one, size - 1]:
        return
    for k in range(size):
        if nearest[one, k] == other:
            return
    while at > 0 and new < cost[one, at - 1]:
        at -= 1
        if at + 1 < size:
            nearest[one, at + 1], gaps[one, at + 1] = nearest[one, at], gaps[one, at]
            cost[one, at + 1] = cost[one, at]
    nearest[one, at], gaps[one, at], cost[one, at] = other, gap, new


@compiled
def _gap(x: float, y: float, one: int, other: int, normal: Array, tangent: Array, half: Array) -> float:
    """The squared distance in metres from the ends and mid point of another wall, at (x, y) from a wall's centre, to
    this.
    """
    least = np.inf
    for end in (-1.0, 0.0, 1.0):
        u, v = x + end * half[other] * tangent[other, 0], y + end * half[other] * tangent[other, 1]
        past = max(abs(u * tangent[one, 0] + v * tangent[one, 1]) - half[one], 0.0)
        across = u * normal[one, 0] + v * normal[one, 1]
        least = min(least, across * across + past * past)
    return least
