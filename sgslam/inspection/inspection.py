"""Inspection of a plan before any robot drives: its defects, its self-similarity, and the rooms a robot must see."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from threadpoolctl import threadpool_limits

from data import SceneGraph
from data.common.processes import completed
from data.synthetic_maps.exploration import storeys_of
from matching import Matcher
from matching.ambiguity.plan_checks import PlanIssue, count_walls, plan_issues, walls_without_room
from matching.ambiguity.rooms_to_localise import MatchCache, RoomsToLocalise, rooms_to_localise
from matching.ambiguity.symmetries import SelfSimilarity, SimilarPlace
from matching.matcher import DEFAULT

_BLOCK = 12  # start rooms of a storey that one process inspects, since their maps are partly the same

Block = tuple[int, range]  # index of the storey, indices of its start rooms


@dataclass(frozen=True)
class RoomInspection:
    """One start room: how many rooms must be seen from there, and the places that resemble the room alone."""

    to_localise: RoomsToLocalise
    similar_places: tuple[SimilarPlace, ...]

    def to_dict(self) -> dict[str, Any]:
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
        counts = {name: len(getattr(part, name)) for name in ("rooms", "wall_surfaces", "doors")}
        return counts | {"walls_without_room": count_walls(walls_without_room(part.wall_surfaces))}


def inspect(
    graph: SceneGraph,
    notices: tuple[str, ...] = (),
    method: str = DEFAULT,
    maps: int = 21,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Inspection:
    """Inspects an A-graph with `jobs` single-threaded processes; `progress` is called as start rooms are done.

    `method` is the matcher's name, `maps` the maximum number of maps of the same rooms. Raises UserError for an
    unknown matcher.
    """
    blocks = [
        (index, range(start, min(start + _BLOCK, len(s.rooms))))
        for index, s in enumerate(storeys_of(graph))
        for start in range(0, len(s.rooms), _BLOCK)
    ]
    work = partial(_inspect_block, graph, method, maps, seed)
    found: dict[Block, list[RoomInspection]] = {}
    alone = jobs == 1 or len(blocks) < 2
    for block, own in ((block, work(block)) for block in blocks) if alone else completed(work, blocks, jobs):
        if isinstance(own, BaseException):
            raise own
        found[block] = own
        progress(sum(map(len, found.values())), sum(len(starts) for _, starts in blocks))
    similarity = SelfSimilarity(graph)
    storeys = [[r.id for r in s.rooms if graph.surfaces_of_room[r.id]] for s in storeys_of(graph)]
    similar_storeys = tuple(place for rooms in storeys for place in similarity.similar_places(rooms))
    rooms = {room.to_localise.room: room for block in blocks for room in found[block]}
    return Inspection(graph, notices, tuple(plan_issues(graph)), similar_storeys, rooms)


def _inspect_block(graph: SceneGraph, method: str, maps: int, seed: int, block: Block) -> list[RoomInspection]:
    index, starts = block
    similarity = SelfSimilarity(graph)
    cache = MatchCache(graph, storeys_of(graph)[index], index, Matcher.load(method), seed, maps)
    rooms = []
    with threadpool_limits(1):
        for start in starts:
            found = rooms_to_localise(cache, start, similarity)
            bare = found.outcome == "no walls"
            rooms.append(RoomInspection(found, () if bare else tuple(similarity.similar_places([found.room]))))
    return rooms
