"""Consensus between candidates: a pair (i, a) is likely if the neighbours of i find partners near a.

Message passing over candidate pairs, in the spirit of M. Fey et al.: Deep Graph Matching Consensus, ICLR 2020, with the
relative geometry of the pairs instead of node colours. Support is local: i and j are neighbours in the map, and the
pose of b relative to a is compared with that of j relative to i. So the map may deform from room to room.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from matching.network.candidates import Candidates
from matching.network.dimensions import (
    COMPARED_SIZE,
    COMPATIBLE_WIDTHS,
    LEAST_COS,
    NOTHING,
    OFFSET_M,
    PAIR_SIZE,
    REASONS,
)
from matching.network.encoder import GraphTensors
from matching.network.relations import compared, wall_neighbours
from matching.network.support_loops import WallRows, combinations

CHUNK = 1 << 21  # combinations looked through at once


@dataclass(frozen=True)
class Support:
    """E combinations of a candidate (i, a) with a candidate (j, b) of a neighbour; geometry alone."""

    pair: Tensor  # (E,) i * K + the place of a
    other: Tensor  # (E,) j * K + the place of b
    feature: Tensor  # (E, COMPARED_SIZE)


def support(s: GraphTensors, a: GraphTensors, candidates: Candidates) -> Support:
    """Returns all combinations that are roughly alike: on one storey, with similar angles and offsets."""
    near = wall_neighbours(s)
    n, k = candidates.row.shape
    if near.device.type == "cpu":
        found = combinations(wall_rows(s), wall_rows(a), candidates.row.numpy())
        return Support(*map(torch.from_numpy, found))
    rows = max(1, CHUNK // max(1, near.shape[1] * k * k))
    parts = [_support(s, a, candidates.row, near, i, min(i + rows, n)) for i in range(0, n, rows)]
    return Support(*(torch.cat(column) for column in zip(*parts, strict=True)))


def wall_rows(g: GraphTensors) -> WallRows:
    """The walls of a graph on the CPU."""
    rows = (g.pose[g.wall_node], g.half[g.wall_node], g.home[g.wall_node], g.floor[g.wall_node], wall_neighbours(g))
    return WallRows(*(x.contiguous().numpy() for x in rows))


def _support(
    s: GraphTensors, a: GraphTensors, candidate: Tensor, near: Tensor, first: int, last: int
) -> tuple[Tensor, Tensor, Tensor]:
    k = candidate.shape[1]
    node = a.wall_node[candidate.clamp(min=0)]  # (N, K)
    j = near[first:last].clamp(min=0)  # (n, J)
    n, wide = j.shape
    pose_s, pose_a = s.pose[s.wall_node], a.pose[node]
    turned = _turned(pose_s, pose_a)
    real = (torch.bmm(turned[first:last], turned[j].flatten(1, 2).mT) > LEAST_COS).view(n, k, wide, k)
    real &= (candidate[first:last] >= 0)[:, :, None, None]
    real &= ((candidate >= 0)[j] & (near[first:last] >= 0)[..., None])[:, None]
    if a.many_floors:
        real &= a.floor[node[first:last]][:, :, None, None] == a.floor[node[j]][:, None]
    far = (pose_s[j, :2] - pose_s[first:last, None, :2]).norm(dim=-1)[:, None, :, None]
    x, y = (pose_a[j][:, None, ..., d] - pose_a[first:last, :, d][:, :, None, None] for d in (0, 1))
    square = x * x + y * y
    real &= (square < (far + OFFSET_M) ** 2) & (square > (far - OFFSET_M).clamp(min=0) ** 2)
    flat = real.flatten().nonzero()[:, 0]
    bt, at = flat % k, flat // (wide * k) % k
    row_i = flat // (wide * k * k)
    row_j, row_i = j.flatten()[row_i * wide + flat // k % wide], row_i + first
    pair, other = row_i * k + at, row_j * k + bt
    nodes = node.flatten()
    kept, feature = compared(s, a, (s.wall_node[row_i], s.wall_node[row_j]), (nodes[pair], nodes[other]))
    return pair[kept], other[kept], feature


def _turned(pose_s: Tensor, pose_a: Tensor) -> Tensor:
    """(N, K, 2) cosine and sine of the angle from each wall to its candidates."""
    (c, s), (u, v) = pose_s[:, None, 2:].unbind(-1), pose_a[..., 2:].unbind(-1)
    return torch.stack((c * u + s * v, c * v - s * u), dim=-1)


class Consensus(nn.Module):
    """Rounds of message passing between candidates with shared weights; rooms and walls update each other."""

    def __init__(self, width: int) -> None:
        super().__init__()
        first, second = COMPATIBLE_WIDTHS
        self.compatible = nn.Sequential(
            nn.Linear(COMPARED_SIZE, first), nn.GELU(), nn.Linear(first, second), nn.GELU(), nn.Linear(second, REASONS)
        )
        self.begin = nn.Linear(PAIR_SIZE, width)
        self.message = nn.Linear(width, REASONS)
        self.step = nn.Sequential(
            nn.Linear(width + 2 * REASONS + PAIR_SIZE, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )
        self.after = nn.LayerNorm(width)
        self.score = nn.Linear(width, 1)

    def initial_state(self, feature: Tensor) -> Tensor:
        """(N K, width) states of the candidates from their features (N K, PAIR_SIZE)."""
        return torch.as_tensor(self.begin(feature))

    def weights(self, support: Support) -> Tensor:
        """(E, heads) weights in [0, 1] of each combination, from its geometry."""
        return torch.as_tensor(torch.sigmoid(self.compatible(support.feature) - 1))

    def round(self, state: Tensor, feature: Tensor, likely: Tensor, support: Support, weight: Tensor) -> Tensor:
        """(N K, width) states after one round, from the states, the features (N K, PAIR_SIZE) and probabilities (N
        K,).
        """
        message = torch.cat((torch.ones_like(state[:, : weight.shape[1]]), torch.tanh(self.message(state))), dim=-1)
        sent = (likely[:, None] * message)[support.other] * weight.repeat(1, 2)
        received = torch.zeros_like(message).index_add(0, support.pair, sent)
        return self.after(state + self.step(torch.cat((state, received, feature), dim=-1)))

    def logits(self, state: Tensor, candidates: Candidates) -> Tensor:
        """(N, K + 1) log odds of the candidates and of no match."""
        n, k = candidates.row.shape
        logit = candidates.logit + 5 * self.score(state).view(n, k)
        logit = logit.masked_fill(candidates.row < 0, NOTHING)
        return torch.cat((logit, candidates.dustbin[:, None]), dim=-1)
