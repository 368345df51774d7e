"""Compares the relative pose of two walls of one graph with that of two walls of the other."""

from dataclasses import dataclass

import torch
from torch import Tensor

from matching.network.dimensions import CLOSE_M, LEAST_COS, LEFT_M, SCALES_M, SUPPORTERS
from matching.network.encoder import GraphTensors

Nodes = tuple[Tensor, Tensor]  # (E,) and (E,) nodes of one graph


def wall_neighbours(g: GraphTensors) -> Tensor:
    """(N, SUPPORTERS) the nearest walls of each wall, as rows of `wall_node`; -1 where there are fewer."""
    nodes = g.neighbour[g.wall_node, :SUPPORTERS]
    rows = g.numbers(g.wall_node)[nodes.clamp(min=0)]
    return torch.where(nodes >= 0, rows, -1)


@dataclass(frozen=True)
class Relation:
    """Relative poses of E wall nodes j and i, all (E,): across and along i, across and along j, angle of j minus
    that of i.
    """

    across: Tensor
    along: Tensor
    across_j: Tensor
    along_j: Tensor
    cos: Tensor
    sin: Tensor

    @staticmethod
    def of(g: GraphTensors, nodes: Nodes) -> "Relation":
        """Of the nodes of one graph."""
        (x, y, ci, si), (u, v, cj, sj) = (g.pose[n].unbind(-1) for n in nodes)
        x, y = u - x, v - y
        return Relation(
            x * ci + y * si, y * ci - x * si, -(x * cj + y * sj), x * sj - y * cj, ci * cj + si * sj, ci * sj - si * cj
        )

    def __getitem__(self, kept: Tensor) -> "Relation":
        return Relation(*(x[kept] for x in vars(self).values()))

    def offsets(self) -> Tensor:
        """(4, E)."""
        return torch.stack((self.across, self.along, self.across_j, self.along_j))


@dataclass(frozen=True)
class _Both:
    """Two relations: the differences of their offsets, what is `left` of them, and cosine and sine of the angle between
    them.

    A wall's mid point slides by half its error in length, so offsets may differ that much.
    """

    of_s: Relation
    off: Tensor  # (4, E)
    left: Tensor  # (4, E)
    slide: Tensor  # (2, E) of walls i and j
    cos: Tensor
    sin: Tensor

    @staticmethod
    def of(s: GraphTensors, a: GraphTensors, in_s: Nodes, in_a: Nodes) -> "_Both":
        """Of pairs of nodes of either graph."""
        of_s, of_a = Relation.of(s, in_s), Relation.of(a, in_a)
        off = (of_s.offsets() - of_a.offsets()).abs()
        one, other = ((s.half[i] - a.half[p]).abs() for i, p in zip(in_s, in_a, strict=True))
        cos, sin = of_s.cos.abs(), of_s.sin.abs()
        slack = torch.stack((other * sin, one + other * cos, one * sin, other + one * cos))
        return _Both(
            of_s, off, (off - slack).clamp(min=0), torch.stack((one, other)),
            of_s.cos * of_a.cos + of_s.sin * of_a.sin, of_s.sin * of_a.cos - of_s.cos * of_a.sin,
        )  # fmt: skip

    def __getitem__(self, kept: Tensor) -> "_Both":
        return _Both(
            self.of_s[kept], self.off[:, kept], self.left[:, kept], self.slide[:, kept], self.cos[kept], self.sin[kept]
        )


def compared(s: GraphTensors, a: GraphTensors, in_s: Nodes, in_a: Nodes) -> tuple[Tensor, Tensor]:
    """Returns which of E pairs of walls are roughly alike, (F,), and (F, COMPARED_SIZE) features of how alike."""
    both = _Both.of(s, a, in_s, in_a)
    kept = ((both.cos > LEAST_COS) & (both.left.amax(dim=0) < LEFT_M)).nonzero()[:, 0]
    in_s, in_a = (in_s[0][kept], in_s[1][kept]), (in_a[0][kept], in_a[1][kept])
    return kept, _columns(s, a, in_s, in_a, both[kept])


def _columns(s: GraphTensors, a: GraphTensors, in_s: Nodes, in_a: Nodes, both: _Both) -> Tensor:
    (i, j), (p, q) = in_s, in_a
    scales = torch.tensor(SCALES_M, device=i.device)[:, None]
    near = torch.exp(-((torch.cat((both.left, both.off[::2]))[:, None] / scales) ** 2)).flatten(0, 1)
    cos = both.of_s.cos
    far = torch.hypot(both.of_s.across, both.of_s.along)
    # The first column is ten times the sine of half the angle.
    columns = [10 * both.sin.abs() / (2 + 2 * both.cos).sqrt(), cos.abs(), (cos < -0.9).float()]
    columns += [torch.exp(-far / 2), far / 8]
    home_i, home_j, home_p = s.home[i], s.home[j], a.home[p]
    same_s, same_a = home_i == home_j, (home_p == a.home[q]) & (home_p >= 0)
    with_room = (home_i >= 0) & (home_j >= 0)
    columns += [(same_s & with_room).float(), (same_s == same_a).float() * with_room]
    columns += [(p == q).float(), both.slide.sum(dim=0)]
    return torch.cat((near, torch.stack(columns))).T


def close(s: GraphTensors, a: GraphTensors, in_s: Nodes, in_a: Nodes) -> Tensor:
    """(E,) similarity of two pairs of walls in [0, 1], from offsets and angle alone."""
    both = _Both.of(s, a, in_s, in_a)
    off = both.left.square().sum(dim=0) / CLOSE_M**2
    return torch.exp(-0.5 * off) * (both.cos > LEAST_COS)
