"""All that can be said of a building's plan before a robot drives: what it lacks, its twins, rooms to be seen."""

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

from data import SceneGraph
from data.synthetic_maps.exploration import storeys_of
from matching.ambiguity.match_cache import AskedMaps
from matching.ambiguity.plan_checks import Gap, gaps
from matching.ambiguity.rooms_to_localise import RoomsNeeded, needed_from
from matching.ambiguity.self_similarity import Likeness, OwnTwins

BLOCK = 12  # start rooms of a storey of which one answer spares another; the same with any number of processes
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Block = tuple[int, range]  # the place of a storey, and of start rooms in it


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
    """How rooms are asked after: the matcher's name, maps of the same rooms at most, seed."""

    method: str = "learned"
    maps: int = 21
    seed: int = 0


def inspect(
    graph: SceneGraph, notices: tuple[str, ...] = (), ask: Ask | None = None, jobs: int = 1,
    tell: Callable[[int, int], None] = lambda done, of: None,
) -> Inspection:  # fmt: skip
    """Looks at all of it with so many processes of one thread each; `tell` is called as start rooms are done.

    Raises UserError for a matcher that does not exist.
    """
    blocks = [
        (place, range(start, min(start + BLOCK, len(s.rooms))))
        for place, s in enumerate(storeys_of(graph))
        for start in range(0, len(s.rooms), BLOCK)
    ]
    of = sum(len(starts) for _, starts in blocks)
    own = OwnTwins(graph)
    whole = [[r.id for r in s.rooms if graph.surfaces_of_room[r.id]] for s in storeys_of(graph)]
    twins = tuple(like for rooms in whole for like in own.likenesses(rooms))
    rooms = {}
    for done, found in enumerate(_asked(graph, ask or Ask(), blocks, jobs), 1):
        rooms[found.needed.room] = found
        tell(done, of)
    return Inspection(graph, notices, tuple(gaps(graph)), twins, rooms)


def _asked(graph: SceneGraph, ask: Ask, blocks: list[Block], jobs: int) -> Iterator[RoomInspection]:
    if jobs == 1 or len(blocks) < 2:
        asker = _Asker(graph, ask)
        for block in blocks:
            yield from asker(block)
        return
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(jobs, spawn, _begin, (graph.to_dict(), ask)) as pool:
            for found in pool.map(_all_of, blocks):
                yield from found
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


class _Asker:
    """What one process keeps: the graph, its twins, and what the matcher answered on each storey."""

    def __init__(self, graph: SceneGraph, ask: Ask) -> None:
        from matching import Matcher

        self._own, matcher = OwnTwins(graph), Matcher.load(ask.method)
        self._maps = [
            AskedMaps(graph, storey, place, matcher, ask.seed, ask.maps)
            for place, storey in enumerate(storeys_of(graph))
        ]

    def __call__(self, block: Block) -> Iterator[RoomInspection]:
        place, starts = block
        maps = self._maps[place]
        maps.forget_perfect()
        for start in starts:
            needed = needed_from(maps, start, self._own)
            nothing = needed.outcome == "nothing to see"
            yield RoomInspection(needed, () if nothing else tuple(self._own.likenesses([needed.room])))


_asker: _Asker | None = None  # of a process of the pool


def _begin(graph: dict[str, Any], ask: Ask) -> None:
    global _asker
    _asker = _Asker(SceneGraph.from_dict(graph), ask)


def _all_of(block: Block) -> list[RoomInspection]:
    assert _asker is not None
    return list(_asker(block))
