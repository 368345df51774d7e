"""When a place is unique, ambiguous or none: each limit from both sides, and the probabilities.

What was fitted is not repeated here: evidence is changed until the verdict does, and where that is is known roughly.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from methods import SMALL, as_map
from plans import a_graph, moved, offices

from matching.engine.assignment import assign
from matching.engine.hypotheses import Hypotheses, scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.room_signs import room_signs
from matching.engine.verdict import Verdict, shipped, verify

WALLS = len(SMALL.wall_surfaces)


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


def judged(found: Hypotheses, *scores: float, gone: int = 0) -> Verdict:
    """The verdict on places of these scores (nats), the first without the partners of so many of its walls."""
    table = found.table.copy()
    table[0, np.argsort(found.scene.s.half)[:gone]] = -1
    some = replace(found, table=table)[np.arange(len(scores))]
    return verify(replace(some, score=np.array(scores)), assign(found, 0))


@pytest.mark.parametrize("gone", [0, 3])
def test_the_runner_up_is_fifty_times_less_likely(found: Hypotheses, gone: int) -> None:
    """And each unexplained wall widens the margin."""
    behind = least(lambda nats: judged(found, 300.0, 300.0 - nats, gone=gone).status == "unique", 90.0)
    assert 4.0 + 0.2 * gone < behind < 8.0 + 1.2 * gone
    equal = judged(found, 300.0, 300.0, gone=gone)
    assert equal.status == "ambiguous" and equal.probability == pytest.approx(0.5, abs=0.02)
    near = judged(found, 300.0, 300.0 - behind - 0.1, 300.0 - behind - 0.1, gone=gone)
    assert near.status == "ambiguous"  # each is unlikely, together they are not


def needed(found: Hypotheses, gone: int) -> float:
    """The least evidence of a unique place that leaves so many walls unexplained."""
    return least(lambda nats: judged(found, nats, gone=gone).status == "unique", 90.0)


def test_a_place_needs_evidence_and_more_of_it_in_a_larger_plan(found: Hypotheses) -> None:
    evidence = needed(found, 6)
    assert 10 < evidence < 50
    plan = found.scene.plan
    larger = replace(found, scene=replace(found.scene, plan=replace(plan, storeys=plan.storeys * 2)))
    assert 2 < needed(larger, 6) - evidence < 15
    refused, accepted = (judged(found, evidence + off, gone=6) for off in (-0.1, 0.1))
    assert refused.status == "none" and 0.9 < refused.probability < accepted.probability < 1


def test_the_more_of_a_map_is_unexplained_the_more_evidence_it_needs(found: Hypotheses) -> None:
    assert needed(found, 7) > needed(found, 5) + 2
    none = judged(found, 300.0, gone=WALLS - 1)
    assert none.status == "none" and "does not explain" in none.reason


@pytest.mark.parametrize(("unexplained", "status"), [(0.45, "unique"), (0.55, "none")])
def test_a_plan_explains_at_least_half_of_a_map(found: Hypotheses, unexplained: float, status: str) -> None:
    """By the length of its walls, however much evidence the rest is."""
    length = np.cumsum(np.sort(found.scene.s.half)) / found.scene.s.half.sum()
    assert judged(found, 3000.0, gone=int(np.searchsorted(length, unexplained))).status == status


def test_four_walls_are_too_few_and_five_are_not(found: Hypotheses) -> None:
    pairs = assign(found, 0)
    for count, status in ((4, "none"), (5, "unique")):
        some = replace(pairs, surfaces=pairs.surfaces[:count])
        assert verify(found[np.zeros(1, dtype=np.int64)], some).status == status


def test_a_reason_counts_alternatives_by_storeys(found: Hypotheses) -> None:
    plan = found.scene.plan
    two = replace(plan, storeys=(plan.storeys[0], replace(plan.storeys[0], floor="upper")))
    storeys = replace(found.fields, storey=np.array([0, 1, 1]))
    equal = replace(found, scene=replace(found.scene, plan=two), fields=storeys)
    pairs = assign(found, 0)

    def reason(count: int) -> str:
        some = equal[np.arange(count)]
        return verify(replace(some, score=np.full(count, 300.0)), pairs).reason

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
