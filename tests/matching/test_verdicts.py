"""When a place is unique, ambiguous or none: each limit from both sides, and the probabilities.

What was fitted is not repeated here: evidence is changed until the verdict does, and where that is is known roughly.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from methods import SMALL, as_map, matcher
from plans import a_graph, flat, moved, offices

from matching.engine.assignment import Pairs, assign
from matching.engine.hypotheses import Hypotheses, scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.room_signs import room_signs
from matching.engine.verdict import Signs, Verdict, shipped, verify


def least(holds: Callable[[float], bool], high: float) -> float:
    """The smallest number from 0 to `high` for which a condition holds that holds for all larger ones."""
    low = 0.0
    assert holds(high) and not holds(low)
    while high - low > 1e-4:
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


@pytest.fixture(scope="module")
def found() -> Hypotheses:
    """Three times the true place of a whole map, which explains all walls."""
    s, walls = moved(as_map(SMALL), 1.0, 2.0, 3.0), PlanWalls.of(SMALL)
    assert walls is not None
    scene = scene_of(s, walls)
    return search(scene)[np.zeros(3, dtype=np.int64)]


def judged(found: Hypotheses, *scores: float, gone: int = 0, start: bool = False) -> Verdict:
    """The verdict on places of these scores (nats), the first without the partners of so many of its walls."""
    table = found.table.copy()
    table[0, np.argsort(found.scene.s.half)[:gone]] = -1
    some = replace(found, table=table)[np.arange(len(scores))]
    return decided(replace(some, score=np.array(scores)), assign(found, 0), start)


def decided(found: Hypotheses, pairs: Pairs, start: bool = False) -> Verdict:
    """By evidence alone."""
    signs = Signs.of(found, start)
    return verify(found, pairs, shipped().probabilities(signs), shipped().temperature(signs, is_mirrored=True))


def best(verdict: Verdict) -> float:
    return verdict.probabilities[0]


@pytest.mark.parametrize("gone", [0, 3])
def test_the_runner_up_is_fifty_times_less_likely(found: Hypotheses, gone: int) -> None:
    behind = least(lambda nats: judged(found, 400.0, 400.0 - nats, gone=gone).status == "unique", 200.0)
    equal = judged(found, 400.0, 400.0, gone=gone)
    assert equal.status == "ambiguous" and equal.probabilities == pytest.approx([0.5, 0.5], abs=0.02)
    near = judged(found, 400.0, 400.0 - behind - 0.1, 400.0 - behind - 0.1, gone=gone)
    assert near.status == "ambiguous"  # each is unlikely, together they are not
    sure, unsure = (judged(found, 400.0, 400.0 - behind - off, gone=gone) for off in (0.01, -0.01))
    assert best(unsure) < 0.98 <= best(sure) and 30 < sure.probabilities[0] / sure.probabilities[1] < 60


def test_the_more_evidence_and_the_more_unexplained_the_more_may_a_runner_up_differ(found: Hypotheses) -> None:
    """At another place as much may differ from the plan."""
    margins = [
        least(lambda n, of=of, gone=gone: judged(found, of, of - n, gone=gone).status == "unique", 200.0)
        for of, gone in ((400.0, 0), (800.0, 0), (400.0, 3))
    ]
    assert 3.0 < margins[0] < margins[1] - 1 and margins[0] < margins[2] - 1


def test_a_place_needs_evidence(found: Hypotheses) -> None:
    nats = [judged(found, float(nats)) for nats in range(0, 300, 10)]
    assert all(np.diff([best(own) for own in nats]) > 0)
    assert nats[0].status == "none" and nats[-1].status == "unique"
    for unlisted in (judged(found, 90.0, 60.0, 30.0), judged(found, 90.0, 90.0, 30.0)):
        assert sum(unlisted.probabilities) < 1.0


@pytest.mark.parametrize("nats", [30.0, 60.0, 90.0])
def test_the_same_evidence_is_less_in_a_larger_plan_and_more_near_a_start(found: Hypotheses, nats: float) -> None:
    plan = found.scene.plan
    larger = replace(found, scene=replace(found.scene, plan=replace(plan, storeys=plan.storeys * 4)))
    assert best(judged(larger, nats)) < best(judged(found, nats))
    assert best(judged(larger, nats, start=True)) > best(judged(larger, nats))


def test_four_walls_are_too_few_and_five_are_not(found: Hypotheses) -> None:
    pairs = assign(found, 0)
    for count, status in ((4, "none"), (5, "unique")):
        some = decided(found[np.zeros(1, dtype=np.int64)], replace(pairs, surfaces=pairs.surfaces[:count]))
        assert some.status == status and (some.probabilities[0] > 0.9) is (status == "unique")


def test_a_whole_map_is_surer_than_a_part_of_it_and_one_of_another_plan_is_not_unique() -> None:
    plan, chances = as_map(SMALL), []
    for rooms in (1, 2, 6):
        kept = {room.id for room in plan.rooms[:rooms]}
        walls = tuple(wall for wall in plan.wall_surfaces if wall.room in kept)
        part = replace(plan, rooms=plan.rooms[:rooms], wall_surfaces=walls)
        chances.append(matcher("voting").match(moved(part, 1.0, 2.0, 3.0), SMALL).hypotheses[0].probability or 0.0)
    assert chances == sorted(chances) and chances[0] < 0.5 and chances[-1] > 0.98
    other = as_map(a_graph(flat(np.random.default_rng(9), 11, 8)))
    assert matcher("voting").match(other, SMALL).status != "unique"


def test_a_reason_counts_alternatives_by_storeys(found: Hypotheses) -> None:
    plan = found.scene.plan
    two = replace(plan, storeys=(plan.storeys[0], replace(plan.storeys[0], floor="upper")))
    storeys = replace(found.fields, storey=np.array([0, 1, 1]))
    equal = replace(found, scene=replace(found.scene, plan=two), fields=storeys)
    pairs = assign(found, 0)

    def reason(count: int) -> str:
        some = equal[np.arange(count)]
        return decided(replace(some, score=np.full(count, 300.0)), pairs).reason

    assert reason(2).startswith("2 storeys ") and reason(3).startswith("3 places on 2 storeys ")
    assert judged(found, 300.0, 300.0).reason.startswith("2 places ")


def test_a_surface_pair_is_as_likely_as_its_share_tells() -> None:
    of = shipped()
    assert of.of_surface(0.5) == pytest.approx(0.8, abs=0.1) and of.of_surface(0.75) > 0.9
    assert of.of_surface(1.0) > 0.999 and of.of_surface(0.0) < 1e-3


def sure_of_rooms(found: Hypotheses) -> dict[str, float]:
    """The probability of each room pair of the first hypothesis, by its S room."""
    rooms = assign(found, 0).rooms
    known = shipped().of_rooms(room_signs(found, rooms))
    return {found.scene.s.rooms[r].id: p for (r, _, _), p in zip(rooms, known, strict=True)}


def test_a_room_that_fits_its_neighbours_place_as_well_is_less_sure() -> None:
    """Below the corridor rooms are equal and so narrow that drift may move one onto the next, above they are not."""
    plan = a_graph(offices([1.1] * 6, [3.3, 2.4, 4.0]))
    walls = PlanWalls.of(plan)
    assert walls is not None
    known = sure_of_rooms(search(scene_of(moved(as_map(plan), 1.0, 2.0, 3.0), walls)))
    below, above = ([known[r.id] for r in plan.rooms[k]] for k in (slice(1, 5), slice(6, 9)))
    assert 1 - max(below) > 5 * (1 - min(above))


def test_a_room_that_is_torn_from_its_neighbours_is_less_sure(found: Hypotheses) -> None:
    before, room = sure_of_rooms(found), found.scene.s.rooms[0].id
    state = found.fields.state.copy()
    state[:, found.scene.group_of_room[0], 0] += np.radians(10)  # turned about its centre, so that it still fits best
    torn = sure_of_rooms(replace(found, fields=replace(found.fields, state=state)))
    assert min(before.values()) > 0.98 and 1 - torn[room] > 3 * (1 - before[room])
