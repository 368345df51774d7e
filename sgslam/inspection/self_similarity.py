"""Where a building is its own twin: rooms and storeys that even a perfect map cannot tell from others."""

from collections.abc import Collection
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.exploration import Storey, storeys_of
from data.synthetic_maps.walks import perfect_map
from matching.ambiguity.symmetries import Symmetry, symmetries


@dataclass(frozen=True)
class Likeness:
    """Another place where `rooms` could as well be: on storey `floor`, turned there by `turned` rad.

    `others` are the rooms that each of them would be there, None where there is none; for `nats` see `Symmetry`.
    """

    rooms: tuple[str, ...]
    floor: str | None
    others: tuple[str | None, ...]
    turned: float
    nats: float

    def to_dict(self) -> dict[str, Any]:
        """Its form in inspection.json."""
        return asdict(self)


class OwnTwins:
    """Asks for the twins of perfect maps, and keeps the answers: many ways through a storey see the same rooms."""

    def __init__(self, a: SceneGraph) -> None:
        self._a = a
        self._known: dict[frozenset[str], list[Symmetry]] = {}
        self._storeys = {s.floor: s for s in storeys_of(a)}

    def of(self, rooms: Collection[str]) -> list[Symmetry]:
        """The other places of these rooms, which lie on one storey (see `matching.ambiguity.symmetries`)."""
        key = frozenset(rooms)
        if key not in self._known:
            self._known[key] = symmetries(perfect_map(self._a, key), self._a)
        return self._known[key]

    def likenesses(self, rooms: Collection[str]) -> list[Likeness]:
        """The same, with what the rooms would be there, the closest first."""
        own = [r for r in self._a.rooms if r.id in rooms]
        found = []
        for twin in self.of(rooms):
            there = self._storeys[twin.floor]
            at = se2.apply(np.array(twin.T_a_s), np.array([r.centroid for r in own]))
            others = tuple(_room_at(there, place) for place in at)
            turned = float(se2.wrap(np.array([twin.T_a_s[0]]))[0])
            found.append(Likeness(tuple(r.id for r in own), twin.floor, others, turned, twin.nats))
        return found


def _room_at(storey: Storey, place: np.ndarray) -> str | None:
    held = (r.id for k, r in enumerate(storey.rooms) if storey.holds(k, place[None]))
    return next(held, None)
