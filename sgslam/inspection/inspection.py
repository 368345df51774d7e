"""Inspection of a plan before any robot drives: its defects, its self-similarity, and the rooms a robot must see."""

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

from data import SceneGraph
from data.synthetic_maps.exploration import storeys_of
from matching import Matcher
from matching.ambiguity.plan_checks import PlanIssue, count_walls, plan_issues, walls_without_room
from matching.ambiguity.rooms_to_localise import MatchCache, RoomsToLocalise, rooms_to_localise
from matching.ambiguity.symmetries import SelfSimilarity, SimilarPlace

BLOCK = 12  # start rooms of a storey that one process inspects, since their maps are partly the same
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Block = tuple[int, range]  # index of the storey, indices of its start rooms


@dataclass(frozen=True)
class RoomInspection:
    """One start room: how many rooms must be seen from there, and the places that resemble the room alone."""

    to_localise: RoomsToLocalise
    similar_places: tuple[SimilarPlace, ...]

    def to_dict(self) -> dict[str, Any]:
        """Its form in inspection.json."""
        return {**asdict(self.to_localise), "similar_places": [asdict(place) for place in self.similar_places]}


@dataclass(frozen=True)
class Inspection:
    """`similar_storeys` are the other places of whole storeys; `rooms` are the start rooms by their ids."""

    graph: SceneGraph
    notices: tuple[str, ...]
    issues: tuple[PlanIssue, ...]
    similar_storeys: tuple[SimilarPlace, ...]
    rooms: dict[str, RoomInspection]

    def to_dict(self) -> dict[str, Any]:
        """The form of inspection.json."""
        return {
            "notices": list(self.notices),
            "issues": [asdict(issue) for issue in self.issues],
            "storeys": [
                {"id": f.id, "name": f.name, "elevation": f.elevation, **self.counts(f.id)} for f in self.graph.floors
            ],
            "similar_storeys": [asdict(place) for place in self.similar_storeys],
            "rooms": [
                {"name": self.graph.room_by_id[room].name, **found.to_dict()} for room, found in self.rooms.items()
            ],
        }

    def counts(self, floor: str | None) -> dict[str, int]:
        """The number of rooms, wall surfaces, doors, and of walls that bound no room on a storey."""
        part = self.graph.on_floor(floor)
        return {
            "rooms": len(part.rooms), "wall_surfaces": len(part.wall_surfaces), "doors": len(part.doors),
            "walls_without_room": count_walls(walls_without_room(part.wall_surfaces)),
        }  # fmt: skip


@dataclass(frozen=True)
class InspectionSettings:
    """The matcher's name, the maximum number of maps of the same rooms, and the seed."""

    method: str = "learned"
    max_maps: int = 21
    seed: int = 0


def inspect(
    graph: SceneGraph, notices: tuple[str, ...] = (), settings: InspectionSettings | None = None, jobs: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Inspection:  # fmt: skip
    """Inspects an A-graph with `jobs` single-threaded processes; `progress` is called after each start room.

    Raises UserError for an unknown matcher.
    """
    blocks = [
        (index, range(start, min(start + BLOCK, len(s.rooms))))
        for index, s in enumerate(storeys_of(graph))
        for start in range(0, len(s.rooms), BLOCK)
    ]
    total = sum(len(starts) for _, starts in blocks)
    similarity = SelfSimilarity(graph)
    storeys = [[r.id for r in s.rooms if graph.surfaces_of_room[r.id]] for s in storeys_of(graph)]
    similar_storeys = tuple(place for rooms in storeys for place in similarity.similar_places(rooms))
    rooms = {}
    for done, found in enumerate(_inspected_rooms(graph, settings or InspectionSettings(), blocks, jobs), 1):
        rooms[found.to_localise.room] = found
        progress(done, total)
    return Inspection(graph, notices, tuple(plan_issues(graph)), similar_storeys, rooms)


def _inspected_rooms(
    graph: SceneGraph, settings: InspectionSettings, blocks: list[Block], jobs: int
) -> Iterator[RoomInspection]:
    if jobs == 1 or len(blocks) < 2:
        inspector = _RoomInspector(graph, settings)
        for block in blocks:
            yield from inspector(block)
        return
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(jobs, spawn, _initialise, (graph.to_dict(), settings)) as pool:
            for found in pool.map(_inspect_block, blocks):
                yield from found
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


class _RoomInspector:
    """The state of one process: the graph's self-similarity and the match cache of each storey."""

    def __init__(self, graph: SceneGraph, settings: InspectionSettings) -> None:
        self._similarity, matcher = SelfSimilarity(graph), Matcher.load(settings.method)
        self._caches = [
            MatchCache(graph, storey, index, matcher, settings.seed, settings.max_maps)
            for index, storey in enumerate(storeys_of(graph))
        ]

    def __call__(self, block: Block) -> Iterator[RoomInspection]:
        index, starts = block
        cache = self._caches[index]
        for start in starts:
            found = rooms_to_localise(cache, start, self._similarity)
            bare = found.outcome == "no walls"
            yield RoomInspection(found, () if bare else tuple(self._similarity.similar_places([found.room])))


_inspector: _RoomInspector | None = None  # of a process of the pool


def _initialise(graph: dict[str, Any], settings: InspectionSettings) -> None:
    global _inspector
    _inspector = _RoomInspector(SceneGraph.from_dict(graph), settings)


def _inspect_block(block: Block) -> list[RoomInspection]:
    assert _inspector is not None
    return list(_inspector(block))
