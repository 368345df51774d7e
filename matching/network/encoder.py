"""Encodes a graph's nodes as vectors by attention over neighbours with edge features (GATv2).

S. Brody, U. Alon, E. Yahav: How Attentive are Graph Attention Networks? ICLR 2022. Neighbours are a table of fixed
width, so a layer is a gather and a softmax.
"""

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor, nn

from matching.network.dimensions import HEADS
from matching.network.features import EDGE_SIZE, NODE_SIZE, GraphFeatures


@dataclass(frozen=True)
class GraphTensors:
    """`GraphFeatures` on a device; shapes as there."""

    wall_node: Tensor
    room_node: Tensor
    centre: Tensor
    heading: Tensor
    half: Tensor
    home: Tensor
    floor: Tensor
    node: Tensor
    neighbour: Tensor
    edge: Tensor

    @staticmethod
    def of(f: GraphFeatures, device: torch.device | str = "cpu") -> "GraphTensors":
        """Converts the arrays of one graph, or of a batch joined into one."""
        names = GraphTensors.__dataclass_fields__
        return GraphTensors(**{name: torch.as_tensor(getattr(f, name)).to(device) for name in names})

    @cached_property
    def pose(self) -> Tensor:
        """(V, 4) centre, and cosine and sine of the heading."""
        return torch.stack((*self.centre.unbind(-1), self.heading.cos(), self.heading.sin()), dim=-1)

    @cached_property
    def many_floors(self) -> bool:
        """Whether there is more than one storey."""
        return bool(len(self.floor) and (self.floor != self.floor[0]).any())

    def numbers(self, nodes: Tensor) -> Tensor:
        """(V,) the position of each node in `nodes`, -1 for others."""
        table = torch.full((len(self.node),), -1, dtype=torch.long, device=nodes.device)
        table[nodes] = torch.arange(len(nodes), device=nodes.device)
        return table


class NeighbourAttention(nn.Module):
    """One layer: attention over the neighbours, then a feed-forward network, both with residual connections."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.before = nn.LayerNorm(width)
        self.query = nn.Linear(width, width)
        self.key = nn.Linear(width, width, bias=False)
        self.edge = nn.Linear(width, width, bias=False)
        self.attention = nn.Parameter(torch.empty(HEADS, width // HEADS))
        if not self.attention.is_meta:  # drawing there makes torch load its compiler, which takes a second
            nn.init.normal_(self.attention, std=(width // HEADS) ** -0.5)
        self.out = nn.Linear(width, width)
        self.ffn = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )

    def forward(self, h: Tensor, edge: Tensor, neighbour: Tensor) -> Tensor:
        """Maps nodes (V, width), edges (V, k, width) and neighbours (V, k), -1 for none, to (V, width)."""
        x = self.before(h)
        seen = nn.functional.silu(self.key(x)[neighbour.clamp(min=0)] + self.edge(edge) + self.query(x)[:, None])
        split = seen.unflatten(-1, (HEADS, -1))  # (V, k, heads, width / heads)
        score = (split * self.attention).sum(-1)
        score = score.masked_fill((neighbour < 0)[..., None], -1e4).softmax(dim=1)
        score = score * (neighbour >= 0)[..., None]  # a node without neighbours gets no message
        h = h + self.out((score[..., None] * split).sum(dim=1).flatten(1))
        return torch.as_tensor(h + self.ffn(h))


class Encoder(nn.Module):
    """Encodes all nodes of a graph independently of the other graph, so that a plan's vectors can be cached."""

    def __init__(self, width: int, layers: int) -> None:
        super().__init__()
        self.node = nn.Sequential(nn.Linear(NODE_SIZE, width), nn.GELU(), nn.Linear(width, width))
        self.edge = nn.Sequential(nn.Linear(EDGE_SIZE, width), nn.GELU(), nn.Linear(width, width), nn.GELU())
        self.layers = nn.ModuleList(NeighbourAttention(width) for _ in range(layers))
        self.after = nn.LayerNorm(width)

    def forward(self, g: GraphTensors) -> Tensor:
        """Returns (V, width)."""
        h, edge = self.node(g.node), self.edge(g.edge)
        for layer in self.layers:
            h = layer(h, edge, g.neighbour)
        return torch.as_tensor(self.after(h))
