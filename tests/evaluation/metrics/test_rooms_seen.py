"""Which rooms a run has seen, and how many the matching benchmark's maps need."""

from dataclasses import dataclass

from drives import small_drive, small_run

from data import SceneGraph
from data.synthetic_maps.exploration import storeys_of
from evaluation.metrics.rooms_seen import RoomsNeeded, rooms_entered, rooms_needed, rooms_seen
from matching import Matcher
from matching.result import MatchResult


def test_rooms_are_entered_in_the_order_of_the_way_and_seen_when_their_walls_are_mapped() -> None:
    drive, (_, result) = small_drive(), small_run(False)
    floor = drive.bim.graph.on_floor(drive.bim.graph.floors[0].id)
    places = drive.truth.positions
    entered = rooms_entered(floor, places)
    assert entered[0] == rooms_entered(floor, places[:1])[0] and rooms_entered(floor, places[:0]) == []
    assert set(rooms_entered(floor, places[::-1])) == set(entered) and rooms_entered(floor, places[::-1])[-1] in entered
    T_bim_map = drive.truth.poses[0]
    assert rooms_seen(result.s_graph, floor, T_bim_map, places[:1]) >= set(entered[:1])
    assert rooms_seen(result.s_graph, floor, T_bim_map, places) >= set(entered)
    away = T_bim_map.copy()
    away[0, 3] += 300.0
    assert rooms_seen(result.s_graph, floor, away, places[:1]) == set(entered[:1])


@dataclass
class Forgetful:
    """Gives no answer every so many times that it is asked."""

    matcher: Matcher
    every: int
    calls: int = 0

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        self.calls += 1
        return MatchResult("none", "forgotten") if self.calls % self.every == 0 else self.matcher.match(s, a)


def test_most_maps_need_fewer_rooms_than_95_percent_of_them() -> None:
    graph, matcher = small_drive().bim.graph, Matcher.load("learned")
    assert rooms_needed(graph, "no such room", matcher) == RoomsNeeded()
    start = storeys_of(graph)[0].rooms[0].id
    needed = rooms_needed(graph, start, matcher)
    assert needed.most is not None and needed.sure is not None
    assert 1 <= needed.most <= needed.sure <= len(graph.rooms)
    often = rooms_needed(graph, start, Forgetful(matcher, every=5))
    assert often.most is not None and often.sure is None  # one in five is more than one in twenty
