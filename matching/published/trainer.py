"""Training of the published matcher: its pairs of graphs, permutation loss, AdamW, early stopping.

As in the published data, pairs are drawn once, before training, and every node of an S-graph has a match. The plans
differ: they are generated (two thirds apartments, the others skewed) or read from files, and lie as those of Modified
Swiss Dwellings do: in any orientation, their middle within 15 m of the origin.
"""

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from data.common.files import write_atomically
from data.generation.buildings import generate_plan
from data.geometry import se2
from data.plans.bim import Plan
from data.scene_graph import SceneGraph, Xy
from data.scene_graph.graph import moved
from data.synthetic_maps.noise_models import draw
from matching.published.network import PaperGraph, PaperNetwork, PaperSettings, paper_graph

FROM_FILES = 0.5
SKEWED = 1 / 3  # of the generated
SITE = 15.0  # m
MOST_NODES = 310  # of a plan: the published set's largest
LEAST_PROBABILITY = 1e-9
PATIENCE = 20  # epochs without a smaller validation loss
EVALUATED_AT_ONCE = 64  # pairs of a batch in evaluation
STRETCH = 0.18  # plans of files are stretched along x and y by up to so much, and every other one is mirrored
Row = dict[str, float]


@dataclass(frozen=True)
class PaperPair:
    """Two graphs and their true matches: `match` (N2,) is the A node of each S node, -1 for none."""

    building: str
    a: PaperGraph
    s: PaperGraph
    match: np.ndarray


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


def varied(a: SceneGraph, rng: np.random.Generator) -> SceneGraph:
    """Returns the plan stretched along its axes, and mirrored in half of the cases."""
    stretch = rng.uniform(1 - STRETCH, 1 + STRETCH, 2) * [rng.choice([-1, 1]), 1]

    def moved(p: Xy) -> Xy:
        return (float(p[0] * stretch[0]), float(p[1] * stretch[1]))

    surfaces, rooms = [], []
    for w in a.wall_surfaces:
        x, y = np.array(w.normal) / stretch  # normals go with the inverse
        normal = (float(x / np.hypot(x, y)), float(y / np.hypot(x, y)))
        along = float(np.hypot(w.normal[1] * stretch[0], w.normal[0] * stretch[1]))
        length = None if w.length is None else w.length * along
        surfaces.append(replace(w, centroid=moved(w.centroid), normal=normal, length=length, plane=None))
    for r in a.rooms:
        ring = None if r.polygon is None else tuple(moved(p) for p in r.polygon)
        ring = ring[::-1] if ring is not None and stretch[0] < 0 else ring
        rooms.append(replace(r, centroid=moved(r.centroid), polygon=ring))
    doors = tuple(replace(d, centroid=moved(d.centroid)) for d in a.doors)
    return SceneGraph(a.frame, tuple(rooms), tuple(surfaces), doors, a.floors)


def laid_out(graph: SceneGraph, rng: np.random.Generator) -> SceneGraph:
    """Returns the plan in a random orientation, its middle in the square of 30 m about the origin."""
    yaw = float(rng.uniform(-np.pi, np.pi))
    return moved(graph, np.array([yaw, *(rng.uniform(-SITE, SITE, 2) - se2.rotate(yaw, graph.centroid()))]))


def train(
    settings: PaperSettings, pairs: Sequence[PaperPair], validation: Sequence[PaperPair], seed: int, epochs: int
) -> Iterator[tuple[PaperNetwork, list[Row]]]:
    """Trains until the epochs are done or the validation loss no longer falls. The same seed gives the same weights.

    Yields after each epoch the network of the lowest validation loss, ready for inference, and a row for each epoch.
    """
    torch.set_num_threads(1)  # several add up in another order each time, and are slower on graphs this small
    torch.manual_seed(seed)
    network = PaperNetwork(settings)
    network.standardise_by([p.a for p in pairs] + [p.s for p in pairs])
    optimizer = torch.optim.AdamW(network.parameters(), settings.rate, weight_decay=settings.decay)
    best, best_epoch = copy.deepcopy(network), 0
    curve: list[Row] = []
    for epoch in range(epochs):
        torch.manual_seed(seed * 1_000_003 + epoch)  # of the dropouts
        order = np.random.default_rng([seed, epoch]).permutation(len(pairs))
        row = {"epoch": float(epoch), "loss": _epoch(network, optimizer, [pairs[k] for k in order])}
        row["validation loss"], row["validation accuracy"] = evaluate(network, validation)
        curve.append(row)
        if row["validation loss"] <= min(r["validation loss"] for r in curve):
            best, best_epoch = copy.deepcopy(network).requires_grad_(False), epoch
        yield best, curve
        if epoch - best_epoch >= PATIENCE:
            break


def _epoch(network: PaperNetwork, optimizer: torch.optim.Optimizer, pairs: Sequence[PaperPair]) -> float:
    """Trains on every pair once, in order; returns the mean loss."""
    network.train()
    total, size = 0.0, network.settings.batch
    for first in range(0, len(pairs), size):
        batch = pairs[first : first + size]
        loss = permutation_loss(network([p.a for p in batch], [p.s for p in batch]), batch)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        total += loss.item() * len(batch)
    return total / len(pairs)


def permutation_loss(soft: Sequence[Tensor], pairs: Sequence[PaperPair]) -> Tensor:
    """Mean over pairs of the mean binary cross-entropy over all entries of the assignment (PCA-GM)."""
    losses = []
    for p, pair in zip(soft, pairs, strict=True):
        p = p.clamp(LEAST_PROBABILITY, 1 - 1e-7)  # close to 1, within single precision
        truth, found = torch.zeros_like(p), np.flatnonzero(pair.match >= 0)
        truth[pair.match[found], found] = 1.0
        losses.append(-(truth * p.log() + (1 - truth) * torch.log1p(-p)).mean())
    return torch.stack(losses).mean()


@torch.no_grad()
def evaluate(network: PaperNetwork, pairs: Sequence[PaperPair]) -> tuple[float, float]:
    """Returns the loss and the share of matched S nodes whose assignment is right."""
    network.eval()
    loss, right, all_of = 0.0, 0, 0
    for first in range(0, len(pairs), EVALUATED_AT_ONCE):
        batch = pairs[first : first + EVALUATED_AT_ONCE]
        soft = network([p.a for p in batch], [p.s for p in batch])
        loss += permutation_loss(soft, batch).item() * len(batch)
        for p, pair in zip(soft, batch, strict=True):
            a, s = linear_sum_assignment(p.numpy(), maximize=True)
            right += int((pair.match[s] == a).sum())
            all_of += int((pair.match >= 0).sum())
    return loss / max(len(pairs), 1), right / max(all_of, 1)


def write_curve(path: Path, curve: Sequence[Row]) -> None:
    """Writes a table (.csv) with a row for each epoch."""
    lines = [list(curve[0]), *([f"{value:.6g}" for value in row.values()] for row in curve)]
    write_atomically(path, "".join(",".join(line) + "\n" for line in lines))
