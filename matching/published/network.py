"""The published matcher's graphs, and its network: a shared encoder (MLP, then GATv2), dot products, instance norm,
Sinkhorn.

Sections III and V of the paper. GATv2: S. Brody, U. Alon, E. Yahav: How Attentive are Graph Attention Networks? ICLR
2022.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import dropout, leaky_relu

from data.scene_graph import SceneGraph
from data.synthetic_maps.exploration import storeys_of

FEATURES = 7
NO_LENGTH = -1.0
SLOPE = 0.2  # of the leaky ReLU within the attention
LEAST_VARIANCE = 1e-5  # added to the variance of the affinities
LEAST_LOGIT = -600.0  # below the best of its column: as good as none; less would leave double precision


@dataclass(frozen=True)
class PaperSettings:
    """Hyper-parameters of the network and its training; `sinkhorn` is the number of normalisations."""

    hidden: int = 64
    out: int = 32
    layers: int = 2
    heads: int = 4
    dropout: float = 0.15
    attention_dropout: float = 0.12
    temperature: float = 1.0  # not in the paper: the class's default, as are the iterations
    sinkhorn: int = 10
    rate: float = 1e-3
    decay: float = 5e-5
    batch: int = 16


PRESETS = {  # of the paper, and of its public code, in the order of the fields
    "published": PaperSettings(),
    "repository": PaperSettings(128, 64, 1, 2, 0.0539, 0.00185, 0.238, 30, 8.10e-4, 1.24e-5, 32),
}


@dataclass(frozen=True)
class PaperGraph:
    """N nodes, rooms first, in the order of the scene graph; messages go from `edges[0]` to `edges[1]`."""

    ids: tuple[str, ...]
    rooms: int
    features: NDArray[np.float64]  # (N, 7): is room, is wall surface, x, y, normal x, normal y, length or -1; metres
    edges: NDArray[np.int64]  # (2, E)


def paper_graph(graph: SceneGraph) -> PaperGraph:
    """Returns the nodes and edges of a scene graph, in its own frame.

    Edges go from a room to its wall surfaces, both ways between rooms that share a wall (antiparallel sides near each
    other), and in a ring between the wall surfaces of a room, counter-clockwise about its centre.
    """
    ids = [r.id for r in graph.rooms] + [w.id for w in graph.wall_surfaces]
    node = {name: k for k, name in enumerate(ids)}
    edges = {(node[w.room], node[w.id]) for w in graph.wall_surfaces if w.room is not None}
    for storey in storeys_of(graph):
        rooms = [node[r.id] for r in storey.rooms]
        edges |= {(rooms[i], rooms[j]) for i, others in enumerate(storey.across_walls) for j in others}
        for middle, walls in zip(storey.middle, storey.walls_of, strict=True):
            around = storey.centre[walls] - middle
            order = walls[np.argsort(np.arctan2(around[:, 1], around[:, 0]), kind="stable")]
            ring = [node[storey.ids[k]] for k in order]
            edges |= {(i, j) for i, j in zip(ring, ring[1:] + ring[:1], strict=True) if i != j}
    rows = [(1.0, 0.0, *r.centroid, 0.0, 0.0, NO_LENGTH) for r in graph.rooms]
    rows += [(0.0, 1.0, *w.centroid, *w.normal, w.length or NO_LENGTH) for w in graph.wall_surfaces]
    features = np.array(rows, dtype=float).reshape(-1, FEATURES)
    return PaperGraph(tuple(ids), len(graph.rooms), features, np.array(sorted(edges), dtype=np.int64).reshape(-1, 2).T)


class GATv2(nn.Module):
    """One layer of graph attention with averaged heads and self-loops."""

    def __init__(self, inputs: int, outputs: int, heads: int, drop: float) -> None:
        super().__init__()
        self.source = nn.Linear(inputs, heads * outputs)
        self.target = nn.Linear(inputs, heads * outputs)
        self.attention = nn.Parameter(torch.empty(heads, outputs))
        self.bias = nn.Parameter(torch.zeros(outputs))
        self.heads, self.drop = heads, drop
        for weight in (self.source.weight, self.target.weight, self.attention):
            nn.init.xavier_uniform_(weight)
        for bias in (self.source.bias, self.target.bias):
            nn.init.zeros_(bias)

    def forward(self, x: Tensor, edges: Tensor) -> Tensor:
        """Maps (N, inputs) to (N, outputs); `edges` (2, E) hold the sending and the receiving node of each message."""
        loops = torch.arange(len(x), device=x.device)
        u, v = torch.cat((edges, loops.expand(2, -1)), dim=1)
        sent = self.source(x).view(len(x), self.heads, -1)
        heard = self.target(x).view(len(x), self.heads, -1)
        score = (leaky_relu(sent[u] + heard[v], SLOPE) * self.attention).sum(dim=-1)
        weight = dropout(_softmax_by(score, v, len(x)), self.drop, self.training)
        messages = torch.zeros_like(sent).index_add(0, v, weight[..., None] * sent[u])
        return messages.mean(dim=1) + self.bias


def _softmax_by(score: Tensor, group: Tensor, groups: int) -> Tensor:
    """(E, H) softmax over the rows of each group; `group` (E,)."""
    rows = group[:, None].expand_as(score)
    high = score.new_full((groups, score.shape[1]), -torch.inf).scatter_reduce(0, rows, score.detach(), "amax")
    raised = (score - high[group]).exp()
    return raised / score.new_zeros(groups, score.shape[1]).index_add(0, group, raised)[group]


class PaperNetwork(nn.Module):
    """Maps an A-graph and an S-graph to a soft assignment."""

    mean: Tensor
    std: Tensor

    def __init__(self, settings: PaperSettings) -> None:
        super().__init__()
        self.settings = s = settings
        self.mlp = nn.Sequential(
            *(nn.Linear(FEATURES, s.hidden), nn.ReLU(), nn.Dropout(s.dropout)),
            *(nn.Linear(s.hidden, s.hidden), nn.ReLU(), nn.Dropout(s.dropout)),
        )
        sizes = [*[s.hidden] * s.layers, s.out]
        self.layers = nn.ModuleList(GATv2(a, b, s.heads, s.attention_dropout) for a, b in pairwise(sizes))
        self.scale = nn.Parameter(torch.ones(1))  # of the instance norm, and its shift
        self.shift = nn.Parameter(torch.zeros(1))
        self.register_buffer("mean", torch.zeros(FEATURES))
        self.register_buffer("std", torch.ones(FEATURES))

    def standardise_by(self, graphs: Sequence[PaperGraph]) -> None:
        """Stores mean and standard deviation of the features of training graphs."""
        features = _features(graphs)
        self.mean = features.mean(dim=0)
        self.std = features.std(dim=0).clamp(min=1e-6)

    def embed(self, graphs: Sequence[PaperGraph]) -> Sequence[Tensor]:
        """Embeds the nodes of each graph as (N, out)."""
        counts = [len(g.ids) for g in graphs]
        first = np.cumsum([0, *counts])[:-1]
        edges = torch.cat([torch.as_tensor(g.edges + k) for g, k in zip(graphs, first, strict=True)], dim=1)
        x: Tensor = self.mlp((_features(graphs) - self.mean) / self.std)
        for k, layer in enumerate(self.layers):
            if k:
                x = dropout(torch.relu(x), self.settings.dropout, self.training)
            x = layer(x, edges)
        return x.split(counts)

    def assign(self, a: Tensor, s: Tensor) -> Tensor:
        """(N1, N2) soft assignment from the embeddings (N1, out) of an A-graph and (N2, out) of an S-graph."""
        affinity = a @ s.T
        variance, mean = torch.var_mean(affinity, correction=0)
        affinity = (affinity - mean) / (variance + LEAST_VARIANCE).sqrt() * self.scale + self.shift
        return soft_assignment(affinity, self.settings.temperature, self.settings.sinkhorn)

    def forward(self, a: Sequence[PaperGraph], s: Sequence[PaperGraph]) -> list[Tensor]:
        """Returns the soft assignment (N1, N2) of each A-graph and its S-graph."""
        return [self.assign(x, y) for x, y in zip(self.embed(a), self.embed(s), strict=True)]


def _features(graphs: Sequence[PaperGraph]) -> Tensor:
    return torch.cat([torch.as_tensor(g.features, dtype=torch.float32) for g in graphs])


def soft_assignment(affinity: Tensor, temperature: float, iterations: int) -> Tensor:
    """Returns (N1, N2) Sinkhorn's soft assignment of an affinity (N1, N2), without its dummies.

    The smaller side is filled with |N1 - N2| dummies of equal affinity; normalisations alternate between the smaller
    graph's nodes (with the dummies) and the larger's. The dummies stay equal, so one column weighted by their number
    replaces them. Double precision makes logarithms unnecessary.
    """
    if affinity.shape[0] < affinity.shape[1]:
        return soft_assignment(affinity.T, temperature, iterations).T
    logits = affinity.double() / temperature
    dummies = logits.shape[0] - logits.shape[1]
    kernel = (logits - logits.detach().amax(dim=0)).clamp(min=LEAST_LOGIT).exp()
    many = kernel.new_ones(kernel.shape[1])
    if dummies:
        kernel = torch.cat((kernel, kernel.new_ones(len(kernel), 1)), dim=1)
        many = torch.cat((many, many.new_full((1,), float(dummies))))
    row, column = kernel.new_ones(kernel.shape[0]), kernel.new_ones(kernel.shape[1])
    for k in range(iterations):
        if k % 2 == 0:
            column = 1 / (row @ kernel)
        else:
            row = 1 / (kernel @ (many * column))
    return (row[:, None] * kernel * column)[:, : affinity.shape[1]].to(affinity.dtype)
