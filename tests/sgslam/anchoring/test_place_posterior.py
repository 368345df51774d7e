"""The posterior of a map's place: the matcher's answer, and what the storeys, the mirror image and other floors say."""

from dataclasses import replace

import numpy as np
import pytest
from plans import a_graph, box

from data import Floor
from matching import MatchResult
from matching.result import Hypothesis
from sgslam.anchoring.place_posterior import Place, PlacePosterior, in_known_map, joint_posterior, place_posterior
from sgslam.anchoring.plan import Plan

Pose = tuple[float, float, float]
HERE, ASIDE, FAR = (0.0, 5.0, 5.0), (0.0, 5.5, 5.0), (0.0, 50.0, 5.0)
MAP = a_graph([box(-3, -2, 6, 4)])  # its centroid is the origin


def answer(*hypotheses: tuple[str, float, Pose], score: float = 100.0) -> MatchResult:
    """Floor, probability and place of each; the first is the best."""
    listed = tuple(Hypothesis(score - 20.0 * k, T, floor, (), p) for k, (floor, p, T) in enumerate(hypotheses))
    return MatchResult("ambiguous", "", T_a_s=listed[0].T_a_s, floor=listed[0].floor, hypotheses=listed)


def chances(posterior: PlacePosterior) -> dict[str | None, float]:
    """Of storeys with one place each."""
    return {place.floor: place.probability for place in posterior.places}


TWO = answer(("eg", 0.6, HERE), ("og", 0.39, HERE))
ONE = answer(("eg", 0.9999, HERE), ("og", 0.00002, HERE))


@pytest.mark.parametrize("storeys", [["og"], ["og", "dg"]])
def test_a_storey_that_is_excluded_needs_much_more_evidence(storeys: list[str]) -> None:
    found = place_posterior(TWO, None, storeys)
    assert found.places[0].floor == "og" and found.places[0].probability > 0.95 and chances(found)["eg"] < 0.01
    contradicted = place_posterior(ONE, None, storeys)
    assert contradicted.places[0].floor == "eg" and chances(contradicted)["og"] < 0.5


@pytest.mark.parametrize("equal", [2, 3, 10])
def test_of_equal_storeys_the_stated_one_is_as_probable_as_all_were_together(equal: int) -> None:
    names = [f"storey-{n}" for n in range(equal)]
    match = answer(*((name, 0.994 / equal, HERE) for name in names))
    unstated, stated = (place_posterior(match, None, known, equal) for known in ([], names[1:2]))
    assert unstated.places[0].probability < 0.5
    assert stated.places[0].floor == "storey-1" and 0.99 < stated.places[0].probability <= 0.994
    assert stated.outside == pytest.approx(unstated.outside, abs=1e-3)


def test_without_a_statement_the_matcher_is_believed_as_it_is() -> None:
    for storeys in ([], ["eg", "og", "dg"]):
        assert chances(place_posterior(TWO, None, storeys)) == pytest.approx({"eg": 0.6, "og": 0.39})
    elsewhere = place_posterior(answer(("eg", 0.9, HERE)), None, ["og"])
    assert elsewhere.outside > 0.98  # it fits no place of the storey that was stated


@pytest.mark.parametrize(
    ("better", "is_mirrored"), [(-10.0, False), (0.0, False), (3.0, False), (8.0, True), (1e4, True)]
)
def test_a_mirror_image_must_fit_clearly_better(better: float, is_mirrored: bool) -> None:
    """Which image of a symmetric building was recorded cannot be told: it hardly ever was the wrong one."""
    found = place_posterior(ONE, answer(("eg", 0.5, FAR), score=100.0 + better), [])
    assert (found.mirrored > 0.5) is is_mirrored and (found.places[0].probability > 0.9) is not is_mirrored
    assert (found.places[0].probability > 0.99) is (better <= 0.0)
    assert (found.mirrored > 1e-6) is (better >= 0.0)
    assert place_posterior(ONE, MatchResult("none", ""), []).mirrored == 0.0


def test_a_wrong_storey_is_wrong_for_the_mirror_image_too() -> None:
    assert place_posterior(ONE, ONE, ["og"]).mirrored < 0.01


def test_of_a_matcher_without_probabilities_a_unique_answer_is_believed() -> None:
    told = MatchResult("unique", "", T_a_s=HERE, floor="eg")
    scored = replace(told, hypotheses=(Hypothesis(3.0, HERE, "eg"), Hypothesis(2.0, FAR, "eg")))
    for match in (told, scored):
        assert chances(place_posterior(match, None, [])) == {"eg": 1.0}
        for unsure in (replace(match, status="ambiguous"), replace(match, status="none"), replace(match, T_a_s=None)):
            nothing = place_posterior(unsure, None, [])
            assert nothing.places == () and nothing.outside == 1.0


@pytest.mark.parametrize("seed", range(20))
def test_probabilities_are_those_of_exclusive_events(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shares = rng.dirichlet(np.ones(6)).tolist()
    match = answer(*((str(rng.choice(["eg", "og"])), p, (0.0, 10.0 * k, 0.0)) for k, p in enumerate(shares[:5])))
    image = answer(("eg", 0.5, HERE), score=100.0 + float(rng.normal(0, 10)))
    found = place_posterior(match, image if seed % 2 else None, [[], ["eg"], ["og", "dg"]][seed % 4 % 3])
    known = [place.probability for place in found.places]
    assert min(known) >= 0.0 and known == sorted(known, reverse=True)
    assert sum(known) + found.mirrored + found.outside == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("place", "floor", "probability"),
    [
        (HERE, "eg", 0.7),  # with the one beside it
        ((0.0, 4.6, 5.0), "eg", 0.7),
        ((0.0, 4.4, 5.0), "eg", 0.4),
        ((0.0, 3.9, 5.0), "eg", 0.0),
        ((np.radians(4.9), 5.0, 5.0), "eg", 0.7),
        ((np.radians(-5.1), 5.0, 5.0), "eg", 0.0),
        (HERE, "og", 0.2),
    ],
)
def test_places_that_hardly_differ_are_one(place: Pose, floor: str, probability: float) -> None:
    found = place_posterior(answer(("eg", 0.4, HERE), ("eg", 0.3, ASIDE), ("og", 0.2, HERE)), None, [])
    assert found.at(np.array(place), floor, MAP) == pytest.approx(probability)


STAIRS = [{0: "a", 1: "b"}, {0: "b", 1: "c"}, {0: "c", 1: "d"}]


def equal_storeys(at: Pose = HERE) -> MatchResult:
    """The answer of a plan whose storeys are equal except for the third."""
    return answer(*((floor, 0.333, at) for floor in "abd"), ("c", 1e-6, at))


def together(*matches: MatchResult, possible: list[dict[int, str]] = STAIRS) -> tuple[dict[int, str], PlacePosterior]:
    known = {k: place_posterior(match, None, []) for k, match in enumerate(matches)}
    return joint_posterior(known, dict.fromkeys(known, MAP), possible)


def test_two_floors_that_are_ambiguous_alone_are_sure_together() -> None:
    """Only the lowest two storeys are equal and one above the other."""
    for match in (equal_storeys(), equal_storeys(ASIDE)):
        assigned, found = together(equal_storeys(), match)
        assert assigned == {0: "a", 1: "b"} and found.places[0].floor == "a" and found.places[0].probability > 0.99
        assert sum(place.probability for place in found.places) <= 1.0
    assert together(equal_storeys(), equal_storeys(FAR))[1].places[0].probability < 0.9


def test_floors_are_only_at_storeys_that_can_be_theirs() -> None:
    low, high = (answer((floor, 0.999, HERE)) for floor in "ad")
    assert together(low, high, possible=[]) == together(high, low) == ({}, PlacePosterior())
    assert together(low, high)[1].places[0].probability < 0.9  # two storeys lie between them


def test_a_floor_that_shows_no_place_leaves_it_to_the_others() -> None:
    sure, nothing = answer(("b", 0.995, HERE)), MatchResult("none", "")
    for matches, storey in (((sure, nothing), "b"), ((nothing, sure), "a")):
        assigned, found = together(*matches)
        assert found.places[0].floor == assigned[0] == storey
        assert found.places[0].probability == pytest.approx(0.995, abs=1e-3)


def in_map(conflict: float, *probabilities: float, mirrored: float = 0.0) -> PlacePosterior:
    """The posterior in the map of an earlier run, by a model that is known."""
    places = tuple(Place((0.0, 10.0 * k, 0.0), None, p) for k, p in enumerate(probabilities))
    return in_known_map(PlacePosterior(places, mirrored), conflict, (0.5, -10.0, 0.0))


def test_a_place_in_a_known_map_is_probable_if_it_leads_all_others_and_no_wall_stands_in_free_space() -> None:
    """By hand: it leads by ln 4 and by ln 25 nats; the share in conflict of 0.01 costs one."""
    for conflict, cost in ((0.0, 0.0), (0.01, 1.0)):
        for best, other in ((0.75, 0.25), (0.96, 0.04)):
            found = in_map(conflict, best, other)
            assert found.places[0].probability == pytest.approx(1 / (1 + np.exp(cost) * np.sqrt(other)))
    unlisted = in_map(0.0, 0.6, 0.2)
    assert unlisted.places[0].probability == in_map(0.0, 0.75, 0.25).places[0].probability  # the plan lacks rooms


def test_what_the_best_place_in_a_known_map_gains_the_others_lose() -> None:
    for conflict in (0.0, 0.2):
        found = in_map(conflict, 0.5, 0.3, 0.1, mirrored=0.05)
        known = [place.probability for place in found.places]
        assert sum(known) + found.mirrored + found.outside == pytest.approx(1.0) and found.mirrored == 0.05
        assert known[1] == pytest.approx(3 * known[2]) == pytest.approx(6 * found.outside)
    assert in_map(0.0, 1.0).places[0].probability > 0.99 and in_map(0.0) == PlacePosterior()


def test_heights_of_a_plan_are_above_its_lowest_floor() -> None:
    floors = (Floor("up", "", 7.0), Floor("low", "", 4.0), Floor("attic", ""))
    plan = Plan(replace(MAP, floors=floors))
    assert [plan.height(floor) for floor in ("up", "low", "attic", None)] == [3.0, 0.0, 0.0, 0.0]
    assert plan.origin.tolist() == [*MAP.centroid().tolist(), 4.0]
