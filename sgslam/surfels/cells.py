"""The hash table of a surfel map: cells of three grids by their keys."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled

Ints = NDArray[np.int64]

SIDES = (1.0, 0.5, 0.25)  # m, of the cells
_PER_METRE = (1.0, 2.0, 4.0)  # their inverses
SHIFT = 0.11  # m, of the cells: walls at round distances from where a run begins are not on their borders
_BITS = 20  # of a cell's index along one axis


@compiled
def key_of(x: float, y: float, z: float, level: int) -> int:
    """The key of the cell of grid `level` that holds a point (m)."""
    half, per_metre = 1 << (_BITS - 1), _PER_METRE[level]
    i = math.floor((x + SHIFT) * per_metre) + half
    j = math.floor((y + SHIFT) * per_metre) + half
    k = math.floor((z + SHIFT) * per_metre) + half
    return int((((((i << _BITS) | j) << _BITS) | k) << 2) | level)


@compiled
def place_of(key: int, keys: Ints) -> int:
    """The place of a key in the hash table, or of the empty one where it belongs."""
    mask = len(keys) - 1
    place = ((key * 0x9E3779B97F4A7C1) >> 21) & mask
    while keys[place] != -1 and keys[place] != key:
        place = (place + 1) & mask
    return int(place)


@compiled
def rehash(keys: Ints, first: Ints, new_keys: Ints, new_first: Ints) -> None:
    """Copies all cells to a larger table."""
    for i in range(len(keys)):
        if keys[i] != -1:
            place = place_of(keys[i], new_keys)
            new_keys[place], new_first[place] = keys[i], first[i]
