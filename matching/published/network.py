"""The published matcher's network: a shared encoder (MLP, then GATv2), dot products, instance norm, Sinkhorn.

Section III of the paper (see `paper_graph`); where it is silent, the authors' public code. GATv2: Brody, Alon and
Yahav, "How Attentive are Graph Attention Networks?", ICLR 2022.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import dropout, leaky_relu

from matching.published.graph import FEATURES, PaperGraph
from matching.published.sinkhorn import soft_assignment

SLOPE = 0.2  # of the leaky ReLU within the attention
LEAST_VARIANCE = 1e-5  # added to the variance of the affinities


@dataclass(frozen=True)
class PaperSettings:
    """Hyper-parameters. `sinkhorn` is the number of normalisations; `dropout` is for features, `attention_dropout` for
    attention weights.
    """

    hidden: int = 64
    out: int = 32
    layers: int = 2
    heads: int = 4
    dropout: float = 0.15
    attention_dropout: float = 0.12
    temperature: float = 1.0  # not in the paper: the class's default, as are the iterations
    sinkhorn: int = 10
    edges: str = "paper"
    without: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Returns the settings as plain data."""
        return asdict(self) | {"without": list(self.without)}

    @staticmethod
    def from_dict(value: Mapping[str, Any]) -> "PaperSettings":
        """Inverse of `to_dict`. Raises TypeError or KeyError for other data."""
        return PaperSettings(**{**value, "without": tuple(value["without"])})


PUBLISHED = PaperSettings()
REPOSITORY = PaperSettings(
    hidden=128, out=64, layers=1, heads=2, dropout=0.0539, attention_dropout=0.00185, temperature=0.238, sinkhorn=30
)
PRESETS: Mapping[str, PaperSettings] = MappingProxyType({"published": PUBLISHED, "repository": REPOSITORY})


@dataclass(frozen=True)
class Nodes:
    """The nodes of one or more graphs as tensors; `counts` are the graphs' numbers of nodes."""

    features: Tensor  # (N, 7) float
    edges: Tensor  # (2, E) long: from, to
    counts: tuple[int, ...]

    @staticmethod
    def of(graphs: Sequence[PaperGraph]) -> "Nodes":
        """Concatenates graphs without edges between them."""
        counts = tuple(len(g.ids) for g in graphs)
        first = torch.tensor((0, *counts)).cumsum(0)
        features = [torch.as_tensor(g.features, dtype=torch.float32) for g in graphs]
        edges = [torch.as_tensor(g.edges) + at for g, at in zip(graphs, first.tolist(), strict=False)]
        return Nodes(torch.cat(features), torch.cat(edges, dim=1), counts)


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
        plain = "mlp" in s.without
        self.mlp = nn.Sequential(*([] if plain else [
            nn.Linear(FEATURES, s.hidden), nn.ReLU(), nn.Dropout(s.dropout),
            nn.Linear(s.hidden, s.hidden), nn.ReLU(), nn.Dropout(s.dropout),
        ]))  # fmt: skip
        sizes = [FEATURES if plain else s.hidden, *[s.hidden] * (s.layers - 1), s.out]
        self.layers = nn.ModuleList(GATv2(a, b, s.heads, s.attention_dropout) for a, b in pairwise(sizes))
        self.scale = nn.Parameter(torch.ones(1))  # of the instance norm, and its shift
        self.shift = nn.Parameter(torch.zeros(1))
        self.register_buffer("mean", torch.zeros(FEATURES))
        self.register_buffer("std", torch.ones(FEATURES))

    def standardise_by(self, features: Tensor) -> None:
        """Stores mean and standard deviation of the training nodes (N, 7)."""
        self.mean = features.mean(dim=0)
        self.std = features.std(dim=0).clamp(min=1e-6)

    def embed(self, nodes: Nodes) -> Tensor:
        """Embeds all nodes as (N, out)."""
        x: Tensor = self.mlp((nodes.features - self.mean) / self.std)
        for k, layer in enumerate(self.layers):
            if k:
                x = dropout(torch.relu(x), self.settings.dropout, self.training)
            x = layer(x, nodes.edges)
        return x

    def assign(self, a: Tensor, s: Tensor) -> Tensor:
        """(N1, N2) soft assignment from the embeddings (N1, out) of an A-graph and (N2, out) of an S-graph."""
        affinity = a @ s.T
        variance, mean = torch.var_mean(affinity, correction=0)
        affinity = (affinity - mean) / (variance + LEAST_VARIANCE).sqrt() * self.scale + self.shift
        return soft_assignment(affinity, self.settings.temperature, self.settings.sinkhorn)

    def forward(self, a: Nodes, s: Nodes) -> list[Tensor]:
        """Returns the soft assignment of each pair of graphs."""
        ours, theirs = self.embed(a).split(a.counts), self.embed(s).split(s.counts)
        return [self.assign(x, y) for x, y in zip(ours, theirs, strict=True)]
