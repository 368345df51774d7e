"""All storeys of a plan in one set of arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from matching.se2 import Array
from matching.walls import Index, Walls


@dataclass(frozen=True)
class PlanWalls:
    """The N wall surfaces of all storeys; coordinates are in each storey's own frame."""

    storeys: tuple[Walls, ...]
    first: Index  # (storeys + 1,) where each storey's walls begin
    centre: Array  # (N, 2)
    heading: Array  # (N,)
    half: Array  # (N,)
    known: NDArray[np.bool_]  # (N,) whether the length was given
    room: Index  # (N,) index into its storey's rooms, -1 where not known
    storey: Index  # (N,)

    def __len__(self) -> int:
        return len(self.half)

    @staticmethod
    def of(storeys: Sequence[Walls]) -> "PlanWalls":
        """Of one storey or more."""
        sizes = [len(w) for w in storeys]
        return PlanWalls(
            tuple(storeys), np.concatenate(([0], np.cumsum(sizes))), np.concatenate([w.centre for w in storeys]),
            np.concatenate([w.heading for w in storeys]), np.concatenate([w.half for w in storeys]),
            np.concatenate([w.known for w in storeys]),
            np.concatenate([w.room for w in storeys]),
            np.repeat(np.arange(len(sizes)), sizes),
        )  # fmt: skip
