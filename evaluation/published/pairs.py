"""The pairs of the published perturbation, as the paper's data are made, and pairs whose start is moved."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from data.generation.buildings import KINDS
from data.geometry import se2
from data.plans import Plan, read_plans
from data.scene_graph.motion import moved
from evaluation.matching_benchmark.pairs import DrawnPair, Prepared, number_of, pairs_of_cell, truth_of
from evaluation.matching_benchmark.plan_sets import Candidate, load_plan, name_of_set, read_candidates

GENERATED = "apartment"  # the kind of generated plans
SITE = 15.0  # metres, largest distance of a published plan's centre from its origin, along each axis


class PublishedPair(DrawnPair):
    """The published perturbation of a plan, its start known to within `start_m` (m) along each axis.

    As in the published data, every edge of a room is a wall surface, and generated plans are close to the origin.
    """

    regime: Literal["paper"]
    start_m: float

    def prepare(self) -> Prepared:
        """Draws the S-graph, and shifts it by a motion that depends only on the pair."""
        plan = _published_plan(self.plans, self.plan)
        names = (f"paper+{self.start_m:g}m", f"{name_of_set(self.plans)}-edges/{self.plan}")
        rng = np.random.default_rng(number_of(*names, self.rooms, self.index, self.seed))
        shift = rng.uniform(-self.start_m, self.start_m, 2)
        return with_motion(Prepared.of(self.drawn_from(plan), plan), np.array([0.0, *shift]))


def with_motion(pair: Prepared, T_new_s: NDArray[np.float64]) -> Prepared:
    """The pair with its S-graph, and its truth, moved by (yaw, x, y) in rad and m."""
    if not T_new_s.any():
        return pair
    T_s_new = se2.inverse(T_new_s)

    def from_new(T_a_s: tuple[float, float, float]) -> tuple[float, float, float]:
        yaw, x, y = se2.compose(np.array(T_a_s), T_s_new).tolist()
        return yaw, x, y

    drawn = replace(
        pair.drawn, s_graph=moved(pair.drawn.s_graph, T_new_s), T_a_s=from_new(pair.drawn.T_a_s),
        T_a_s_by_room={room: from_new(T) for room, T in pair.drawn.T_a_s_by_room.items()},
    )  # fmt: skip
    return replace(pair, drawn=drawn, truth=truth_of(drawn))


def published_pairs(plans: str, count: int, seed: int) -> list[PublishedPair]:
    """`count` pairs of a folder of plans, or of as many generated ones, where the start is known."""
    if plans in KINDS:
        candidates = read_candidates([], [f"{plans}:{count}"])
    else:
        candidates = [Candidate(plans, plan) for plan in _plans_with_edges(plans).values()]
    drawn = pairs_of_cell(candidates, "paper", None, count, seed)
    return [PublishedPair(**pair.model_dump(), start_m=0.0) for pair in drawn]


def _published_plan(plans: str, name: str) -> Plan:
    if plans not in KINDS:
        return _plans_with_edges(plans)[name]
    plan = load_plan(plans, name)
    rng = np.random.default_rng(number_of(name))
    shift = rng.uniform(-SITE, SITE, 2) - plan.graph.centroid()
    return replace(plan, graph=moved(plan.graph, np.array([0.0, *shift])))


@lru_cache(maxsize=1)
def _plans_with_edges(folder: str) -> dict[str, Plan]:
    return {plan.name: plan for plan in read_plans(Path(folder), merge_collinear=False) if plan.graph.rooms}
