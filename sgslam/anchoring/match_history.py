"""What a matcher earlier of a map, and whether a later answer, of a larger map, bears it out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph

_LATER = 6  # keyframes after which another answer tells more


@dataclass(frozen=True)
class MapSize:
    """What of the S-graph can change the answer."""

    rooms: int = 0
    length: float = 0.0

    @staticmethod
    def of(graph: SceneGraph) -> "MapSize":
        """That of an S-graph."""
        return MapSize(len(graph.rooms), sum(w.length or 0.0 for w in graph.wall_surfaces))

    def has_grown_since(self, last: "MapSize") -> bool:
        """Whether it has a room more, or a tenth of its walls."""
        return self.rooms > last.rooms or self.length > 1.1 * last.length


@dataclass(frozen=True)
class UniqueMatch:
    """A unique answer: the storey and place (3,) T_local_level that it names, its evidence (nats; 0 where it tells
    none), and the map that it was first given of."""

    floor: str | None
    place: NDArray[np.float64]
    score: float
    map_size: MapSize
    keyframes: int

    def is_confirmable(self, keyframes: int) -> bool:
        """Whether so much was seen since that the same answer would bear it out."""
        return keyframes - self.keyframes >= _LATER

    def has_more_evidence_than(self, other: "UniqueMatch") -> bool:
        """Whether the map has grown since another answer, and the evidence with it."""
        return self.map_size.has_grown_since(other.map_size) and self.score > other.score
