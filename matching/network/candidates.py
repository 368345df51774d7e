"""Selects a few candidate A walls for each S wall: by their vectors, then by where its neighbours seem to be."""

from dataclasses import dataclass

import torch
from torch import Tensor

from matching.network.dimensions import LEAST_LIKELY, NOTHING, TRUST, VOTES_EACH
from matching.network.encoder import GraphTensors
from matching.network.features import PairRows
from matching.network.relations import close, wall_neighbours


@dataclass(frozen=True)
class Batched:
    """The pair that each of a batch's N S walls belongs to. Columns count A's walls or rooms from the pair's first."""

    rows: tuple[tuple[int, int], ...]  # of the S walls of each pair: first, last + 1
    pair: Tensor  # (N,) the pair's number
    first_wall: Tensor  # (N,) the row of the pair's first A wall
    s_home: Tensor  # (N,) the row of the wall's room, -1 where not known
    a_room: Tensor  # (A walls,) the column of the wall's room, -1 where not known

    @staticmethod
    def of(s: GraphTensors, a: GraphTensors, pairs: list[PairRows]) -> "Batched":
        """Describes graphs joined from those of the pairs."""
        device = s.node.device
        counts = torch.tensor([p.s_walls[1] - p.s_walls[0] for p in pairs], device=device)
        first = torch.tensor([p.a_walls[0] for p in pairs], device=device)
        room, first_room = homes(a), torch.zeros_like(a.wall_node)
        for p in pairs:
            first_room[slice(*p.a_walls)] = p.a_rooms[0]
        room = torch.where(room >= 0, room - first_room, -1)
        numbers = torch.arange(len(pairs), device=device)
        rows = tuple(p.s_walls for p in pairs)
        return Batched(rows, numbers.repeat_interleave(counts), first.repeat_interleave(counts), homes(s), room)


@dataclass(frozen=True)
class Candidates:
    """K candidates of each of N S walls; -1 where there are fewer."""

    column: Tensor  # (N, K) A walls, counted from the pair's first
    row: Tensor  # (N, K) the same as rows of A's `wall_node`
    room: Tensor  # (N, K) their rooms, counted from the pair's first
    logit: Tensor  # (N, K) by the vectors, NOTHING where there is none
    dustbin: Tensor  # (N,) the odds of none
    likely: Tensor  # (N, K) what they begin with


def homes(g: GraphTensors) -> Tensor:
    """(N,) the row of each wall's room among the rooms, -1 if unknown."""
    home = g.home[g.wall_node]
    return torch.where(home >= 0, g.numbers(g.room_node)[home.clamp(min=0)], -1)


def first_candidates(dense: Tensor, batched: Batched, most: int) -> Candidates:
    """Returns the likeliest candidates by `dense` (N, most A walls + 1), whose last column is no match."""
    value, column = dense[:, :-1].detach().topk(min(most, dense.shape[1] - 1), dim=1)
    column = torch.where(value > NOTHING / 2, column, -1)
    logit = torch.cat((_logits(dense, column), dense[:, -1:]), dim=-1)
    return _candidates(dense, batched, column, logit.softmax(dim=-1)[:, :-1])


def expanded(
    s: GraphTensors, a: GraphTensors, batched: Batched, dense: Tensor, known: Candidates, likely: Tensor, more: int
) -> Candidates:
    """Returns the known candidates and up to `more` near the likely partners of each wall's neighbours.

    If j is matched to b, i is expected among the walls near b, at the same relative pose. All neighbours j of i vote.
    """
    voter, wall, strength = _votes(s, a, known, likely.detach())
    wide = dense.shape[1]
    key = voter * wide + wall - batched.first_wall[voter]
    has = (known.column >= 0).nonzero(as_tuple=True)
    known_key = has[0] * wide + known.column[has]
    fresh = ~torch.isin(key, known_key)
    key, strength = key[fresh], strength[fresh]
    unique, at = key.unique(return_inverse=True)
    total = torch.zeros(len(unique), device=dense.device).index_add(0, at, strength)
    order = total.argsort(descending=True, stable=True)
    order = order[(unique[order] // wide).argsort(stable=True)]
    row, column, total = unique[order] // wide, unique[order] % wide, total[order]
    rank = torch.arange(len(row), device=dense.device) - torch.searchsorted(row, row)
    kept = rank < more
    added = torch.full((len(dense), more), -1, device=dense.device)
    trust = torch.zeros((len(dense), more), device=dense.device)
    added[row[kept], rank[kept]] = column[kept]
    trust[row[kept], rank[kept]] = TRUST * total[kept].clamp(max=1.0)
    begins = torch.cat((likely, trust), dim=-1)
    begins = begins / begins.sum(dim=-1, keepdim=True).clamp(min=1.0)
    return _candidates(dense, batched, torch.cat((known.column, added), dim=-1), begins)


def _votes(s: GraphTensors, a: GraphTensors, known: Candidates, likely: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """(E,) S walls i, A walls near the partners of i's neighbours, and the weight of each vote."""
    near_s, near_a = wall_neighbours(s), wall_neighbours(a)
    near_a = torch.cat((torch.arange(len(near_a), device=near_a.device)[:, None], near_a), dim=-1)  # seen in pieces
    value, at = likely.topk(min(VOTES_EACH, likely.shape[1]), dim=1)
    known_row = known.row.gather(1, at)
    i, m, t = ((near_s >= 0)[..., None] & (value > LEAST_LIKELY)[near_s.clamp(min=0)]).nonzero(as_tuple=True)
    j = near_s[i, m]
    b = known_row[j, t]
    c = near_a[b.clamp(min=0)]  # (E, near)
    e, place = ((c >= 0) & (b >= 0)[:, None]).nonzero(as_tuple=True)
    i, j, b, c, strength = i[e], j[e], b[e], c[e, place], value[j, t][e]
    alike = close(s, a, (s.wall_node[j], s.wall_node[i]), (a.wall_node[b], a.wall_node[c]))
    kept = alike > 0.05
    return i[kept], c[kept], (strength * alike)[kept]


def _logits(dense: Tensor, column: Tensor) -> Tensor:
    return dense.gather(1, column.clamp(min=0)).masked_fill(column < 0, NOTHING)


def _candidates(dense: Tensor, batched: Batched, column: Tensor, likely: Tensor) -> Candidates:
    row = torch.where(column >= 0, column + batched.first_wall[:, None], -1)
    room = torch.where(row >= 0, batched.a_room[row.clamp(min=0)], -1)
    return Candidates(column, row, room, _logits(dense, column), dense[:, -1], likely)
