"""Generated plans by their splits, and which hypotheses on a map of known truth are right."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from data.generation.buildings import generate_plan
from data.geometry import se2
from data.geometry.se2 import Array
from data.plans.bim import Plan, Split, split_of
from data.scene_graph import SceneGraph
from data.synthetic_maps.noise_models import DrawnGraph
from matching.engine.assignment import Pairs
from matching.engine.hypotheses import Hypotheses

KINDS = ("apartment", "office", "corridor", "l_shape", "skewed", "mirrored_twins", "tower")
ROOMS = (1, 2, 3, 4, 6, 9, None)
SEEDS = 90  # of generated plans of each kind
THINNED = 0.2, 0.6  # shares of the walls that a plan lacks
RIGHT = 0.8  # of a hypothesis' wall pairs, by number, that are true, or
RIGHT_M, RIGHT_RAD = 1.0, float(np.radians(5))  # how near it is to the true place
Surfaces = tuple[tuple[float, bool], ...]  # shares of a hypothesis' pairs of surfaces, and whether they are true


def seeds_of(split: Split) -> dict[str, tuple[int, ...]]:
    """The seeds below `SEEDS` whose generated buildings are in a split, by kind."""
    return {kind: tuple(k for k in range(SEEDS) if split_of(f"generated/{kind}_{k}") == split) for kind in KINDS}


@lru_cache(maxsize=2048)
def generated(kind: str, seed: int) -> Plan:
    """A generated plan, the same object for the same seed."""
    return generate_plan(kind, seed)


def thinned(plan: SceneGraph, rng: np.random.Generator) -> SceneGraph:
    """The plan without some of its walls."""
    kept = rng.random(len(plan.wall_surfaces)) >= rng.uniform(*THINNED)
    return replace(plan, wall_surfaces=tuple(w for w, keep in zip(plan.wall_surfaces, kept, strict=True) if keep))


def right_of(found: Hypotheses, truth: DrawnGraph, surfaces: Sequence[Surfaces]) -> tuple[bool, ...]:
    """Whether each hypothesis with these pairs is right: of a map that deforms many walls may be a neighbour's."""
    near = is_near(found, truth.s_graph, np.array(truth.T_a_s), truth.floor)
    return tuple(
        near[k] or (len(walls) > 0 and sum(true for _, true in walls) > RIGHT * len(walls))
        for k, walls in enumerate(surfaces)
    )


def is_near(found: Hypotheses, s: SceneGraph, true: Array, floor: str | None) -> list[bool]:
    """Whether each hypothesis is near the true place (3,) of a map."""
    middle = np.array(s.centroid())
    off = np.linalg.norm(se2.apply(found.between_graphs, middle) - se2.apply(true, middle), axis=-1)
    turn = np.abs(se2.wrap(found.between_graphs[:, 0] - true[0]))
    floors = [floor in (None, found.scene.plan.storeys[int(k)].floor) for k in found.fields.storey]
    return [bool(near) for near in (off < RIGHT_M) & (turn < RIGHT_RAD) & np.array(floors)]


def surfaces_of(found: Hypotheses, k: int, pairs: Pairs, truth: DrawnGraph) -> Surfaces:
    """The shares of a hypothesis' pairs of surfaces, and whether they are true."""
    s, a = found.scene.s, found.scene.plan.storeys[int(found.fields.storey[k])]
    return tuple((c, truth.wall_surfaces.get(s.ids[i]) == a.ids[j]) for i, j, c in pairs.surfaces)
