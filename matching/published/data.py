"""Pairs on which the published matcher is trained: plans like its own, S-graphs by its own perturbation.

As in the published data a pair is drawn once, before training, and the S-graph has no node without a match. What
differs is where the plans are from: Modified Swiss Dwellings' table is not shipped, so they are drawn by
`data.generation.buildings` (two in three apartments, the others skewed ones) and read from files, each stretched and
mirrored anew and laid where the table's plans lie: turned anyhow, their middle within 15 m of the origin.
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
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching.published.graph import PaperGraph, paper_graph
from matching.published.network import Nodes, PaperSettings
from matching.training.data import varied

FROM_FILES = 0.5
SKEWED = 1 / 3  # of the generated
SITE = 15.0  # m
MOST_NODES = 310  # of a plan: the published set's largest
BINS = 5  # of size, by quantiles, each of which is split alike
SHARES = (0.7, 0.15)  # for training and validation; the rest is for test


@dataclass(frozen=True)
class PaperPair:
    """Two graphs and the truth: `match` (N2,) is the A node of each S node, -1 where there is none."""

    group: str  # pairs of one group stay together when the set is split
    a: PaperGraph
    s: PaperGraph
    match: np.ndarray

    def assignment(self) -> Tensor:
        """(N1, N2) 1 where the nodes match, else 0."""
        truth = torch.zeros(len(self.a.ids), len(self.s.ids))
        found = np.flatnonzero(self.match >= 0)
        truth[self.match[found], found] = 1.0
        return truth


@dataclass(frozen=True)
class PaperSplit:
    """The three parts of a set of pairs."""

    train: tuple[PaperPair, ...]
    validation: tuple[PaperPair, ...]
    test: tuple[PaperPair, ...]


def pair_of(group: str, a: SceneGraph, drawn: DrawnGraph, settings: PaperSettings) -> PaperPair:
    """A plan and an S-graph that was drawn from it."""
    ours, theirs = (paper_graph(g, settings.edges, settings.without) for g in (a, drawn.s_graph))
    node = {name: k for k, name in enumerate(ours.ids)}
    truth = {**drawn.rooms, **drawn.wall_surfaces}
    match = np.array([node[truth[i]] if i in truth else -1 for i in theirs.ids], dtype=np.int64)
    return PaperPair(group, ours, theirs, match)


def drawn_pairs(count: int, seed: int, plans: Sequence[Plan], settings: PaperSettings) -> list[PaperPair]:
    """`count` pairs; the same for the same seed and plans."""
    return [_drawn(np.random.default_rng([seed, k]), k, plans, settings) for k in range(count)]


def _drawn(rng: np.random.Generator, k: int, plans: Sequence[Plan], settings: PaperSettings) -> PaperPair:
    while True:
        if plans and rng.random() < FROM_FILES:
            plan = plans[int(rng.integers(len(plans)))]
            graph = varied(plan.graph, rng)
        else:
            plan = generate_plan("skewed" if rng.random() < SKEWED else "apartment", int(rng.integers(100_000)))
            graph = plan.graph
        if len(graph.rooms) + len(graph.wall_surfaces) <= MOST_NODES:
            a = laid_out(graph, rng)
            return pair_of(plan.building, a, draw(a, "paper", rng), settings)


def laid_out(graph: SceneGraph, rng: np.random.Generator) -> SceneGraph:
    """The plan turned by any angle, its middle moved into the square of 30 m about the origin."""
    yaw = float(rng.uniform(-np.pi, np.pi))
    return moved(graph, np.array([yaw, *(rng.uniform(-SITE, SITE, 2) - se2.rotate(yaw, graph.centroid()))]))


def split(pairs: Sequence[PaperPair], seed: int) -> PaperSplit:
    """70 / 15 / 15 %, of each of five sizes of S-graphs alike; pairs of one group stay together."""
    groups: dict[str, list[PaperPair]] = {}
    for pair in pairs:
        groups.setdefault(pair.group, []).append(pair)
    named = sorted(groups, key=lambda g: (float(np.mean([len(p.s.ids) for p in groups[g]])), g))
    rng = np.random.default_rng(seed)
    parts: tuple[list[PaperPair], ...] = ([], [], [])
    for of_size in np.array_split(np.array(named), BINS):
        order = rng.permutation(of_size).tolist()
        ends = [round(sum(SHARES[:k]) * len(order)) for k in (1, 2)]
        for part, names in zip(parts, (order[: ends[0]], order[ends[0] : ends[1]], order[ends[1] :]), strict=True):
            part += [p for name in names for p in groups[name]]
    return PaperSplit(*map(tuple, parts))


def nodes_of(pairs: Sequence[PaperPair]) -> tuple[Nodes, Nodes]:
    """The A-graphs and the S-graphs of pairs as tensors."""
    return Nodes.of([p.a for p in pairs]), Nodes.of([p.s for p in pairs])
