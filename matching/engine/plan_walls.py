"""All storeys of a plan in one set of arrays."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.arrays import Doors, Index, Walls, storeys
from matching.arrays.walls import doors
from matching.engine.corners import Marks, corners

DIRECTION = 15  # degrees


@dataclass(frozen=True)
class PlanWalls:
    """The N wall surfaces of all storeys; coordinates are in each storey's own frame."""

    storeys: tuple[Walls, ...]
    doors: tuple[Doors, ...]  # of each storey
    first: Index  # (storeys + 1,) where each storey's walls begin
    centre: Array  # (N, 2)
    heading: Array  # (N,)
    half: Array  # (N,)
    known: NDArray[np.bool_]  # (N,) whether the length was given
    room: Index  # (N,) index into its storey's rooms, -1 where not known
    storey: Index  # (N,)

    def __len__(self) -> int:
        return len(self.half)

    @cached_property
    def lines(self) -> Array:
        """(N, 6) as those of `Walls`."""
        return np.concatenate([a.lines for a in self.storeys])

    @cached_property
    def by_heading(self) -> tuple[Index, Array, Array]:
        """(N,) the walls sorted by heading within each storey, these headings, and (6, N) their lines."""
        order = np.lexsort((self.heading, self.storey))
        return order, self.heading[order], np.ascontiguousarray(self.lines[order].T)

    @cached_property
    def corners(self) -> tuple[Marks, ...]:
        """The corners of each storey."""
        return tuple(corners(w) for w in self.storeys)

    @cached_property
    def met(self) -> tuple[Array, ...]:
        """For each storey (2, buildings, 360): the number of walls within 15 degrees of each direction, and their
        half lengths.
        """
        window = np.fft.rfft(np.minimum(np.arange(360), 360 - np.arange(360)) <= DIRECTION)
        found = []
        for a in self.storeys:
            degree = np.round(np.degrees(a.heading)).astype(np.int64) % 360
            total = np.zeros((2, len(a.building_areas), 360))
            np.add.at(total[0], (a.building, degree), 1.0)
            np.add.at(total[1], (a.building, degree), a.half)
            found.append(np.fft.irfft(np.fft.rfft(total) * window, 360))
        return tuple(found)

    @staticmethod
    def of(a: SceneGraph, floor: str | None = None) -> "PlanWalls | None":
        """Returns the walls of all storeys that have some, or of one of them; None if there are none."""
        chosen = [w for w in storeys(a) if floor is None or w.floor == floor]
        if not chosen:
            return None
        sizes = [len(w) for w in chosen]
        names = ("centre", "heading", "half", "known", "room")
        centre, heading, half, known, room = (np.concatenate([getattr(w, name) for w in chosen]) for name in names)
        return PlanWalls(
            tuple(chosen), tuple(doors(a, w) for w in chosen), np.concatenate(([0], np.cumsum(sizes))), centre, heading,
            half, known, room, np.repeat(np.arange(len(sizes)), sizes),
        )  # fmt: skip
