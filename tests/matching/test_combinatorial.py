"""iS-Graphs' search: every row of the behaviour that was measured on its public code, and its answers' contract."""

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest
from study_rows import rows_of

from data import Floor, Room, SceneGraph, WallSurface
from evaluation.published.combinatorial import Choice, Search, cases, measure, tables
from evaluation.published.combinatorial_layouts import Noise, grid, polygons, seen
from matching import Matcher
from matching.combinatorial import DEVELOP, GRID, CombinatorialMatcher
from matching.combinatorial.clipper import densest

RELEASED, LATER = Matcher.load("combinatorial"), Matcher.load("combinatorial-grid")
EXACT = Noise(0.0, 0.0)
PLAN = grid(4, 2)
L_SHAPE = [0, 1, 5]


def right(result) -> bool:
    pairs = (*result.rooms, *result.wall_surfaces)
    return bool(pairs) and all(s == f"s:{a}" for s, a, _ in pairs)


def tied(result) -> int:
    return {"none": 0, "unique": 1}.get(result.status) or int(result.reason.split()[0])


@pytest.mark.parametrize(("shape", "rooms", "count", "later"), [
    ((2, 1), 2, 4, 1), ((2, 2), 2, 16, 2), ((2, 2), 3, 8, 1), ((2, 2), 4, 8, 1),
])  # fmt: skip
def test_twins_equal_squares_tie(shape, rooms, count, later):
    plan = grid(*shape, side_m=4.0)
    s = seen(plan, range(rooms), noise=EXACT)
    released, branch = RELEASED.match(s, plan), LATER.match(s, plan)
    assert released.status == "ambiguous" and tied(released) == count
    assert len(released.hypotheses) == min(count, 10)
    assert tied(branch) == later and (later > 1 or right(branch))


def test_a_mirrored_building_is_found_by_the_released_one_alone():
    s = seen(PLAN, L_SHAPE, mirrored=True)
    result = RELEASED.match(s, PLAN)
    assert result.status == "unique" and len(result.rooms) == 3 and right(result)
    assert LATER.match(s, PLAN).status == "none"


def test_one_spurious_wall_ends_the_search():
    s = seen(PLAN, L_SHAPE)
    extra = WallSurface("extra", "s:room0", (3.0, 3.0), (1.0, 0.0), 1.0)
    worse = dataclasses.replace(s, wall_surfaces=(*s.wall_surfaces, extra))
    assert RELEASED.match(worse, PLAN).status == LATER.match(worse, PLAN).status == "none"
    fewer = dataclasses.replace(s, wall_surfaces=s.wall_surfaces[1:])  # a missing one does no harm
    assert right(RELEASED.match(fewer, PLAN)) and right(LATER.match(fewer, PLAN))


def test_a_turn_of_90_degrees_is_nothing_to_the_released_one_and_too_much_for_the_later():
    s = seen(PLAN, L_SHAPE, turned=np.pi / 2)
    result = RELEASED.match(s, PLAN)
    assert result.status == "unique" and right(result)
    assert result.T_a_s[0] == pytest.approx(-np.pi / 2, abs=0.01)
    assert result.T_a_s[1:] == pytest.approx((0, 0), abs=0.1)
    assert LATER.match(s, PLAN).status == "none"


def test_one_room_and_more_rooms_than_the_plan_has():
    s = seen(PLAN, [0])
    assert tied(RELEASED.match(s, PLAN)) == 4 and len(RELEASED.match(s, PLAN).wall_surfaces) == 4
    assert tied(LATER.match(s, PLAN)) == 1
    smaller = grid(2, 1)
    for matcher in (RELEASED, LATER):
        assert matcher.match(seen(PLAN, range(3)), smaller).status == "none"


def test_little_noise_is_borne_and_much_is_not():
    def solved(matcher: Matcher, noise: Noise) -> int:
        results = [matcher.match(seen(PLAN, L_SHAPE, n, noise), PLAN) for n in range(4)]
        return sum(r.status == "unique" and right(r) and len(r.wall_surfaces) == 12 for r in results)

    assert solved(RELEASED, Noise(0.03, 0.5)) == 4
    assert solved(RELEASED, Noise(0.3, 3.0)) == solved(LATER, Noise(0.3, 3.0)) == 0


def test_the_later_one_goes_on_where_a_wall_was_built_otherwise():
    s = seen(PLAN, range(4), noise=EXACT)

    def moved(by: float) -> SceneGraph:
        walls = tuple(
            dataclasses.replace(w, centroid=(w.centroid[0], w.centroid[1] - by)) if w.id == "s:room1/2" else w
            for w in s.wall_surfaces
        )
        return dataclasses.replace(s, wall_surfaces=walls)

    assert RELEASED.match(moved(0.4), PLAN).status == "none"
    result = LATER.match(moved(0.4), PLAN)
    assert result.status == "unique" and right(result) and len(result.wall_surfaces) == 15
    strict = CombinatorialMatcher(dataclasses.replace(GRID, deviated=None))
    assert len(strict.match(moved(0.25), PLAN).wall_surfaces) == 15
    result = LATER.match(moved(0.25), PLAN)
    assert right(result) and len(result.wall_surfaces) == 16


def test_walls_without_a_room_are_added():
    s = seen(PLAN, L_SHAPE, noise=EXACT)
    walls, planned = (
        tuple(dataclasses.replace(w, room=None) if w.id.endswith("room1/2") else w for w in g.wall_surfaces)
        for g in (s, PLAN)
    )
    result = RELEASED.match(
        dataclasses.replace(s, wall_surfaces=walls), dataclasses.replace(PLAN, wall_surfaces=planned)
    )
    assert right(result) and len(result.wall_surfaces) == 12


def test_the_limit_of_time_holds():
    plan = polygons(2, 9)
    began = time.perf_counter()
    hurried = CombinatorialMatcher(dataclasses.replace(DEVELOP, limit_s=0.3))
    result = hurried.match(seen(plan, [0, 1]), plan)
    assert result.status == "none" and "0.3 s" in result.reason
    assert time.perf_counter() - began < 30  # without the limit: minutes; a busy machine may take seconds
    large = grid(15, 15)
    assert "0.3 s" in hurried.match(seen(large, range(200)), large).reason


def test_storeys_lie_apart_for_the_released_one_and_floor_and_start_choose():
    floors = (Floor("f0", "", 0.0), Floor("f1", "", 3.0))
    rooms, walls = [], []
    for f in floors:
        rooms += [Room(f"{f.id}/{r.id}", r.centroid, f.id) for r in PLAN.rooms]
        walls += [dataclasses.replace(w, id=f"{f.id}/{w.id}", room=f"{f.id}/{w.room}", floor=f.id)
                  for w in PLAN.wall_surfaces]  # fmt: skip
    plan, s = SceneGraph("bim", tuple(rooms), tuple(walls), floors=floors), seen(PLAN, [0, 5])
    assert tied(RELEASED.match(s, plan)) == 2
    chosen = RELEASED.match(s, plan, floor="f1")
    assert chosen.status == "unique" and chosen.floor == "f1"
    near, far = RELEASED.match(s, PLAN, start=(0.0, 0.0, 0.0)), RELEASED.match(s, PLAN, start=(0.0, 9.0, 0.0))
    assert near.status == "unique" and far.status == "none"


def test_the_densest_set_is_a_clique():
    rng = np.random.default_rng(3)
    M = np.tile(np.eye(7), (50, 1, 1))
    clique = np.array([0, 2, 3, 6])
    M[:, clique[:, None], clique] = 1.0
    M[:, 1, 4] = M[:, 4, 1] = 0.9
    found = densest(M, rng, 5)
    assert found.value == pytest.approx(4.0) and (np.nonzero(found.chosen[0])[0] == clique).all()
    assert found.score == pytest.approx(1.0)
    assert GRID.restarts == 10


def test_answers_are_told_in_words_beside_those_of_the_public_code():
    def asked(name: str, limit_s: float = 60.0):
        listed = (Search(asked=name, version=version, limit_s=limit_s) for version in ("released", "later branch"))
        return [(case, measure(case, Path())) for case in listed]

    names = ("the building mirrored", "twins: equal squares, 2:2", "8:2")
    rows = rows_of([*(pair for name in names for pair in asked(name)), *asked("8:8", 0.01)])
    found = tables(rows)
    mirrored, twins = found["answers"].to_numpy().tolist()
    assert mirrored == ["the building mirrored", "unique", "unique, right", "none", "none"]
    assert twins[1:3] == ["4 tie", "4 tie, 10 pairs each; the first is right"]
    measured, stopped = found["times"].to_dict("records")
    assert measured["public code, released (s)"] == "0.32" and float(measured["ours, released (s)"]) < 0.32
    assert stopped["public code, released (s)"] == "> 300" and stopped["ours, released (s)"] == "stopped at 0.01"
    assert stopped["ratio, released"] == "" and 0 < float(found["largest_ratio"]) < 1


def test_layouts_that_take_minutes_can_be_left_out():
    every, short = ({case.asked for case in cases(Choice(heavy=heavy))} for heavy in (True, False))
    assert every - short == {"12:6", "12:12", "2:2, 8 walls a room"}
