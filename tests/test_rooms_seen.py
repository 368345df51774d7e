"""Which rooms a run has seen, and how many the matching benchmark's maps need."""

import numpy as np
from drives import small_drive, small_run

from data.s_graph_exploration import storeys_of
from evaluation.rooms_seen import rooms_entered, rooms_needed, rooms_seen
from matching import Matcher


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


def test_a_room_that_the_plan_does_not_have_needs_no_number() -> None:
    graph = small_drive().bim.graph
    assert rooms_needed(graph, "no such room", Matcher.load("voting")) is None
    start = storeys_of(graph)[0].rooms[0].id
    needed = rooms_needed(graph, start, Matcher.load("learned"))
    assert needed is None or 1 <= needed <= np.size(graph.rooms)
