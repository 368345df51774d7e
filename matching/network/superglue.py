"""SuperGlue on this project's features: alternating attention within and across graphs, dot products, a dustbin.

P.-E. Sarlin, D. DeTone, T. Malisiewicz, A. Rabinovich: SuperGlue: Learning Feature Matching with Graph Neural Networks.
CVPR 2020. Both directions of cross attention share their similarities, as in P. Lindenberger, P.-E. Sarlin,
M. Pollefeys: LightGlue. ICCV 2023. Attention within a graph is over neighbours, since only relative poses are known.
"""

from dataclasses import asdict, dataclass

import torch
from torch import Tensor, nn

from matching.network.encoder import HEADS, Encoder, GraphTensors, NeighbourAttention
from matching.network.features import PairRows
from matching.network.network import Output
from matching.network.parts import Embedded, Side, embedded, output_of, sinkhorn


@dataclass(frozen=True)
class SuperGlueSettings:
    """The size of the network, stored in its file."""

    width: int = 64
    layers: int = 3  # within and across


class CrossAttention(nn.Module):
    """Attention of each node of one graph to all of the other, both ways."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.before = nn.LayerNorm(width)
        self.key, self.value = nn.Linear(width, width), nn.Linear(width, width)
        self.ffn = nn.Sequential(nn.Linear(2 * width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))

    def forward(self, s: Side, a: Side, in_s: Tensor, in_a: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the updated nodes of both sides; pairs do not influence each other."""
        x, y = self.before(in_s), self.before(in_a)
        (key_x, value_x), (key_y, value_y) = (
            tuple(f(z).unflatten(1, (HEADS, -1)).transpose(0, 1) for f in (self.key, self.value)) for z in (x, y)
        )
        scale = float(key_x.shape[-1]) ** -0.5
        message_x, message_y = [], []
        for i, j in zip(s.whole, a.whole, strict=True):
            alike = scale * key_x[:, i] @ key_y[:, j].transpose(1, 2)  # (heads, n, m)
            message_x.append((alike.softmax(dim=2) @ value_y[:, j]).transpose(0, 1).flatten(1))
            message_y.append((alike.softmax(dim=1).transpose(1, 2) @ value_x[:, i]).transpose(0, 1).flatten(1))
        return (
            in_s + self.ffn(torch.cat((x, torch.cat(message_x)), dim=1)),
            in_a + self.ffn(torch.cat((y, torch.cat(message_y)), dim=1)),
        )


class SuperGlue(nn.Module):
    """A baseline with the interface of `MatchingNetwork`."""

    kind = "superglue"

    def __init__(self, settings: SuperGlueSettings) -> None:
        super().__init__()
        self.settings = settings
        width, layers = settings.width, settings.layers
        self.encoder = Encoder(width, 1)
        self.across = nn.ModuleList(CrossAttention(width) for _ in range(layers))
        self.within = nn.ModuleList(NeighbourAttention(width) for _ in range(layers - 1))
        self.last = nn.ModuleList(nn.Sequential(nn.LayerNorm(width), nn.Linear(width, width)) for _ in range(2))
        self.dustbin = nn.Parameter(torch.ones(2))  # of walls, of rooms

    def encode(self, graph: GraphTensors) -> Embedded:
        """Encodes a graph on its own: the first attention within it."""
        return embedded(self.encoder, graph)

    def forward(self, s: Embedded, a: Embedded, pairs: list[PairRows]) -> Output:
        """Matches every pair of a batch; each has at least one wall on both sides."""
        ours, theirs = Side.both(s, a, pairs)
        in_s, in_a = self.across[0](ours, theirs, ours.nodes, theirs.nodes)
        for within, across in zip(self.within, self.across[1:], strict=True):
            in_s = within(in_s, ours.edge, ours.neighbour)
            in_a = within(in_a, theirs.edge, theirs.neighbour)
            in_s, in_a = across(ours, theirs, in_s, in_a)
        both = list(zip(ours.parts(in_s), theirs.parts(in_a), strict=True))
        walls, rooms = ([self._table(x[k], y[k], k) for x, y in both] for k in (0, 1))
        return output_of(walls, rooms)

    def _table(self, s: Tensor, a: Tensor, k: int) -> Tensor:
        score = self.last[k](s) @ self.last[k](a).T / s.shape[1] ** 0.5
        return sinkhorn(score, self.dustbin[k])

    def to_dict(self) -> dict[str, int]:
        """Returns the settings as stored with the weights."""
        return asdict(self.settings)
