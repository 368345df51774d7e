"""Candidates agree with each other: a pair (i, a) is likely where the neighbours of i find partners near a.

Message passing over candidate pairs, in the spirit of M. Fey et al.: Deep Graph Matching Consensus, ICLR 2020,
with the geometry of the pairs in the place of node colours. Support is local: i and j are neighbours in the map,
and how a lies to b is compared with how i lies to j. So a map may bend from room to room.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from matching.encoder import GraphTensors

HEARD = 10  # neighbours of a wall that have a say
ANGLE_RAD, OFFSET_M = 0.45, 2.5  # support further off is not looked at
SCALES_M = (0.12, 0.35, 1.0)
SUPPORT_SIZE = 4 * len(SCALES_M) + 2 * len(SCALES_M) + 9
PAIR_SIZE = 7
CHUNK = 1 << 21  # combinations looked through at once


@dataclass(frozen=True)
class Candidates:
    """K candidates of each of N S walls: rows of A's walls, -1 where there are fewer, and what speaks for them."""

    partner: Tensor  # (N, K) rows of A's `wall_node`
    logit: Tensor  # (N, K) of the descriptors, -1e4 where there is none
    dustbin: Tensor  # (N,)


@dataclass(frozen=True)
class Support:
    """E combinations of a candidate (i, a) and a candidate (j, b) of a neighbour, geometry alone."""

    pair: Tensor  # (E,) i * K + the place of a
    other: Tensor  # (E,) j * K + the place of b
    feature: Tensor  # (E, SUPPORT_SIZE)


def wall_neighbours(g: GraphTensors) -> Tensor:
    """(N, HEARD) the nearest walls of each wall, as rows of `wall_node`; -1 where there are fewer."""
    nodes = g.neighbour[g.wall_node, :HEARD]
    rows = g.numbers(g.wall_node)[nodes.clamp(min=0)]
    return torch.where(nodes >= 0, rows, -1)


def _relation(g: GraphTensors, i: Tensor, j: Tensor) -> tuple[Tensor, ...]:
    """How wall nodes j lie to wall nodes i: across and along i, across and along j, angle of the normals."""
    away = g.centre[j] - g.centre[i]
    x, y = away.unbind(-1)
    hi, hj = g.heading[i], g.heading[j]
    ci, si, cj, sj = hi.cos(), hi.sin(), hj.cos(), hj.sin()
    return x * ci + y * si, y * ci - x * si, -(x * cj + y * sj), -(y * cj - x * sj), hj - hi


def support(s: GraphTensors, a: GraphTensors, candidates: Candidates) -> Support:
    """All combinations that are roughly alike: same storey, angle and offsets not far off."""
    near = wall_neighbours(s)
    n, k = candidates.partner.shape
    rows = max(1, CHUNK // max(1, near.shape[1] * k * k))
    parts = [_support(s, a, candidates, near, i, min(i + rows, n)) for i in range(0, n, rows)]
    if not parts:
        nothing = torch.zeros(0, dtype=torch.long)
        return Support(nothing, nothing, torch.zeros(0, SUPPORT_SIZE))
    return Support(*(torch.cat(column) for column in zip(*parts, strict=True)))


def _support(
    s: GraphTensors, a: GraphTensors, candidates: Candidates, near: Tensor, first: int, last: int
) -> tuple[Tensor, Tensor, Tensor]:
    k = candidates.partner.shape[1]
    i = torch.arange(first, last, device=near.device)[:, None]  # (n, 1)
    j = near[first:last]  # (n, J)
    in_s = _relation(s, s.wall_node[i], s.wall_node[j.clamp(min=0)])
    row_a = candidates.partner[first:last, :, None, None]  # (n, K, 1, 1)
    row_b = candidates.partner[j.clamp(min=0)][:, None]  # (n, 1, J, K)
    node_a, node_b = a.wall_node[row_a.clamp(min=0)], a.wall_node[row_b.clamp(min=0)]
    real = (row_a >= 0) & (row_b >= 0) & (j >= 0)[:, None, :, None] & (a.floor[node_a] == a.floor[node_b])
    across = s.heading[s.wall_node[j.clamp(min=0)]] - s.heading[s.wall_node[i]]
    turn = across[:, None, :, None] - (a.heading[node_b] - a.heading[node_a])
    real &= turn.cos() > torch.cos(torch.tensor(ANGLE_RAD))
    away = a.centre[node_b] - a.centre[node_a]
    apart = away.norm(dim=-1) - (in_s[0] ** 2 + in_s[1] ** 2).sqrt()[:, None, :, None]
    real &= apart.abs() < OFFSET_M
    n, at, m, bt = real.nonzero(as_tuple=True)
    i_row, j_row = n + first, j[n, m]
    a_row, b_row = candidates.partner[i_row, at], candidates.partner[j_row, bt]
    nodes = s.wall_node[i_row], s.wall_node[j_row], a.wall_node[a_row], a.wall_node[b_row]
    feature, alike = _compared(s, a, *nodes)
    return (i_row * k + at)[alike], (j_row * k + bt)[alike], feature[alike]


def _compared(
    s: GraphTensors, a: GraphTensors, i: Tensor, j: Tensor, p: Tensor, q: Tensor
) -> tuple[Tensor, Tensor]:
    """(E, SUPPORT_SIZE) and whether they are alike: how j lies to i against how q lies to p.

    The mid point of a wall slides along it by half of what its length is off; offsets are let off that much.
    """
    in_s, in_a = _relation(s, i, j), _relation(a, p, q)
    off = [(x - y).abs() for x, y in zip(in_s[:4], in_a[:4], strict=True)]
    slide_i, slide_j = (s.half[i] - a.half[p]).abs(), (s.half[j] - a.half[q]).abs()
    cos, sin = in_s[4].cos().abs(), in_s[4].sin().abs()
    slack = [slide_j * sin, slide_i + slide_j * cos, slide_i * sin, slide_j + slide_i * cos]
    left = [(d - z).clamp(min=0) for d, z in zip(off, slack, strict=True)]
    turn = in_s[4] - in_a[4]
    columns = [torch.exp(-((d / scale) ** 2)) for d in left for scale in SCALES_M]
    columns += [torch.exp(-((off[d] / scale) ** 2)) for d in (0, 2) for scale in SCALES_M]
    far = (in_s[0] ** 2 + in_s[1] ** 2).sqrt()
    columns += [10 * torch.sin(turn / 2).abs(), cos, (in_s[4].cos() < -0.9).float(), torch.exp(-far / 2), far / 8]
    same_s, same_a = (g.home[x] == g.home[y] for g, x, y in ((s, i, j), (a, p, q)))
    housed = (s.home[i] >= 0) & (s.home[j] >= 0)
    columns += [(same_s & housed).float(), (same_s == same_a).float() * housed, (p == q).float(), slide_i + slide_j]
    alike = (turn.cos() > 0.9) & (left[0] < OFFSET_M) & (left[1] < OFFSET_M)
    return torch.stack(columns, dim=-1), alike


class Consensus(nn.Module):
    """Rounds of support between candidates, the same step each time; rooms are told and ask back."""

    def __init__(self, width: int = 32, heads: int = 12) -> None:
        super().__init__()
        self.compatible = nn.Sequential(
            nn.Linear(SUPPORT_SIZE, 32), nn.GELU(), nn.Linear(32, 24), nn.GELU(), nn.Linear(24, heads)
        )
        self.begin = nn.Linear(PAIR_SIZE, width)
        self.says = nn.Linear(width, heads)
        self.step = nn.Sequential(
            nn.Linear(width + 2 * heads + PAIR_SIZE, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )
        self.after = nn.LayerNorm(width)
        self.judge = nn.Linear(width, 1)

    def begun(self, feature: Tensor) -> Tensor:
        """(N K, width) state of the candidates from what is known of them, (N K, PAIR_SIZE)."""
        return torch.as_tensor(self.begin(feature))

    def weights(self, support: Support) -> Tensor:
        """(E, heads) how far the geometry of each combination is a reason, in [0, 1]."""
        return torch.as_tensor(torch.sigmoid(self.compatible(support.feature) - 1))

    def round(self, state: Tensor, feature: Tensor, likely: Tensor, support: Support, weight: Tensor) -> Tensor:
        """State after one round: (N K, width) from itself, (N K, PAIR_SIZE), and probabilities (N K,)."""
        says = torch.cat((torch.ones_like(state[:, : weight.shape[1]]), torch.tanh(self.says(state))), dim=-1)
        told = (likely[:, None] * says)[support.other] * weight.repeat(1, 2)
        heard = torch.zeros_like(says).index_add(0, support.pair, told)
        return self.after(state + self.step(torch.cat((state, heard, feature), dim=-1)))

    def logits(self, state: Tensor, candidates: Candidates) -> Tensor:
        """(N, K + 1) log odds of the candidates, then of none."""
        n, k = candidates.partner.shape
        judged = candidates.logit + 5 * self.judge(state).view(n, k)
        judged = judged.masked_fill(candidates.partner < 0, -1e4)
        return torch.cat((judged, candidates.dustbin[:, None]), dim=-1)
