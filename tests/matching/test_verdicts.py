"""When a place is unique, ambiguous or none: each limit from both sides, and the probabilities."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from methods import SMALL, as_map
from plans import moved

from matching.arrays import arrays, storeys
from matching.deformation import deformed_hypotheses as bent
from matching.deformation import verification as deformed
from matching.deformation.matcher import among
from matching.search import verification as rigid
from matching.search.assignment import Pairs
from matching.search.confidence import place_probability, room_confidence, surface_confidence
from matching.search.hypotheses import Placement, search
from matching.search.plan_walls import PlanWalls
from matching.search.voting_proposals import voting_proposals

SEEN = moved(as_map(SMALL), 1.0, 2.0, 3.0)
WALLS = len(SEEN.wall_surfaces)
PAIRS = Pairs((), tuple((k, k, 1.0) for k in range(WALLS)))
FEW, ENOUGH = (Pairs((), PAIRS.surfaces[:count]) for count in (4, 5))
(STOREY,) = storeys(SMALL)
BY_CHANCE = float(np.log(40 * STOREY.area))  # nats


@pytest.fixture(scope="module")
def place() -> Placement:
    return search(arrays(SEEN, None, list(SEEN.wall_surfaces)), [STOREY])[0]


def explained(place: Placement, share: float) -> Placement:
    """The place with each wall explained so well."""
    return replace(place, fit=replace(place.fit, quality=np.full_like(place.fit.quality, share)))


def verdict(places: list[Placement], pairs: Pairs = PAIRS) -> str:
    return rigid.verify(places, [STOREY], pairs).status


@pytest.mark.parametrize(("share", "status"), [(0.6001, "unique"), (0.5999, "none")])
def test_a_plan_must_explain_three_fifths_of_a_map_that_is_not_bent(
    place: Placement, share: float, status: str
) -> None:
    assert verdict([replace(explained(place, share), score=90.0)]) == status


@pytest.mark.parametrize(("nats", "status"), [(5.01, "unique"), (4.99, "none")])
def test_a_place_needs_more_evidence_than_the_best_of_all_reaches_by_chance(
    place: Placement, nats: float, status: str
) -> None:
    assert verdict([replace(place, score=BY_CHANCE + nats + WALLS)]) == status


def test_a_place_needs_five_walls(place: Placement) -> None:
    sure = [replace(place, score=90.0)]
    assert verdict(sure, FEW) == "none" and verdict(sure, ENOUGH) == "unique"


@pytest.mark.parametrize(("behind", "status"), [(16.0, "unique"), (15.99, "ambiguous")])
def test_the_runner_up_is_four_nats_and_an_eighth_behind(place: Placement, behind: float, status: str) -> None:
    assert verdict([replace(place, score=100.0), replace(place, score=100.0 - behind)]) == status


def test_alternatives_are_counted_by_storeys(place: Placement) -> None:
    upper = replace(place, storey=replace(STOREY, floor="upper"))

    def reason(*places: Placement) -> str:
        return rigid.verify([replace(p, score=100.0) for p in places], [STOREY], PAIRS).reason

    assert reason(place, place).startswith("2 places explain") and reason(place, upper).startswith("2 storeys explain")
    assert reason(place, place, upper).startswith("3 places on 2 storeys explain")


@pytest.mark.parametrize(("rooms", "named"), [(0, "0 rooms"), (1, "1 room"), (2, "2 rooms")])
def test_a_reason_counts_walls_and_rooms(rooms: int, named: str) -> None:
    pairs = Pairs(tuple((k, k, 1.0) for k in range(rooms)), FEW.surfaces)
    assert rigid.matched(pairs, 7) == f"4 of 7 wall surfaces and {named} matched"


@pytest.fixture(scope="module")
def found() -> bent.DeformedHypotheses:
    walls = PlanWalls.of(SMALL)
    assert walls is not None
    every = bent.search(bent.scene_of(SEEN, walls), among(voting_proposals(SEEN, SMALL).walls, walls))
    best = np.zeros(3, dtype=np.int64)  # three times the true place, which explains all walls
    return replace(every, fields=every.fields[best], table=every.table[best], rigid=every.rigid[best])


Scored = Callable[..., bent.DeformedHypotheses]


@pytest.fixture
def scored(found: bent.DeformedHypotheses) -> Scored:
    def changed(score: float, others: float, conservative: float | None = None, unexplained: int = 0):  # type: ignore[no-untyped-def]
        """Hypotheses of these scores (nats), the first without the partners of so many of its walls."""
        table = found.table.copy()
        table[0, np.argsort(found.scene.s.half)[:unexplained]] = -1
        first = score if conservative is None else conservative
        scores = np.array([score, others, -90.0])
        return replace(found, table=table, score=scores, conservative=np.array([first, -90.0, -90.0]))

    return changed


MARGIN = float(np.log(199))


@pytest.mark.parametrize(("behind", "status"), [(MARGIN + 0.01, "unique"), (MARGIN - 0.01, "ambiguous")])
def test_the_runner_up_of_a_bent_map_is_two_hundred_times_less_likely(
    scored: Scored, behind: float, status: str
) -> None:
    assert deformed.verify(scored(100.0, 100.0 - behind), PAIRS).status == status


def fraction(hypotheses: bent.DeformedHypotheses) -> float:
    """The share of the walls, by length, that have a partner."""
    half = hypotheses.scene.s.half
    return float(half[(hypotheses.table[0] >= 0).any(axis=1)].sum() / half.sum())


def test_each_unexplained_wall_widens_the_margin(scored: Scored) -> None:
    for gone in (2, 6):
        hypotheses = scored(100.0, 0.0, unexplained=gone)
        margin = MARGIN + 0.6 * (1 - fraction(hypotheses)) * WALLS
        for off, status in ((0.02, "unique"), (-0.02, "ambiguous")):
            assert deformed.verify(scored(100.0, 100.0 - margin - off, unexplained=gone), PAIRS).status == status


def test_a_plan_must_explain_half_of_a_bent_map(scored: Scored) -> None:
    statuses = {}
    for gone in range(WALLS):
        hypotheses = scored(200.0, 0.0, unexplained=gone)
        statuses[fraction(hypotheses)] = deformed.verify(hypotheses, PAIRS).status
    assert {status for share, status in statuses.items() if share > 0.5} == {"unique"}
    assert {status for share, status in statuses.items() if share < 0.5} == {"none"}
    assert any(0.45 < share < 0.5 for share in statuses) and any(0.5 < share < 0.55 for share in statuses)


def test_a_bent_map_needs_five_walls(scored: Scored) -> None:
    sure = scored(200.0, 0.0)
    assert deformed.verify(sure, FEW).status == "none" and deformed.verify(sure, ENOUGH).status == "unique"


def test_the_odds_are_those_of_the_regression(scored: Scored) -> None:
    places = -0.656 * BY_CHANCE
    alone = scored(100.0, 0.0, conservative=40.0)
    assert deformed.odds(alone, 1.0) == pytest.approx(5.68 + 0.254 * 40 + 0.147 * WALLS + places)
    assert deformed.odds(alone, 0.75) == pytest.approx(5.68 + 0.254 * 40 + 0.147 * WALLS - 1.736 * WALLS / 4 + places)
    assert deformed.odds(alone, 0.0) == pytest.approx(5.68 + 0.254 * 40 + 0.147 * WALLS - 1.736 * 10 + places)
    near, equal = (replace(alone, conservative=np.array([40.0, 40.0 - off, -90.0])) for off in (7.0, 5.0))
    assert deformed.odds(near, 1.0) == pytest.approx(5.68 + 0.254 * 40 + 0.147 * 7 + places)
    assert deformed.odds(equal, 1.0) == pytest.approx(deformed.odds(alone, 1.0))


@pytest.mark.parametrize(("off", "status"), [(0.01, "unique"), (-0.01, "none")])
def test_a_bent_map_is_in_the_plan_by_its_odds_and_its_evidence_a_wall(
    scored: Scored, off: float, status: str
) -> None:
    per_wall = 1.8 + 0.6 * (WALLS - 15) / 15  # of 24 walls, between 15 and 30
    conservative = per_wall * WALLS + off
    assert deformed.odds(scored(200.0, 0.0, conservative), 1.0) > 4.5
    assert deformed.verify(scored(200.0, 0.0, conservative), PAIRS).status == status


def test_unexplained_walls_are_paid_for_in_the_evidence_a_wall(scored: Scored) -> None:
    decided = 0
    for gone in range(1, 8):
        share = fraction(scored(200.0, 0.0, unexplained=gone))
        missed = (1 - share) * WALLS
        least = (WALLS - missed) * (1.8 + 0.6 * (WALLS - 15) / 15) - 2 * missed
        if deformed.odds(scored(200.0, 0.0, least - 0.1), share) > 4.5:
            decided += 1
            for off, status in ((0.1, "unique"), (-0.1, "none")):
                assert deformed.verify(scored(200.0, 0.0, least + off, gone), PAIRS).status == status
    assert decided


def test_alternatives_of_a_bent_map_are_counted_by_storeys(scored: Scored) -> None:
    hypotheses = replace(scored(100.0, 100.0), score=np.array([100.0, 100.0, 100.0]))
    two = replace(hypotheses.scene.plan, storeys=(STOREY, replace(STOREY, floor="upper")))
    scene = replace(hypotheses.scene, plan=two)

    def reason(*storey: int) -> str:
        fields = replace(hypotheses.fields, storey=np.array([*storey, *[0] * (3 - len(storey))]))
        score = np.where(np.arange(3) < len(storey), 100.0, 0.0)
        return deformed.verify(replace(hypotheses, scene=scene, fields=fields, score=score), PAIRS).reason

    assert reason(0, 0).startswith("2 places explain") and reason(0, 1).startswith("2 storeys explain")
    assert reason(0, 0, 1).startswith("3 places on 2 storeys explain")


def test_a_bent_map_of_many_unexplained_walls_needs_odds(scored: Scored) -> None:
    shares = []
    for gone in range(2, 12):
        share = fraction(scored(200.0, 0.0, unexplained=gone))
        zero = deformed.odds(scored(200.0, 0.0, 0.0), share)
        least = (4.5 - zero) / 0.254  # conservative nats at which the odds are just enough
        explained_walls = share * WALLS
        if least + 2 * (1 - share) * WALLS > explained_walls * (1.8 + 0.6 * (WALLS - 15) / 15):
            shares.append(share)
            for off, status in ((0.1, "unique"), (-0.1, "none")):
                assert deformed.verify(scored(200.0, 0.0, least + off, gone), PAIRS).status == status
    assert shares


def test_probabilities_of_a_bent_map(scored: Scored) -> None:
    twice, alone = (deformed.verify(scored(100.0, other), PAIRS).probability for other in (100.0, 0.0))
    assert twice == pytest.approx(1 / 2, abs=1e-3) and alone > 0.999
    likely = scored(100.0, 0.0, conservative=30.0)
    odds = deformed.odds(likely, 1.0)
    assert deformed.verify(likely, PAIRS).probability == pytest.approx(1 / (1 + np.exp(-odds)), abs=1e-3)


def test_the_place_is_as_likely_as_it_stands_out() -> None:
    assert place_probability(np.array([60.0]), 11.0, 20) > 0.999
    assert place_probability(np.array([60.0, 60.0]), 11.0, 20) == pytest.approx(0.5, abs=1e-3)
    assert place_probability(np.array([60.0, 57.0]), 11.0, 20) == pytest.approx(1 / (1 + np.exp(-3.0)), abs=1e-4)
    assert place_probability(np.array([24.0]), 11.0, 20) == pytest.approx(0.5)  # as many nats as nowhere has
    assert place_probability(np.array([25.5]), 11.0, 20) == pytest.approx(1 / (1 + np.exp(-1.0)))
    assert 0 <= place_probability(np.array([-1e6]), 11.0, 20) < 1e-9


def test_a_pair_is_as_likely_as_its_share_tells() -> None:
    for confidence, even, most in ((room_confidence, 1.0, 1.0 + 3.4), (surface_confidence, 1.6, 1.6 + 2.4)):
        assert confidence(0.5) == pytest.approx(1 / (1 + np.exp(-even)))
        assert confidence(np.e / (1 + np.e)) == pytest.approx(1 / (1 + np.exp(-most)))
