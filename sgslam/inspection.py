"""All that can be said of a building's plan before a robot drives: what it lacks, its twins, rooms to be seen."""

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from data import SceneGraph
from data.s_graph_exploration import storeys_of
from sgslam.own_twins import Likeness, OwnTwins
from sgslam.plan_gaps import Gap, gaps
from sgslam.rooms_needed import RoomsNeeded, needed_from

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class RoomInspection:
    """A start room: what it is taken for when it is seen alone, and what must be seen from there."""

    needed: RoomsNeeded
    alone: tuple[Likeness, ...]

    def to_dict(self) -> dict[str, Any]:
        """Its form in inspection.json."""
        return {**asdict(self.needed), "alone_like": [like.to_dict() for like in self.alone]}


@dataclass(frozen=True)
class Inspection:
    """`storey_twins` are other places of whole storeys. `rooms`: those of storeys with walls, by their ids."""

    graph: SceneGraph
    notices: tuple[str, ...]
    gaps: tuple[Gap, ...]
    storey_twins: tuple[Likeness, ...]
    rooms: dict[str, RoomInspection]

    def to_dict(self) -> dict[str, Any]:
        """The form of inspection.json."""
        return {
            "notices": list(self.notices),
            "gaps": [gap.to_dict() for gap in self.gaps],
            "storeys": [
                {"id": f.id, "name": f.name, "elevation": f.elevation, **self.counts(f.id)} for f in self.graph.floors
            ],
            "storey_twins": [twin.to_dict() for twin in self.storey_twins],
            "rooms": [
                {"name": self.graph.room_by_id[room].name, **found.to_dict()} for room, found in self.rooms.items()
            ],
        }

    def counts(self, floor: str | None) -> dict[str, int]:
        """How much of each kind a storey holds."""
        part = self.graph.on_floor(floor)
        return {"rooms": len(part.rooms), "wall_surfaces": len(part.wall_surfaces), "doors": len(part.doors)}


@dataclass(frozen=True)
class Ask:
    """How rooms are asked after: the matcher's name, maps of each start, seed."""

    method: str = "learned"
    maps: int = 5
    seed: int = 0


def inspect(
    graph: SceneGraph, notices: tuple[str, ...] = (), ask: Ask | None = None, jobs: int = 1,
    tell: Callable[[int, int], None] = lambda done, of: None,
) -> Inspection:  # fmt: skip
    """Looks at all of it with so many processes of one thread each; `tell` is called after each start room.

    Raises UserError for a matcher that does not exist.
    """
    starts = [(place, start) for place, s in enumerate(storeys_of(graph)) for start in range(len(s.rooms))]
    own = OwnTwins(graph)
    whole = [[r.id for r in s.rooms if graph.surfaces_of_room[r.id]] for s in storeys_of(graph)]
    twins = tuple(like for rooms in whole for like in own.likenesses(rooms))
    rooms = {}
    for done, found in enumerate(_asked(graph, ask or Ask(), starts, jobs), 1):
        rooms[found.needed.room] = found
        tell(done, len(starts))
    return Inspection(graph, notices, tuple(gaps(graph)), twins, rooms)


def _asked(graph: SceneGraph, ask: Ask, starts: list[tuple[int, int]], jobs: int) -> Iterator[RoomInspection]:
    if jobs == 1 or len(starts) < 2:
        yield from map(_Asker(graph, ask), starts)
        return
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(jobs, spawn, _begin, (graph.to_dict(), ask)) as pool:
            yield from pool.map(_one, starts)
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


class _Asker:
    """What one process keeps: the graph, the matcher, and the twins that it knows."""

    def __init__(self, graph: SceneGraph, ask: Ask) -> None:
        from matching import Matcher

        self._graph, self._ask, self._own = graph, ask, OwnTwins(graph)
        self._matcher = Matcher.load(ask.method)

    def __call__(self, at: tuple[int, int]) -> RoomInspection:
        place, start = at
        storey = storeys_of(self._graph)[place]
        rngs = [np.random.default_rng((self._ask.seed, place, start, n)) for n in range(self._ask.maps)]
        needed = needed_from(storey, start, self._graph, self._matcher, rngs, self._own)
        nothing = needed.outcome == "nothing to see"
        return RoomInspection(needed, () if nothing else tuple(self._own.likenesses([needed.room])))


_asker: _Asker | None = None  # of a process of the pool


def _begin(graph: dict[str, Any], ask: Ask) -> None:
    global _asker
    _asker = _Asker(SceneGraph.from_dict(graph), ask)


def _one(at: tuple[int, int]) -> RoomInspection:
    assert _asker is not None
    return _asker(at)
