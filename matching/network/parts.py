"""Common parts of the baseline networks: paired graphs, Sinkhorn with a dustbin, their output."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from matching.network.dimensions import NOTHING
from matching.network.encoder import Encoder, GraphTensors
from matching.network.features import PairRows
from matching.network.network import Output

ITERATIONS = 20  # of Sinkhorn
Rows = tuple[int, int]


@dataclass(frozen=True)
class Embedded:
    """A graph's nodes (V, width) and edges (V, neighbours, width) before the other graph is used."""

    graph: GraphTensors
    nodes: Tensor
    edge: Tensor


@dataclass(frozen=True)
class Side:
    """One graph of each of P pairs, concatenated; a plan used in several pairs is repeated.

    Each pair has its walls first, then its rooms: `whole` is where it begins and ends, `walls` the number of its walls.
    """

    nodes: Tensor
    neighbour: Tensor
    edge: Tensor
    whole: tuple[slice, ...]
    walls: tuple[int, ...]

    @staticmethod
    def of(e: Embedded, walls: Sequence[Rows], rooms: Sequence[Rows]) -> "Side":
        """Concatenates the rows of walls and rooms of each pair."""
        g, first, index, neighbour, whole = e.graph, 0, [], [], []
        for w, r in zip(walls, rooms, strict=True):
            own = torch.cat((g.wall_node[slice(*w)], g.room_node[slice(*r)]))
            near = g.neighbour[own]
            moved = g.numbers(own)[near.clamp(min=0)] + first
            neighbour.append(torch.where(near >= 0, moved, -1))
            index.append(own)
            whole.append(slice(first, first + len(own)))
            first += len(own)
        every = torch.cat(index)
        counts = tuple(end - begin for begin, end in walls)
        return Side(e.nodes[every], torch.cat(neighbour), e.edge[every], tuple(whole), counts)

    @staticmethod
    def both(s: Embedded, a: Embedded, pairs: Sequence[PairRows]) -> tuple["Side", "Side"]:
        """Returns both sides of a batch."""
        return (
            Side.of(s, [p.s_walls for p in pairs], [p.s_rooms for p in pairs]),
            Side.of(a, [p.a_walls for p in pairs], [p.a_rooms for p in pairs]),
        )

    def parts(self, nodes: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Splits nodes into the walls' and the rooms' rows of each pair."""
        return [(nodes[w][:n], nodes[w][n:]) for w, n in zip(self.whole, self.walls, strict=True)]


def embedded(encoder: Encoder, graph: GraphTensors) -> Embedded:
    """All layers of the encoder, without its last norm."""
    h, edge = encoder.node(graph.node), encoder.edge(graph.edge)
    for layer in encoder.layers:
        h = layer(h, edge, graph.neighbour)
    return Embedded(graph, h, edge)


def sinkhorn(score: Tensor, dustbin: Tensor) -> Tensor:
    """(n, m + 1) logarithms of a soft assignment of n rows to m columns or a dustbin, from scores (n, m); rows sum to
    1.

    Columns sum to 1 with a dustbin row. P.-E. Sarlin et al.: SuperGlue. CVPR 2020, section 3.2.
    """
    n, m = score.shape
    if not n or not m:
        return score.new_zeros(n, m + 1)
    whole = torch.cat((score, dustbin.expand(n, 1)), dim=1)
    whole = torch.cat((whole, dustbin.expand(1, m + 1)), dim=0)
    rows, columns = score.new_zeros(n + 1), score.new_zeros(m + 1)
    rows[-1], columns[-1] = torch.log(torch.tensor(float(m))), torch.log(torch.tensor(float(n)))
    u, v = torch.zeros_like(rows), torch.zeros_like(columns)
    for _ in range(ITERATIONS):
        v = columns - torch.logsumexp(whole + u[:, None], dim=0)
        u = rows - torch.logsumexp(whole + v[None, :], dim=1)
    return (whole + u[:, None] + v[None, :])[:n]


def output_of(walls: Sequence[Tensor], rooms: Sequence[Tensor]) -> Output:
    """Converts tables (n, m + 1) of each pair, whose last column is no match, to an output."""
    dense = _below(walls)
    column = torch.arange(dense.shape[1] - 1, device=dense.device).expand(len(dense), -1)
    return Output(dense, [(torch.where(dense[:, :-1] > NOTHING / 2, column, -1), dense)], [_below(rooms)])


def _below(tables: Sequence[Tensor]) -> Tensor:
    wide = max(t.shape[1] for t in tables) - 1
    padded = [nn.functional.pad(t[:, :-1], (0, wide + 1 - t.shape[1]), value=NOTHING) for t in tables]
    return torch.cat((torch.cat(padded), torch.cat([t[:, -1:] for t in tables])), dim=1)
