"""The posterior of a map's place: each place on each storey of the plan, outside of it, or mirrored.

The matcher gives the probability of each place of one floor. What else is known multiplies it: the storey that was
stated, those that the heights between the floors allow, how well the mirror image fits, and the other floors' answers.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.geometry import se2
from matching.result import MatchResult
from sgslam.anchoring.storey_hypotheses import Assignment

Floats = NDArray[np.float64]
APART = 1.0, np.radians(5)  # m and rad from which on two places of a map differ
MOST_NATS = 12.0  # of a place before all others: beyond, it is certain that none of them is right
# prior probabilities
_MIRRORED = 0.003  # that scans were recorded mirrored or upside down
_MISSTATED = 0.001  # that a storey that the user states, or that the heights leave, is another one
_UNLISTED = 0.03  # that the true place is not among the matcher's hypotheses: 0 to 3 % by noise model


@dataclass(frozen=True)
class Place:
    """A place of the map, `T_a_s` (3,), yaw x y in the frame of the plan, on a storey, and its `probability`."""

    T_a_s: tuple[float, float, float]
    floor: str | None
    probability: float


@dataclass(frozen=True)
class PlacePosterior:
    """The probabilities of the map's `places`, best first, and of it being `mirrored`; the rest is that of none."""

    places: tuple[Place, ...] = ()
    mirrored: float = 0.0

    @property
    def outside(self) -> float:
        """The probability that the map is at none of the places."""
        return max(0.0, 1.0 - self.mirrored - sum(place.probability for place in self.places))

    @property
    def two_best(self) -> tuple[tuple[float, str | None], tuple[float, str | None]]:
        """The probabilities and storeys of the best place and of the runner-up; 0 and None where there is none."""
        best, other = ([(place.probability, place.floor) for place in self.places] + 2 * [(0.0, None)])[:2]
        return best, other

    def at(self, T_a_s: Floats, floor: str | None, s: SceneGraph) -> float:
        """The probability of a place (3,) of a map, with those that do not differ from it."""
        near = (p for p in self.places if p.floor == floor and not differ(np.array(p.T_a_s), T_a_s, s))
        return sum(place.probability for place in near)


def differ(place: Floats, other: Floats, s: SceneGraph, metres: float = APART[0]) -> bool:
    """Whether two places (3,) differ by more than `metres` at the centroid of the map, or by five degrees."""
    middle = np.array(s.centroid())
    off = np.linalg.norm(se2.apply(place, middle) - se2.apply(other, middle))
    return bool(off > metres or abs(se2.wrap(place[:1] - other[:1])[0]) > APART[1])


def place_posterior(
    match: MatchResult, image: MatchResult | None, storeys: Collection[str], of: int = 1
) -> PlacePosterior:
    """The posterior by a matcher's answer about one floor, and by that about its mirror `image`, if it was asked.

    `storeys` are those that the user and the heights between the floors allow `of` so many, all where it is empty. Of a
    matcher that computes no probabilities, a unique answer is believed.
    """
    places = [Place(h.T_a_s, h.floor, h.probability) for h in match.hypotheses if h.probability is not None]
    if not places and match.status == "unique" and match.T_a_s is not None:
        places = [Place(match.T_a_s, match.floor, 1.0)]
    none = max(0.0, 1.0 - sum(place.probability for place in places))
    mirrored, of_image = 0.0, () if image is None else image.hypotheses
    if places and of_image:
        # one more place, with a prior of its own
        best, unit = max(h.score for h in match.hypotheses), match.temperature
        likely = (math.exp(min((h.score - best) / unit, 50.0)) * _prior(h.floor, storeys, of) for h in of_image)
        mirrored = _MIRRORED * places[0].probability * max(likely)
    places = [replace(p, probability=_prior(p.floor, storeys, of) * p.probability) for p in places]
    total = none + mirrored + sum(place.probability for place in places)
    places = [replace(place, probability=place.probability / max(total, 1e-12)) for place in places]
    return PlacePosterior(tuple(sorted(places, key=lambda p: -p.probability)), mirrored / max(total, 1e-12))


def in_known_map(posterior: PlacePosterior, conflict: float, model: Sequence[float]) -> PlacePosterior:
    """The posterior in the map of an earlier run, which may lack the true place and have one that looks like it.

    The best place is as probable as a logistic `model` (3,) says: of the nats by which it leads all others, of the root
    of the share of walls in `conflict` with free space there, and a constant. How much the map explains says nothing.
    """
    if not posterior.places:
        return posterior
    best = posterior.places[0]
    nats = lead([place.probability for place in posterior.places])
    log_odds = model[0] * nats + model[1] * math.sqrt(conflict) + model[2]
    known = (1 - posterior.mirrored) / (1 + math.exp(-log_odds))
    rest = (1 - known - posterior.mirrored) / max(1 - best.probability - posterior.mirrored, 1e-12)
    lesser = (replace(place, probability=rest * place.probability) for place in posterior.places[1:])
    return PlacePosterior((replace(best, probability=known), *lesser), posterior.mirrored)


def lead(probabilities: Sequence[float]) -> float:
    """The nats by which the first of some places leads all others together."""
    others = sum(probabilities[1:]) / max(sum(probabilities), 1e-12)
    return -math.log(max(others, math.exp(-MOST_NATS)))


def joint_posterior(
    known: Mapping[int, PlacePosterior], graphs: Mapping[int, SceneGraph], possible: list[Assignment]
) -> tuple[Assignment, PlacePosterior]:
    """The posterior by what is `known` of several floors of one map, which are at one place in plan view.

    The storeys of the floors are one of the `possible` assignments; returned is that of the best place, and the places
    of the first floor. Floors whose graph does not show where it is leave it to the others.
    """
    in_plan = {k: sum(place.probability for place in own.places) for k, own in known.items()}
    unlisted = {k: _UNLISTED * share + (1 - share) for k, share in in_plan.items()}
    found: list[tuple[float, Assignment, Place]] = []
    for assigned in possible:
        distinct: list[Floats] = []
        for place in (p for k, own in known.items() for p in own.places if p.floor == assigned.get(k)):
            T = np.array(place.T_a_s)
            if all(any(differ(T, other, graph) for graph in graphs.values()) for other in distinct):
                distinct.append(T)
                weight = math.prod(own.at(T, assigned.get(k), graphs[k]) or unlisted[k] for k, own in known.items())
                found.append((weight, assigned, place))
    if not found:
        return {}, PlacePosterior()
    found.sort(key=lambda one: -one[0])
    share, first = max(in_plan.values()) / sum(weight for weight, _, _ in found), min(known)
    places = (Place(place.T_a_s, assigned.get(first), share * weight) for weight, assigned, place in found)
    return found[0][1], PlacePosterior(tuple(places))


def _prior(floor: str | None, storeys: Collection[str], of: int) -> float:
    """How much more likely it is that these storeys, `of` so many, are left where the map is on this floor, than where
    it is nowhere in the plan: of equal storeys, the one that is stated is as probable as all were together."""
    if not storeys:
        return 1.0
    return max(of / len(storeys), 1.0) if floor in storeys else _MISSTATED
