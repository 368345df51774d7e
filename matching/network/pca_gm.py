"""PCA-GM on this project's features: a bilinear affinity, and a convolution across both graphs along likely matches.

R. Wang, J. Yan, X. Yang: Learning Combinatorial Embedding Networks for Deep Graph Matching. ICCV 2019. Convolutions
within a graph are attention over neighbours, since only relative poses are known. Maps and plans have nodes that the
other lacks, so Sinkhorn has a dustbin.
"""

from dataclasses import asdict, dataclass

import torch
from torch import Tensor, nn

from matching.network.encoder import Encoder, GraphTensors, NeighbourAttention
from matching.network.features import PairRows
from matching.network.network import Output
from matching.network.parts import Embedded, Side, embedded, output_of, sinkhorn


@dataclass(frozen=True)
class PcaGmSettings:
    """The size of the network, stored in its file."""

    width: int = 64
    layers: int = 2  # within the graphs, before they meet


class Affinity(nn.Module):
    """Soft assignment of S nodes to A nodes of the same type, or to none."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.bilinear = nn.Parameter(torch.eye(width) + 0.02 * torch.randn(width, width))
        self.norm = nn.LayerNorm(width)
        self.sharpness = nn.Parameter(torch.tensor([8.0, 8.0]))  # of walls, of rooms: the inverse of tau
        self.dustbin = nn.Parameter(torch.zeros(2))

    def forward(self, s: Tensor, a: Tensor, of_rooms: bool) -> Tensor:
        """(n, m + 1) logarithms, from (n, width) and (m, width)."""
        score = self.norm(s) @ self.bilinear @ self.norm(a).T / s.shape[1]
        return sinkhorn(self.sharpness[int(of_rooms)] * score, self.dustbin[int(of_rooms)])


class PcaGm(nn.Module):
    """A baseline with the interface of `MatchingNetwork`."""

    kind = "pca-gm"

    def __init__(self, settings: PcaGmSettings) -> None:
        super().__init__()
        self.settings = settings
        width = settings.width
        self.encoder = Encoder(width, settings.layers)
        self.first, self.second = Affinity(width), Affinity(width)
        self.cross = nn.Linear(2 * width, width)
        self.within = NeighbourAttention(width)

    def encode(self, graph: GraphTensors) -> Embedded:
        """Encodes a graph on its own."""
        return embedded(self.encoder, graph)

    def forward(self, s: Embedded, a: Embedded, pairs: list[PairRows]) -> Output:
        """Matches every pair of a batch; each has at least one wall on both sides."""
        ours, theirs = Side.both(s, a, pairs)
        told_s, told_a = [], []
        for of_s, of_a in zip(ours.parts(ours.nodes), theirs.parts(theirs.nodes), strict=True):
            for k in (0, 1):
                share = self.first(of_s[k], of_a[k], k == 1)[:, :-1].exp()
                told_s.append(self.cross(torch.cat((of_s[k], share @ of_a[k]), dim=1)))
                told_a.append(self.cross(torch.cat((of_a[k], share.T @ of_s[k]), dim=1)))
        in_s = self.within(torch.cat(told_s), ours.edge, ours.neighbour)
        in_a = self.within(torch.cat(told_a), theirs.edge, theirs.neighbour)
        both = list(zip(ours.parts(in_s), theirs.parts(in_a), strict=True))
        walls, rooms = ([self.second(x[k], y[k], k == 1) for x, y in both] for k in (0, 1))
        return output_of(walls, rooms)

    def to_dict(self) -> dict[str, int]:
        """Returns the settings as stored with the weights."""
        return asdict(self.settings)
