"""How two walls of one graph lie to each other, compared with two walls of the other graph."""

import torch
from torch import Tensor

from matching.encoder import GraphTensors

HEARD = 10  # neighbours of a wall that have a say
OFFSET_M = 2.5  # pairs whose distance differs by more are not looked at,
LEFT_M = 1.2  # nor those whose offsets differ by more where walls may slide
LEAST_COS = 0.9  # of the angle by which two pairs differ
SCALES_M = (0.12, 0.35, 1.0)
COMPARED_SIZE = 4 * len(SCALES_M) + 2 * len(SCALES_M) + 9
CLOSE_M = 0.5
Nodes = tuple[Tensor, Tensor]  # (E,) and (E,) nodes of one graph


def wall_neighbours(g: GraphTensors) -> Tensor:
    """(N, HEARD) the nearest walls of each wall, as rows of `wall_node`; -1 where there are fewer."""
    nodes = g.neighbour[g.wall_node, :HEARD]
    rows = g.numbers(g.wall_node)[nodes.clamp(min=0)]
    return torch.where(nodes >= 0, rows, -1)


def relation(g: GraphTensors, nodes: Nodes) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """How wall nodes j lie to wall nodes i: across and along i, across and along j, angle from normal to normal."""
    i, j = nodes
    x, y = (g.centre[j] - g.centre[i]).unbind(-1)
    hi, hj = g.heading[i], g.heading[j]
    ci, si, cj, sj = hi.cos(), hi.sin(), hj.cos(), hj.sin()
    return x * ci + y * si, y * ci - x * si, -(x * cj + y * sj), -(y * cj - x * sj), hj - hi


def _left(s: GraphTensors, a: GraphTensors, in_s: Nodes, in_a: Nodes) -> tuple[list[Tensor], list[Tensor], Tensor]:
    """By how much the offsets differ (4), what is left of it (4), and the angle by which the pairs differ.

    The mid point of a wall slides along it by half of what its length is off: offsets are let off that much.
    """
    (i, j), (p, q) = in_s, in_a
    of_s, of_a = relation(s, in_s), relation(a, in_a)
    off = [(x - y).abs() for x, y in zip(of_s[:4], of_a[:4], strict=True)]
    slide_i, slide_j = (s.half[i] - a.half[p]).abs(), (s.half[j] - a.half[q]).abs()
    cos, sin = of_s[4].cos().abs(), of_s[4].sin().abs()
    slack = [slide_j * sin, slide_i + slide_j * cos, slide_i * sin, slide_j + slide_i * cos]
    return off, [(d - z).clamp(min=0) for d, z in zip(off, slack, strict=True)], of_s[4] - of_a[4]


def compared(s: GraphTensors, a: GraphTensors, in_s: Nodes, in_a: Nodes) -> tuple[Tensor, Tensor]:
    """Which of E pairs of walls are alike at all, (F,) of them; and (F, COMPARED_SIZE) how alike, seen in all ways."""
    _, left, turn = _left(s, a, in_s, in_a)
    kept = ((turn.cos() > LEAST_COS) & (torch.stack(left).amax(dim=0) < LEFT_M)).nonzero()[:, 0]
    in_s, in_a = (in_s[0][kept], in_s[1][kept]), (in_a[0][kept], in_a[1][kept])
    return kept, _columns(s, a, in_s, in_a)


def _columns(s: GraphTensors, a: GraphTensors, in_s: Nodes, in_a: Nodes) -> Tensor:
    (i, j), (p, q) = in_s, in_a
    off, left, turn = _left(s, a, in_s, in_a)
    across, along, _, _, angle = relation(s, in_s)
    columns = [torch.exp(-((d / scale) ** 2)) for d in left for scale in SCALES_M]
    columns += [torch.exp(-((off[d] / scale) ** 2)) for d in (0, 2) for scale in SCALES_M]
    far = torch.hypot(across, along)
    columns += [10 * torch.sin(turn / 2).abs(), angle.cos().abs(), (angle.cos() < -0.9).float()]
    columns += [torch.exp(-far / 2), far / 8]
    same_s, same_a = s.home[i] == s.home[j], (a.home[p] == a.home[q]) & (a.home[p] >= 0)
    housed = (s.home[i] >= 0) & (s.home[j] >= 0)
    slide = (s.half[i] - a.half[p]).abs() + (s.half[j] - a.half[q]).abs()
    columns += [(same_s & housed).float(), (same_s == same_a).float() * housed, (p == q).float(), slide]
    return torch.stack(columns, dim=-1)


def close(s: GraphTensors, a: GraphTensors, in_s: Nodes, in_a: Nodes) -> Tensor:
    """(E,) how alike two pairs of walls are, in [0, 1], by the offsets and the angle alone."""
    _, left, turn = _left(s, a, in_s, in_a)
    off = torch.stack(left).square().sum(dim=0) / CLOSE_M**2
    return torch.exp(-0.5 * off) * (turn.cos() > LEAST_COS)
