"""The nearest walls of each wall: candidates from points along the walls, ranked by the gaps between walls."""

import numpy as np

from data.common.compiled import compiled
from data.geometry.se2 import Array
from matching.arrays.walls import Index, Walls

SAMPLED_M, SEARCHED = 2.0, 48  # points on walls, among the nearest of which the neighbours are looked up
IN_CELL = 16  # points, in the mean, of a cell of the grid that they are kept in


def nearest_walls(walls: Walls, size: int) -> tuple[Index, Array]:
    """Returns (N, size) the nearest other walls, -1 where there are fewer, and their gaps in metres.

    The gap is the distance from the nearest of one wall's ends and mid point to the other wall, the smaller of both
    directions. Only walls are ranked that have a point among the SEARCHED nearest points of the other one.
    """
    points, owner = _points(walls.centre, walls.tangent, walls.half)
    points -= points.min(axis=0)
    wide, high = points.max(axis=0)
    side = max(np.sqrt(wide * high * IN_CELL / len(points)), (wide + high) * IN_CELL / len(points), 1e-3)
    point, owner, place, first, columns = _celled(points, owner, float(side))
    return _nearest(
        point, owner, place, first, columns, float(side), walls.centre, walls.normal, walls.tangent, walls.half, size
    )


@compiled
def _points(centre: Array, tangent: Array, half: Array) -> tuple[Array, Index]:
    """(P, 2) points along the walls, from end to end, and (P,) the walls they belong to."""
    count = 2 + np.ceil(2 * half / SAMPLED_M).astype(np.int64)
    points, owner, at = np.empty((count.sum(), 2)), np.empty(count.sum(), dtype=np.int64), 0
    for i in range(len(half)):
        for step in range(count[i]):
            along = (2 * step / (count[i] - 1) - 1) * half[i]
            points[at, 0], points[at, 1] = centre[i, 0] + along * tangent[i, 0], centre[i, 1] + along * tangent[i, 1]
            owner[at] = i
            at += 1
    return points, owner


@compiled
def _celled(points: Array, owner: Index, side: float) -> tuple[Array, Index, Index, Index, int]:
    """Sorts points with non-negative coordinates into grid cells.

    Returns (2, P) the points in the order of their cells, row by row, the walls they belong to, where each point is
    now, where each cell begins, and the number of columns of cells.
    """
    cell, last = np.empty(len(points), dtype=np.int64), (int(points[:, 0].max() / side), int(points[:, 1].max() / side))
    first = np.zeros((last[0] + 1) * (last[1] + 1) + 1, dtype=np.int64)
    for p in range(len(points)):
        cell[p] = int(points[p, 1] / side) * (last[0] + 1) + int(points[p, 0] / side)
        first[cell[p] + 1] += 1
    first = np.cumsum(first)
    ordered, walls, place, free = np.empty((2, len(points))), np.empty_like(owner), np.empty_like(owner), first.copy()
    for p in range(len(points)):
        at = free[cell[p]]
        free[cell[p]] += 1
        ordered[0, at], ordered[1, at], walls[at], place[p] = points[p, 0], points[p, 1], owner[p], at
    return ordered, walls, place, first, last[0] + 1


@compiled
def _nearest(
    point: Array, owner: Index, place: Index, first: Index, columns: int, side: float,
    centre: Array, normal: Array, tangent: Array, half: Array, size: int,
) -> tuple[Index, Array]:  # fmt: skip
    """Finds the nearest walls. `point` (2, P) is in the order of cells, which begin at `first`; `place` (P,) says where
    the points of the first wall are, then those of the second, and so on.
    """
    walls, points = len(half), point.shape[1]
    nearest, gaps, cost = np.full((walls, size), -1), np.full((walls, size), np.inf), np.full((walls, size), np.inf)
    among, square, met = np.empty(points, dtype=np.int64), np.empty(points), np.full(walls, -1)
    for p in place:
        one = owner[p]
        for k in range(_within(p, point, first, columns, side, among, square)):
            other = owner[among[k]]
            if other == one or met[other] == one:
                continue
            met[other] = one
            x, y = centre[other, 0] - centre[one, 0], centre[other, 1] - centre[one, 1]
            least = 1.02 * np.sqrt(x * x + y * y) - half[one] - half[other]  # of what is worked out to rank them
            if least > cost[one, size - 1] and least > cost[other, size - 1]:
                continue
            gap = np.sqrt(
                min(_gap(x, y, one, other, normal, tangent, half), _gap(-x, -y, other, one, normal, tangent, half))
            )
            _ranked(one, other, gap, x, y, normal, tangent, nearest, gaps, cost)
            _ranked(other, one, gap, -x, -y, normal, tangent, nearest, gaps, cost)
    return nearest, gaps


@compiled
def _within(p: int, point: Array, first: Index, columns: int, side: float, among: Index, square: Array) -> int:
    """Writes the SEARCHED points nearest to p, itself and ties included, and returns their number."""
    rows = (len(first) - 1) // columns
    x, y = point[0, p], point[1, p]
    column, row = int(x / side), int(y / side)
    reach = 0
    while True:
        reach += 1
        count = 0
        for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
            begin = first[r * columns + max(column - reach, 0)]
            end = first[r * columns + min(column + reach, columns - 1) + 1]
            _looked_at(point, begin, end, x, y, among[count:], square[count:])
            count += end - begin
        whole = count == point.shape[1]
        limit = np.inf if whole else (reach * side) ** 2  # points as near as that are all in the cells
        inside = _inside(square[:count], limit)
        if inside >= SEARCHED or whole:
            break
    if count > SEARCHED:
        limit = _limit(square[:count], square[:count].max() if whole else limit, inside)
    kept = 0
    for k in range(count):
        among[kept] = among[k]
        kept += square[k] <= limit
    return kept


@compiled
def _looked_at(point: Array, begin: int, end: int, x: float, y: float, among: Index, square: Array) -> None:
    """Writes consecutive points and their squared distances; compiles to vector code."""
    point_x, point_y = point[0, begin:end], point[1, begin:end]
    for k in range(len(point_x)):
        among[k] = begin + k
        square[k] = (point_x[k] - x) ** 2 + (point_y[k] - y) ** 2


@compiled
def _inside(square: Array, limit: float) -> int:
    """How many of the squares are not above a limit."""
    count = 0
    for k in range(len(square)):
        count += square[k] <= limit
    return count


@compiled
def _limit(square: Array, high: float, above: int) -> float:
    """A bound that at least SEARCHED of the squares are not above, more only in case of ties. `above` are not above
    `high`.
    """
    low, below = -1e-9, 0
    while high - low > 1e-9 * max(high, 1e-9):
        share = (SEARCHED + 0.5 - below) / (above - below)  # as if they lay evenly between the bounds
        middle = low + min(max(share, 0.1), 0.9) * (high - low)
        inside = _inside(square, middle)
        if inside == SEARCHED:
            return middle
        if inside < SEARCHED:
            low, below = middle, inside
        else:
            high, above = middle, inside
    return high


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
