"""Match history: the earlier unique answer of a matcher, which a later one of a larger map may confirm."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph

_LATER = 6  # keyframes after which the same answer counts as a confirmation


@dataclass(frozen=True)
class MapSize:
    """Size of an S-graph: its rooms, and the total length (m) of its wall surfaces."""

    rooms: int = 0
    length: float = 0.0

    @staticmethod
    def of(graph: SceneGraph) -> "MapSize":
        """The size of an S-graph."""
        return MapSize(len(graph.rooms), sum(w.length or 0.0 for w in graph.wall_surfaces))

    def has_grown_since(self, last: "MapSize") -> bool:
        """Whether the map has gained a room, or a tenth of its wall length."""
        return self.rooms > last.rooms or self.length > 1.1 * last.length


@dataclass(frozen=True)
class UniqueMatch:
    """A unique answer: its storey, place (3,), T_local_level, and evidence `score` (nats, 0 where unknown).

    `map_size` and `keyframes` are those of the map that first gave the answer.
    """

    floor: str | None
    place: NDArray[np.float64]
    score: float
    map_size: MapSize
    keyframes: int

    def is_confirmable(self, keyframes: int) -> bool:
        """Whether enough keyframes were added for the same answer to confirm it."""
        return keyframes - self.keyframes >= _LATER

    def has_more_evidence_than(self, other: "UniqueMatch") -> bool:
        """Whether both the map and the evidence have grown since another answer."""
        return self.map_size.has_grown_since(other.map_size) and self.score > other.score
