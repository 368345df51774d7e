"""The hash table of a surfel map: blocks of one cubic metre, each with its cells of three grids."""

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled

Ints = NDArray[np.int64]

SIDES = (1.0, 0.5, 0.25)  # m, of the cells
SHIFT = 0.11  # m, of the cells: walls at round distances from where a run begins are not on their borders
CELLS = 73  # of a block: one of the coarsest grid, then 8, then 64
_BITS = 21  # of a cell's index along one axis
HALF = 2.0 ** (_BITS - 1)  # cells, so that no index is negative


@compiled
def cell_of(x: float, y: float, z: float) -> tuple[int, int, int]:
    """The indices of the cell of the finest grid that holds a point (m); none is negative."""
    half = HALF + SHIFT / SIDES[2]
    return int(x / SIDES[2] + half), int(y / SIDES[2] + half), int(z / SIDES[2] + half)


@compiled
def key_of(cell: tuple[int, int, int], level: int) -> int:
    """The key, never zero, of the cell of grid `level` around a `cell` of the finest one."""
    up = 2 - level
    return ((((cell[0] >> up) << _BITS) | (cell[1] >> up)) << _BITS) | (cell[2] >> up)


@compiled
def place_of(key: int, table: Ints) -> int:
    """The row of a block's key in the hash `table` (T, 2) of keys and blocks, or the empty one where it belongs."""
    mask = len(table) - 1
    place = ((key * 0x9E3779B97F4A7C1) >> 21) & mask
    while table[place, 0] != 0 and table[place, 0] != key:
        place = (place + 1) & mask
    return place


@compiled
def block_of(cell: tuple[int, int, int], table: Ints) -> int:
    """The block that holds a `cell` of the finest grid; block 0, which has no surfels, where there is none."""
    return table[place_of(key_of(cell, 0), table), 1]


@compiled
def within_block(cell: tuple[int, int, int], level: int) -> int:
    """The column, of a block's row, of the cell of grid `level` around a `cell` of the finest one."""
    up, last = 2 - level, (1 << level) - 1
    i, j, k = (cell[0] >> up) & last, (cell[1] >> up) & last, (cell[2] >> up) & last
    return (level + (level == 2) * 7) + ((((i << level) | j) << level) | k)


@compiled
def rehash(table: Ints, larger: Ints) -> None:
    """Copies all blocks to a larger table."""
    for i in range(len(table)):
        if table[i, 0] != 0:
            place = place_of(table[i, 0], larger)
            for k in range(table.shape[1]):
                larger[place, k] = table[i, k]
