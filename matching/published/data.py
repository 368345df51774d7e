"""Training pairs for the published matcher: plans like its own, S-graphs with its own perturbation.

As in the published data, pairs are drawn once, before training, and every node of an S-graph has a match. The plans
differ: they are generated (two thirds apartments, the others skewed) or read from files, and lie as those of Modified
Swiss Dwellings do: in any orientation, their middle within 15 m of the origin.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data.generation.buildings import generate_plan
from data.geometry import se2
from data.plans.sources import Plan
from data.scene_graph import SceneGraph
from data.scene_graph.motion import moved
from data.synthetic_maps.noise_models import draw
from matching.published.graph import PaperGraph, paper_graph
from matching.training.data import varied

FROM_FILES = 0.5
SKEWED = 1 / 3  # of the generated
SITE = 15.0  # m
MOST_NODES = 310  # of a plan: the published set's largest
BINS = 5  # of size, by quantiles, each of which is split alike
SHARES = (0.7, 0.15)  # for training and validation; the rest is for test


@dataclass(frozen=True)
class PaperPair:
    """Two graphs and their true matches: `match` (N2,) is the A node of each S node, -1 for none."""

    building: str
    a: PaperGraph
    s: PaperGraph
    match: np.ndarray

    def assignment(self) -> Tensor:
        """(N1, N2) 1 where the nodes match, otherwise 0."""
        truth = torch.zeros(len(self.a.ids), len(self.s.ids))
        found = np.flatnonzero(self.match >= 0)
        truth[self.match[found], found] = 1.0
        return truth


def drawn_pairs(count: int, seed: int, plans: Sequence[Plan]) -> list[PaperPair]:
    """`count` pairs; the same for the same seed and plans."""
    return [_drawn(np.random.default_rng([seed, k]), plans) for k in range(count)]


def _drawn(rng: np.random.Generator, plans: Sequence[Plan]) -> PaperPair:
    """A plan and an S-graph drawn from it."""
    while True:
        if plans and rng.random() < FROM_FILES:
            plan = plans[int(rng.integers(len(plans)))]
            graph = varied(plan.graph, rng)
        else:
            plan = generate_plan("skewed" if rng.random() < SKEWED else "apartment", int(rng.integers(100_000)))
            graph = plan.graph
        if len(graph.rooms) + len(graph.wall_surfaces) <= MOST_NODES:
            break
    graph = laid_out(graph, rng)
    drawn = draw(graph, "paper", rng)
    a, s = paper_graph(graph), paper_graph(drawn.s_graph)
    node = {name: k for k, name in enumerate(a.ids)}
    truth = {**drawn.rooms, **drawn.wall_surfaces}
    match = np.array([node[truth[i]] if i in truth else -1 for i in s.ids], dtype=np.int64)
    return PaperPair(plan.building, a, s, match)


def laid_out(graph: SceneGraph, rng: np.random.Generator) -> SceneGraph:
    """Returns the plan in a random orientation, its middle in the square of 30 m about the origin."""
    yaw = float(rng.uniform(-np.pi, np.pi))
    return moved(graph, np.array([yaw, *(rng.uniform(-SITE, SITE, 2) - se2.rotate(yaw, graph.centroid()))]))


def split(pairs: Sequence[PaperPair], seed: int) -> tuple[list[PaperPair], list[PaperPair], list[PaperPair]]:
    """Splits pairs into 70 % for training, 15 % for validation and 15 % for test, within each of five size classes of
    S-graphs; those of a building stay together.
    """
    buildings: dict[str, list[PaperPair]] = {}
    for pair in pairs:
        buildings.setdefault(pair.building, []).append(pair)
    by_size = sorted(buildings, key=lambda b: (float(np.mean([len(p.s.ids) for p in buildings[b]])), b))
    rng = np.random.default_rng(seed)
    parts: tuple[list[PaperPair], list[PaperPair], list[PaperPair]] = ([], [], [])
    for of_size in np.array_split(np.array(by_size), BINS):
        ends = [round(sum(SHARES[:k]) * len(of_size)) for k in (1, 2)]
        for part, names in zip(parts, np.split(rng.permutation(of_size), ends), strict=True):
            part += [p for name in names.tolist() for p in buildings[name]]
    return parts
