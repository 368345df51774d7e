"""Where a building resembles itself: rooms and storeys that even a perfect map cannot tell from others."""

from collections.abc import Collection
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.exploration import Storey, storeys_of
from data.synthetic_maps.walks import perfect_map
from matching.ambiguity.symmetries import Symmetry, symmetries
from matching.engine.plan_walls import PlanWalls


@dataclass(frozen=True)
class SimilarPlace:
    """Another place that a map of `rooms` fits: on storey `floor`, after a rotation by `rotation` (rad).

    `counterparts` are the rooms that lie there, one for each of `rooms`, None where there is none. `nats` is the
    expected evidence against the place (see `matching.ambiguity.symmetries`).
    """

    rooms: tuple[str, ...]
    floor: str | None
    counterparts: tuple[str | None, ...]
    rotation: float
    nats: float

    def to_dict(self) -> dict[str, Any]:
        """Its form in inspection.json."""
        return asdict(self)


class SelfSimilarity:
    """Finds and caches the symmetries of perfect maps of an A-graph's rooms."""

    def __init__(self, a: SceneGraph) -> None:
        self._a, self._plan = a, PlanWalls.of(a)
        self._cache: dict[frozenset[str], list[Symmetry]] = {}
        self._storeys = {s.floor: s for s in storeys_of(a)}

    def symmetries(self, rooms: Collection[str]) -> list[Symmetry]:
        """The other placements of a perfect map of these rooms, which lie on one storey."""
        key = frozenset(rooms)
        if key not in self._cache:
            seen = perfect_map(self._a, key).s_graph
            self._cache[key] = [] if self._plan is None else symmetries(seen, self._plan)
        return self._cache[key]

    def similar_places(self, rooms: Collection[str]) -> list[SimilarPlace]:
        """The same placements with the rooms that lie there, the most similar first."""
        own = [r for r in self._a.rooms if r.id in rooms]
        found = []
        for placement in self.symmetries(rooms):
            storey = self._storeys.get(placement.floor)  # None where no room has walls, as among foundations
            centroids = se2.apply(np.array(placement.T_a_s), np.array([r.centroid for r in own]))
            counterparts = tuple(None if storey is None else _room_at(storey, point) for point in centroids)
            rotation = float(se2.wrap(np.array([placement.T_a_s[0]]))[0])
            ids = tuple(r.id for r in own)
            found.append(SimilarPlace(ids, placement.floor, counterparts, rotation, placement.nats))
        return found


def _room_at(storey: Storey, point: np.ndarray) -> str | None:
    containing = (r.id for k, r in enumerate(storey.rooms) if storey.holds(k, point[None]))
    return next(containing, None)
