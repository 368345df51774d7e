"""When a place is unique, ambiguous or none: each limit from both sides, and the probabilities.

What was fitted is not repeated here: evidence is raised until the verdict changes, and where it does is known roughly.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from methods import CHIRAL, SMALL, as_map
from plans import a_graph, flat, moved

from data import SceneGraph
from matching.arrays import arrays, storeys
from matching.engine import deformed_hypotheses as bent
from matching.engine import verification as deformed
from matching.engine.confidence import place_probability, room_confidence, surface_confidence
from matching.engine.matcher import among
from matching.engine.plan_walls import PlanWalls
from matching.engine.voting_proposals import voting_proposals
from matching.search import verification as rigid
from matching.search.assignment import Pairs
from matching.search.hypotheses import Placement, search

SEEN = moved(as_map(SMALL), 1.0, 2.0, 3.0)
WALLS = len(SEEN.wall_surfaces)
PAIRS = Pairs((), tuple((k, k, 1.0) for k in range(WALLS)))
FEW, ENOUGH = (Pairs((), PAIRS.surfaces[:count]) for count in (4, 5))
(STOREY,) = storeys(SMALL)


def least(holds: Callable[[float], bool], high: float) -> float:
    """The smallest number from 0 to `high` for which a condition holds that holds for all larger ones."""
    low = 0.0
    assert holds(high) and not holds(low)
    while high - low > 1e-4:
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


@pytest.fixture(scope="module")
def place() -> Placement:
    return search(arrays(SEEN, None, list(SEEN.wall_surfaces)), [STOREY])[0]


def status(places: list[Placement], pairs: Pairs = PAIRS) -> str:
    return rigid.verify(places, [STOREY], pairs).status


def test_a_plan_must_explain_three_fifths_of_a_rigid_map(place: Placement) -> None:
    def placed(share: float) -> bool:
        quality = np.full_like(place.fit.quality, share)
        return status([replace(place, fit=replace(place.fit, quality=quality), score=90.0)]) == "unique"

    assert least(placed, 1.0) == pytest.approx(0.6, abs=0.001)


def test_a_place_needs_more_evidence_in_a_larger_plan_and_for_each_wall(place: Placement) -> None:
    evidence = least(lambda score: status([replace(place, score=score)]) == "unique", 200.0)
    by_chance = np.log(40 * STOREY.area)  # four directions and a third of a metre: as many places there are
    assert evidence == pytest.approx(by_chance + WALLS + 5, abs=0.3)
    sure = [replace(place, score=90.0)]
    assert status(sure, FEW) == "none" and status(sure, ENOUGH) == "unique"


def test_the_runner_up_is_four_nats_and_an_eighth_behind(place: Placement) -> None:
    for score, expected in ((100.0, 16.0), (200.0, 28.0)):
        best = replace(place, score=score)
        behind = least(lambda nats, best=best: status([best, replace(best, score=best.score - nats)]) == "unique", 90.0)  # type: ignore[misc]
        assert behind == pytest.approx(expected, abs=0.01)
    twice = [replace(place, score=100.0), replace(place, score=84.0 + 1e-9)]
    assert status(twice) == "ambiguous"


def test_a_reason_counts_alternatives_by_storeys(place: Placement) -> None:
    upper = replace(place, storey=replace(STOREY, floor="upper"))

    def reason(*places: Placement) -> str:
        return rigid.verify([replace(p, score=100.0) for p in places], [STOREY], PAIRS).reason

    assert reason(place, upper).startswith("2 storeys ")
    assert reason(place, place).startswith("2 places ") and "storey" not in reason(place, place)
    assert reason(place, place, upper).startswith("3 places on 2 storeys ")


def hypotheses(plan: SceneGraph) -> bent.DeformedHypotheses:
    """Three times the true place of a whole map, which explains all walls."""
    s, walls = moved(as_map(plan), 1.0, 2.0, 3.0), PlanWalls.of(plan)
    assert walls is not None
    every = bent.search(bent.scene_of(s, walls), among(voting_proposals(s, plan).walls, walls))
    best = np.zeros(3, dtype=np.int64)
    return replace(every, fields=every.fields[best], table=every.table[best], rigid=every.rigid[best])


@pytest.fixture(scope="module")
def found() -> bent.DeformedHypotheses:
    return hypotheses(SMALL)


def scored(
    found: bent.DeformedHypotheses, score: float, others: float, conservative: float | None = None, gone: int = 0
) -> bent.DeformedHypotheses:
    """Hypotheses of these scores (nats), the first without the partners of so many of its walls."""
    table = found.table.copy()
    table[0, np.argsort(found.scene.s.half)[:gone]] = -1
    first = score if conservative is None else conservative
    return replace(
        found, table=table, score=np.array([score, others, -90.0]), conservative=np.array([first, -90.0, -90.0])
    )


def is_unique(found: bent.DeformedHypotheses, *scores: float, gone: int = 0, pairs: Pairs = PAIRS) -> bool:
    return deformed.verify(scored(found, *scores, gone=gone), pairs).status == "unique"


def fraction(found: bent.DeformedHypotheses, gone: int) -> float:
    """The share of the walls, by length, that have a partner where so many have none."""
    half = np.sort(found.scene.s.half)
    return float(half[gone:].sum() / half.sum())


@pytest.mark.parametrize("gone", [0, 2, 6])
def test_the_runner_up_of_a_bent_map_is_two_hundred_times_less_likely(
    found: bent.DeformedHypotheses, gone: int
) -> None:
    """And each unexplained wall widens the margin."""
    behind = least(lambda nats: is_unique(found, 100.0, 100.0 - nats, gone=gone), 90.0)
    missed = (1 - fraction(found, gone)) * WALLS
    assert behind == pytest.approx(np.log(199) + 0.6 * missed, abs=0.01 + 0.1 * missed)
    equal = scored(found, 100.0, 100.0)
    assert deformed.verify(equal, PAIRS).status == "ambiguous"


def test_a_plan_must_explain_half_of_a_bent_map_and_five_walls(found: bent.DeformedHypotheses) -> None:
    unique = {fraction(found, gone): is_unique(found, 200.0, 0.0, gone=gone) for gone in range(WALLS)}
    assert all(well == (share > 0.5) for share, well in unique.items())
    assert any(0.45 < share < 0.5 for share in unique) and any(0.5 < share < 0.55 for share in unique)
    assert not is_unique(found, 200.0, 0.0, pairs=FEW) and is_unique(found, 200.0, 0.0, pairs=ENOUGH)


def test_the_odds_rise_with_evidence_and_margin_and_fall_with_what_is_unexplained(
    found: bent.DeformedHypotheses,
) -> None:
    """Each slope is known to less than a factor of two."""

    def odds(conservative: float, share: float = 1.0, second: float = -90.0) -> float:
        every = scored(found, 100.0, 0.0, conservative)
        return deformed.odds(replace(every, conservative=np.array([conservative, second, -90.0])), share)

    assert 0.16 < (odds(50.0) - odds(40.0)) / 10 < 0.4
    assert 0.09 < (odds(40.0, second=26.0) - odds(40.0, second=33.0)) / 7 < 0.25
    assert odds(40.0, second=35.0) == odds(40.0)  # as good as the best one: not a wrong place
    assert odds(40.0, second=-80.0) == odds(40.0)  # more than a nat for each wall is none the better
    assert 1.0 < (odds(40.0) - odds(40.0, 0.75)) / (WALLS / 4) < 3.0
    assert odds(40.0, 0.75) > odds(40.0, 0.65) > odds(40.0, 0.5) == odds(40.0, 0.0)
    twice = replace(found.scene.plan, storeys=(STOREY, STOREY))
    larger = replace(scored(found, 100.0, 0.0, 40.0), scene=replace(found.scene, plan=twice))
    assert 0.3 < odds(40.0) - deformed.odds(larger, 1.0) < 0.8


def test_a_bent_map_needs_odds_and_evidence_for_each_wall() -> None:
    """More for each of many walls than for each of few: a deformed mirror image of a few rooms reaches less."""
    for plan, low, high in (
        (a_graph(CHIRAL[:3], "ground"), 1.7, 1.9),
        (SMALL, 2.0, 2.3),
        (a_graph(flat(np.random.default_rng(5), 15, 12), "ground"), 2.25, 2.55),
    ):
        every = hypotheses(plan)
        walls = len(every.scene.s)
        evidence = least(lambda nats, every=every: is_unique(every, 300.0, 0.0, nats), 300.0)  # type: ignore[misc]
        assert low < evidence / walls < high, walls


def test_unexplained_walls_lower_the_evidence_that_is_needed_until_they_are_many(
    found: bent.DeformedHypotheses,
) -> None:
    def evidence(gone: int) -> float:
        return least(lambda nats: is_unique(found, 300.0, 0.0, nats, gone=gone), 300.0)

    for gone in (3, 5):  # what they would have brought is not missed, and neither is what they cost
        missed = (1 - fraction(found, gone)) * WALLS
        assert 3.4 < (evidence(0) - evidence(gone)) / missed < 5.0
    assert evidence(8) == pytest.approx(47, abs=5) and evidence(11) == pytest.approx(66, abs=7)  # here the odds decide


def test_probabilities_of_a_bent_map(found: bent.DeformedHypotheses) -> None:
    twice, alone = (deformed.verify(scored(found, 100.0, other), PAIRS).probability for other in (100.0, 0.0))
    assert twice == pytest.approx(1 / 2, abs=1e-3) and alone > 0.999
    likely = scored(found, 100.0, 0.0, 10.0)
    probability = deformed.verify(likely, PAIRS).probability
    assert (
        probability == pytest.approx(1 / (1 + np.exp(-deformed.odds(likely, 1.0))), abs=1e-3) and probability < 0.9999
    )


def test_the_place_is_as_likely_as_it_stands_out() -> None:
    def probability(*nats: float) -> float:
        return place_probability(np.array(nats), 11.0, 20)

    assert probability(60.0) > 0.999 and probability(60.0, 60.0) == pytest.approx(0.5, abs=1e-3)
    assert probability(60.0, 57.0) == pytest.approx(1 / (1 + np.exp(-3.0)), abs=0.02)
    even = least(lambda nats: probability(nats) > 0.5, 60.0)  # as many nats as a map reaches that is nowhere
    assert 22 < even < 26 and place_probability(np.array([even + 10.0]), 11.0, 30) == pytest.approx(0.5, abs=0.15)
    assert 0.68 < probability(even + 1.5) < 0.78
    assert 0 <= probability(-1e6) < 1e-9


@pytest.mark.parametrize(
    ("confidence", "of_half", "of_most"), [(room_confidence, 0.73, 0.988), (surface_confidence, 0.83, 0.982)]
)
def test_a_pair_is_as_likely_as_its_share_tells(
    confidence: Callable[[float], float], of_half: float, of_most: float
) -> None:
    assert confidence(0.5) == pytest.approx(of_half, abs=0.04)
    assert confidence(0.731) == pytest.approx(of_most, abs=0.006)
    assert confidence(0.99) > 0.999 > 0.1 > confidence(0.05)
