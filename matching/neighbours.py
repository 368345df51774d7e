"""The walls nearest to each wall: looked up among points along them, ranked by the gaps between the walls."""

import numpy as np

from data.compiled import compiled
from matching.se2 import Array
from matching.walls import Index, Walls

SAMPLED_M, SEARCHED = 2.0, 48  # points on walls, among the nearest of which the neighbours are looked up
IN_CELL = 12  # points, in the mean, of a cell of the grid that they are kept in


def nearest_walls(walls: Walls, size: int) -> tuple[Index, Array]:
    """(N, size) the nearest other walls, -1 where there are fewer, and their gaps in metres.

    The gap is from the nearer of one wall's ends and mid point to the other wall, the lesser way round. Only walls are
    ranked of which one has a point among the SEARCHED that are nearest to one of the other's.
    """
    count = 2 + np.ceil(2 * walls.half / SAMPLED_M).astype(np.int64)
    owner = np.repeat(np.arange(len(walls)), count)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    share = 2 * step / (count[owner] - 1) - 1
    points = walls.centre[owner] + (share * walls.half[owner])[:, None] * walls.tangent[owner]
    low = points.min(axis=0)
    wide, high = points.max(axis=0) - low
    side = max(np.sqrt(wide * high * IN_CELL / len(points)), (wide + high) * IN_CELL / len(points), 1e-3)
    column, row = ((points - low) / side).astype(np.int64).T
    columns, rows = column.max() + 1, row.max() + 1
    cell = row * columns + column
    order = np.argsort(cell, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    first = np.searchsorted(cell[order], np.arange(columns * rows + 1))
    return _nearest(
        np.ascontiguousarray((points - low)[order].T), owner[order], place, first, int(columns), float(side),
        walls.centre, walls.normal, walls.tangent, walls.half, size,
    )  # fmt: skip


@compiled
def _nearest(
    point: Array, owner: Index, place: Index, first: Index, columns: int, side: float,
    centre: Array, normal: Array, tangent: Array, half: Array, size: int,
) -> tuple[Index, Array]:  # fmt: skip
    """`point` (2, P) lie in the order of their cells, which begin at `first`, row by row; `place` (P,) tells where
    those of the first wall are, then those of the second, and so on."""
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
            gap = min(_gap(x, y, one, other, normal, tangent, half), _gap(-x, -y, other, one, normal, tangent, half))
            _ranked(one, other, gap, x, y, normal, tangent, nearest, gaps, cost)
            _ranked(other, one, gap, -x, -y, normal, tangent, nearest, gaps, cost)
    return nearest, gaps


@compiled
def _within(p: int, point: Array, first: Index, columns: int, side: float, among: Index, square: Array) -> int:
    """Writes which points are the SEARCHED nearest to p, itself and ties included, and returns how many."""
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
            for q in range(begin, end):
                among[count + q - begin] = q
                square[count + q - begin] = (point[0, q] - x) ** 2 + (point[1, q] - y) ** 2
            count += end - begin
        whole = count == point.shape[1]
        limit = np.inf if whole else (reach * side) ** 2  # points as near as that are all in the cells
        inside = 0
        for k in range(count):
            inside += square[k] <= limit
        if inside >= SEARCHED or whole:
            break
    if count > SEARCHED:
        limit = _limit(square, count, limit)
    kept = 0
    for k in range(count):
        if square[k] <= limit:
            among[kept] = among[k]
            kept += 1
    return kept


@compiled
def _limit(square: Array, count: int, high: float) -> float:
    """A number that SEARCHED of the squares, at least, are not above; more only where they are alike."""
    if not np.isfinite(high):
        high = square[:count].max()
    low = -1.0
    while high - low > 1e-9 * high:
        middle, inside = (low + high) / 2, 0
        for k in range(count):
            inside += square[k] <= middle
        if inside == SEARCHED:
            return middle
        low, high = (middle, high) if inside < SEARCHED else (low, middle)
    return high


@compiled
def _ranked(
    one: int, other: int, gap: float, x: float, y: float, normal: Array, tangent: Array,
    nearest: Index, gaps: Array, cost: Array,
) -> None:  # fmt: skip
    """Another wall takes its place among those of a wall, from whose centre it lies at (x, y)."""
    # Walls that meet have no gap at all: what else they have decides, so that the choice is no matter of rounding.
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
    """Metres from the ends and the mid point of another wall, which lies at (x, y) from a wall's centre, to this."""
    least = np.inf
    for end in (-1.0, 0.0, 1.0):
        u, v = x + end * half[other] * tangent[other, 0], y + end * half[other] * tangent[other, 1]
        past = max(abs(u * tangent[one, 0] + v * tangent[one, 1]) - half[one], 0.0)
        across = u * normal[one, 0] + v * normal[one, 1]
        least = min(least, across * across + past * past)
    return np.sqrt(least)
