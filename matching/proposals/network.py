"""The network that proposes, for each wall surface of a map, the few wall surfaces of the plan that it may be.

Three steps:
1. `Encoder`: a vector for each wall and room of a graph on its own, by attention over neighbours (GATv2). A plan's
   vectors can be cached.
2. A few candidates for each map wall, from its vector and that of its room; later also from where its neighbours are.
3. `Consensus`: message passing between candidates. A pair (i, a) is likely if the neighbours of i find partners near a,
   at the same relative pose. Support is local, so the map may deform from room to room; `agreement` of the whole map
   tells apart places that look alike. Walls and rooms update each other.

One map is matched with one plan at a time. Everything is a dense, gather or scatter operation, so that ONNX can express
it; index -1 stands for "none" and reads the last row of a padded table.

S. Brody, U. Alon, E. Yahav: How Attentive are Graph Attention Networks? ICLR 2022.
M. Fey et al.: Deep Graph Matching Consensus. ICLR 2020.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import normalize, pad, silu

from matching.proposals.features import EDGE_SIZE, NODE_SIZE, SUPPORTERS, GraphFeatures

HEADS = 4  # of the encoder's attention
NOTHING = -1e4  # a logit that stands for minus infinity
SHARE_SIZE = 6  # of the features of a map room and a planned room
ROOM_WIDTH = 24  # of the layer that maps them to a logit
LEAST_ODDS = -12.0  # least log probability of rooms in the logits of walls
ROOM_UNKNOWN = -3.0  # log probability used if one of two walls has no room

# Candidates from neighbours.
VOTES_EACH = 2  # candidates of a neighbour that vote for where a wall may be
LEAST_LIKELY = 0.05  # probability of a candidate that votes
LEAST_ALIKE = 0.05  # similarity of relative poses that counts
TRUST = 0.5  # greatest probability that such a candidate starts with
CLOSE_M = 0.5

# Two walls of the map compared with two walls of the plan: a wall and one of its SUPPORTERS nearest.
OFFSET_M = 2.5  # greatest difference in distance
LEFT_M = 1.2  # greatest difference of the offsets that is left where walls may slide
LEAST_COS = 0.9  # of the angle by which the two motions differ
SCALES_M = (0.12, 0.35, 1.0)
COMPATIBLE_WIDTHS, REASONS = (32, 24), 12  # of the layers that map the comparison to weights; number of weights
COMPARED_SIZE = 6 * len(SCALES_M) + 9

# How much of the map agrees with a candidate.
REACHES = ((0.5, 0.03), (1.5, 0.1))  # tolerances: metres, and metres for each metre of distance
VOTERS = 64  # candidates that vote: the likeliest, the largest
LEAST_VOTER_COS = 0.97  # of the angle between two motions that may agree
PAIR_SIZE = 7 + 3  # of a candidate's features: its own, and three of agreement


@dataclass(frozen=True)
class Settings:
    """The size of a network."""

    width: int = 32
    layers: int = 2
    candidates: int = 8  # from the vectors
    more: int = 4  # in each later cycle, from where the neighbours are
    cycles: int = 2
    rounds: int = 2  # of each cycle
    state: int = 16


class Graph(NamedTuple):
    """`GraphFeatures` as tensors; shapes as there."""

    node: Tensor
    neighbour: Tensor
    edge: Tensor
    wall: Tensor
    room: Tensor
    floor: Tensor

    @staticmethod
    def of(f: GraphFeatures, device: torch.device | str = "cpu") -> "Graph":
        """Copies the arrays to a device."""
        return Graph(*(torch.as_tensor(getattr(f, name)).to(device) for name in Graph._fields))


class Encoded(NamedTuple):
    """A graph of N walls and M rooms with their vectors."""

    walls: Tensor  # (N, width) unit vectors
    rooms: Tensor  # (M, width) unit vectors
    no_wall: Tensor  # (N, 1) logits of no match
    no_room: Tensor  # (M, 1)
    wall: Tensor  # (N, 5) centre, normal, half length
    room: Tensor  # (N,)
    floor: Tensor  # (N,)
    near: Tensor  # (N, SUPPORTERS) the nearest walls, -1 where there are fewer

    def padded(self) -> "Encoded":
        """With a wall and a room at the end that stand for none."""
        walls, rooms, no_wall, no_room, wall = (pad(x, (0, 0, 0, 1)) for x in self[:5])
        room, floor = (pad(x, (0, 1), value=-1) for x in (self.room, self.floor))
        return Encoded(walls, rooms, no_wall, no_room, wall, room, floor, pad(self.near, (0, 0, 0, 1), value=-1))


class Output(NamedTuple):
    """Logits for N map walls and M map rooms; columns are A planned walls and B planned rooms.

    The last column of every table is "no match". Tables of walls come with the columns of their K candidates, -1 for
    none; tables of rooms are the first estimate, then one after each round.
    """

    dense: Tensor  # (N, A + 1) from the vectors alone
    walls: list[tuple[Tensor, Tensor]]  # after each round (N, K) candidates, (N, K + 1) logits
    rooms: list[Tensor]  # (M, B + 1)


class Candidates(NamedTuple):
    """K candidates of each of N map walls."""

    column: Tensor  # (N, K) planned walls, -1 where there are fewer
    logit: Tensor  # (N, K) from the vectors, NOTHING where there is none
    likely: Tensor  # (N, K) probabilities to start with


class Support(NamedTuple):
    """E combinations of a candidate (i, a) with a candidate (j, b) of a neighbour j of i, compared by geometry."""

    pair: Tensor  # (E,) i * K + the place of a
    other: Tensor  # (E,) j * K + the place of b
    feature: Tensor  # (E, COMPARED_SIZE)


def added(table: Tensor, row: Tensor, value: Tensor) -> Tensor:
    """The table with each value (E, ...) added to its row (E,)."""
    return table.scatter_add(0, row.view(-1, *[1] * (value.dim() - 1)).expand_as(value), value)


class NeighbourAttention(nn.Module):
    """One layer: attention over the neighbours, then a feed-forward network, both with residual connections."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.before = nn.LayerNorm(width)
        self.query = nn.Linear(width, width)
        self.key = nn.Linear(width, width, bias=False)
        self.edge = nn.Linear(width, width, bias=False)
        self.attention = nn.Parameter(torch.empty(HEADS, width // HEADS))
        nn.init.normal_(self.attention, std=(width // HEADS) ** -0.5)
        self.out = nn.Linear(width, width)
        self.ffn = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )

    def forward(self, h: Tensor, edge: Tensor, neighbour: Tensor) -> Tensor:
        """Maps nodes (V, width), edges (V, k, width) and neighbours (V, k), -1 for none, to (V, width)."""
        x, real = self.before(h), (neighbour >= 0)[..., None]
        seen = silu(self.key(x)[neighbour] + self.edge(edge) + self.query(x)[:, None])
        split = seen.unflatten(-1, (HEADS, -1))  # (V, k, heads, width / heads)
        score = torch.where(real, (split * self.attention).sum(-1), NOTHING).softmax(dim=1)
        score = score * real  # a node without neighbours gets no message
        h = h + self.out((score[..., None] * split).sum(dim=1).flatten(1))
        return h + torch.as_tensor(self.ffn(h))


class Encoder(nn.Module):
    """Encodes all nodes of a graph."""

    def __init__(self, width: int, layers: int) -> None:
        super().__init__()
        self.node = nn.Sequential(nn.Linear(NODE_SIZE, width), nn.GELU(), nn.Linear(width, width))
        self.edge = nn.Sequential(nn.Linear(EDGE_SIZE, width), nn.GELU(), nn.Linear(width, width), nn.GELU())
        self.layers = nn.ModuleList(NeighbourAttention(width) for _ in range(layers))
        self.after = nn.LayerNorm(width)

    def forward(self, g: Graph) -> Tensor:
        """Returns (V, width)."""
        h, edge = self.node(g.node), self.edge(g.edge)
        for layer in self.layers:
            h = layer(h, edge, g.neighbour)
        return torch.as_tensor(self.after(h))


class Consensus(nn.Module):
    """Rounds of message passing between candidates, with shared weights."""

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

    def weights(self, support: Support) -> Tensor:
        """(E, REASONS) weights in [0, 1] of each combination, from its geometry."""
        return torch.sigmoid(self.compatible(support.feature) - 1)

    def forward(self, state: Tensor, feature: Tensor, likely: Tensor, support: Support, weight: Tensor) -> Tensor:
        """(N K, width) states after one round, from states, features (N K, PAIR_SIZE) and probabilities (N K,)."""
        message = torch.tanh(self.message(state))
        message = torch.cat((torch.ones_like(message), message), dim=-1)
        sent = (likely[:, None] * message)[support.other] * weight.repeat(1, 2)
        received = added(torch.zeros_like(message), support.pair, sent)
        return torch.as_tensor(self.after(state + self.step(torch.cat((state, received, feature), dim=-1))))


class MatchingNetwork(nn.Module):
    """Proposes matches of a map's walls and rooms with a plan's; every node may stay unmatched."""

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.settings = settings
        width = settings.width
        self.encoder = Encoder(width, settings.layers)
        self.wall_vector, self.room_vector = nn.Linear(width, width), nn.Linear(width, width)
        self.sharpness = nn.Parameter(torch.tensor([12.0, 8.0, 0.5]))  # of walls, rooms, rooms for walls
        self.no_wall, self.no_room = nn.Linear(width, 1), nn.Linear(width, 1)
        self.consensus = Consensus(settings.state)
        self.room_step = nn.Sequential(nn.Linear(SHARE_SIZE, ROOM_WIDTH), nn.GELU(), nn.Linear(ROOM_WIDTH, 1))

    def encode(self, g: Graph) -> Encoded:
        """Encodes a graph with at least one wall on its own."""
        nodes, count = self.encoder(g), g.wall.shape[0]
        walls, rooms = nodes[:count], nodes[count:]
        vectors = normalize(self.wall_vector(walls), dim=-1), normalize(self.room_vector(rooms), dim=-1)
        near = g.neighbour[:count, :SUPPORTERS]
        return Encoded(*vectors, self.no_wall(walls), self.no_room(rooms), g.wall, g.room, g.floor, near)

    def forward(self, s: Encoded, a: Encoded, enough: float = 1.0) -> Output:
        """Matches a map with a plan, each with at least one wall.

        Once the mean probability of the walls' best answers is `enough`, later cycles keep no candidates.
        """
        s, a = s._replace(rooms=pad(s.rooms, (0, 0, 0, 1)), no_room=pad(s.no_room, (0, 0, 0, 1))), a.padded()
        rooms = torch.cat((self.sharpness[1] * s.rooms @ a.rooms[:-1].T, s.no_room), dim=-1)  # (M + 1, B + 1)
        dense = self._wall_logits(s, a, rooms)
        found, output = first_candidates(dense, self.settings.candidates), Output(dense, [], [rooms])
        self._cycle(s, a, found, output)
        sure = torch.zeros((), dtype=torch.bool, device=dense.device)
        for _ in range(1, self.settings.cycles):
            column, table = output.walls[-1]
            probability = table.softmax(dim=-1)
            found = expanded(s, a, dense, found._replace(likely=probability[:, :-1]), self.settings.more)
            sure = sure | (probability.amax(dim=-1).mean() >= enough)
            self._cycle(s, a, found._replace(column=torch.where(sure, -1, found.column)), output)
            column = pad(column, (0, self.settings.more), value=-1)
            table = torch.cat((pad(table[:, :-1], (0, self.settings.more), value=NOTHING), table[:, -1:]), dim=-1)
            later_column, later = output.walls[-1]
            output.walls[-1] = torch.where(sure, column, later_column), torch.where(sure, table, later)
        return output._replace(rooms=[table[:-1] for table in output.rooms])

    def _wall_logits(self, s: Encoded, a: Encoded, rooms: Tensor) -> Tensor:
        """(N, A + 1) logits of walls from their vectors, and from those of their rooms if both have one."""
        table = self.sharpness[0] * s.walls @ a.walls[:-1].T
        with_room = (s.room >= 0)[:, None] & (a.room[:-1] >= 0)
        of_room = rooms.log_softmax(dim=-1).clamp(min=LEAST_ODDS)[s.room][:, a.room[:-1]]
        update = self.sharpness[2] * torch.where(with_room, of_room, ROOM_UNKNOWN)
        return torch.cat((table + torch.where(with_room.any(), update, 0.0), s.no_wall), dim=-1)

    def _cycle(self, s: Encoded, a: Encoded, found: Candidates, output: Output) -> None:
        """Rounds of consensus among given candidates; appends their tables to the output."""
        support = supporting(s, a, found.column)
        weight = self.consensus.weights(support)
        size = torch.sqrt((2 * s.wall[:, 4]).clamp(0.35, 6.0))
        whole = agreement(s, a, found.column, found.likely.detach(), size)
        first, likely, state = output.rooms[0], found.likely, None
        for _ in range(self.settings.rounds):
            feature = pair_features(s, a, found, likely, output.rooms[-1], whole).flatten(0, 1)
            state = self.consensus.begin(feature) if state is None else state
            state = self.consensus(state, feature, likely.flatten(), support, weight)
            logit = found.logit + 5 * self.consensus.score(state).view(likely.shape)
            logit = torch.where(found.column >= 0, logit, NOTHING)
            output.walls.append((found.column, torch.cat((logit, output.dense[:, -1:]), dim=-1)))
            likely = output.walls[-1][1].softmax(dim=-1)[:, :-1]
            update = self.room_step(room_shares(s, a, found.column, likely, size, first))[..., 0]
            output.rooms.append(torch.cat((first[:, :-1] + update, first[:, -1:]), dim=-1))


def first_candidates(dense: Tensor, count: int) -> Candidates:
    """Returns the likeliest `count` columns of logits (N, A + 1), whose last column is no match."""
    value, column = pad(dense[:, :-1], (0, count), value=NOTHING).topk(count, dim=1)
    column = torch.where(value.detach() > NOTHING / 2, column, -1)
    likely = torch.cat((value, dense[:, -1:]), dim=-1).softmax(dim=-1)[:, :-1]
    return Candidates(column, value, likely)


def expanded(s: Encoded, a: Encoded, dense: Tensor, known: Candidates, more: int) -> Candidates:
    """Returns the known candidates and up to `more` near the likely partners of each wall's neighbours.

    If j is matched to b, i is expected among the walls near b, at the same relative pose. All neighbours j of i vote.
    """
    wall, candidate, strength = _votes(s, a, known)
    wide = dense.shape[1]
    total = added(torch.zeros_like(dense).flatten(), wall * wide + candidate, strength).view(dense.shape)
    # The last column, which is no match, takes the place of candidates that are none.
    total = total.scatter(1, torch.where(known.column >= 0, known.column, wide - 1), 0.0)[:, :-1]
    value, column = pad(total, (0, more)).topk(more, dim=1)
    column = torch.where(value > 0, column, -1)
    logit = torch.where(column >= 0, dense.gather(1, column.clamp(min=0)), NOTHING)
    likely = torch.cat((known.likely, TRUST * value.clamp(max=1.0)), dim=-1)
    likely = likely / likely.sum(dim=-1, keepdim=True).clamp(min=1.0)
    return Candidates(torch.cat((known.column, column), -1), torch.cat((known.logit, logit), -1), likely)


def _votes(s: Encoded, a: Encoded, known: Candidates) -> tuple[Tensor, Tensor, Tensor]:
    """(E,) map walls i, planned walls c near the partners of i's neighbours, and the weight of each vote."""
    value, place = known.likely.detach().topk(VOTES_EACH, dim=1)  # (N, 2)
    partner = torch.where(value > LEAST_LIKELY, known.column.gather(1, place), -1)
    # The walls near each wall's partners, (N, 2, 1 + SUPPORTERS): first the partner, since walls are seen in pieces.
    there = torch.where((partner >= 0)[..., None], torch.cat((partner[..., None], a.near[partner]), dim=-1), -1)
    i, slot, t, at = ((s.near >= 0)[..., None, None] & (there >= 0)[s.near]).nonzero().unbind(-1)
    j = s.near[i, slot]
    b, c, strength = partner[j, t], there[j, t, at], value[j, t]
    compared = Compared.of(s.wall[j], s.wall[i], a.wall[b], a.wall[c])
    alike = torch.exp(-0.5 * _square(compared.left) / CLOSE_M**2) * (compared.cos > LEAST_COS)
    return i, c, torch.where(alike > LEAST_ALIKE, strength * alike, 0.0)


class Compared(NamedTuple):
    """The relative pose of wall j in the frame of i, both of the map, compared with that of planned walls q and p.

    The middle of a wall slides by half the error of its length, so offsets may differ by as much.
    """

    offset: Tensor  # (E, 4) of j across and along i, of i across and along j, in metres
    turn: Tensor  # (E, 2) cosine and sine of the angle from i to j
    off: Tensor  # (E, 4) absolute differences of the offsets
    left: Tensor  # (E, 4) what is left of them where walls slide
    slide: Tensor  # (E,) metres
    cos: Tensor  # (E,) of the difference of the angles
    sin: Tensor

    @staticmethod
    def of(i: Tensor, j: Tensor, p: Tensor, q: Tensor) -> "Compared":
        """Compares walls, all (E, 5)."""
        (offset, turn), (there, turn_there) = _relative(i, j), _relative(p, q)
        off = (offset - there).abs()
        one, other = (i[:, 4] - p[:, 4]).abs(), (j[:, 4] - q[:, 4]).abs()
        cos, sin = turn.abs().unbind(-1)
        slack = torch.stack((other * sin, one + other * cos, one * sin, other + one * cos), dim=-1)
        (c, s), (u, v) = turn.unbind(-1), turn_there.unbind(-1)
        return Compared(offset, turn, off, (off - slack).clamp(min=0), one + other, c * u + s * v, s * u - c * v)

    @property
    def most(self) -> Tensor:
        """(E,) the largest of what is left."""
        one, other, third, fourth = self.left.unbind(-1)
        return torch.maximum(torch.maximum(one, other), torch.maximum(third, fourth))


def _square(vector: Tensor) -> Tensor:
    """(E,) the squared lengths of vectors (E, n). A sum over their last axis fails for E = 0 in ONNX Runtime 1.26."""
    first, *others = vector.unbind(-1)
    total = first * first
    for x in others:
        total = total + x * x
    return total


def _relative(i: Tensor, j: Tensor) -> tuple[Tensor, Tensor]:
    """(E, 4) offsets of walls (E, 5) across and along i, across and along j; (E, 2) the turn from i to j."""
    x, y, c, s, _ = i.unbind(-1)
    u, v, d, t, _ = j.unbind(-1)
    x, y = u - x, v - y
    offset = torch.stack((x * c + y * s, y * c - x * s, -(x * d + y * t), x * t - y * d), dim=-1)
    return offset, torch.stack((c * d + s * t, c * t - s * d), dim=-1)


def turns(s: Encoded, partner: Tensor) -> Tensor:
    """(N, K, 2) cosine and sine of the angle from each map wall to its partners (N, K, 5)."""
    (c, d), (u, v) = s.wall[:, None, 2:4].unbind(-1), partner[..., 2:4].unbind(-1)
    return torch.stack((c * u + d * v, c * v - d * u), dim=-1)


def supporting(s: Encoded, a: Encoded, column: Tensor) -> Support:
    """Returns all combinations that are roughly alike: on one storey, with similar angles and offsets."""
    partner, some = a.wall[column], (column >= 0).any(dim=1)  # (N, K, 5), (N,)
    turn, floor = turns(s, partner), a.floor[column]
    i, slot = ((s.near >= 0) & some[:, None] & some[s.near]).nonzero().unbind(-1)
    j = s.near[i, slot]
    # Cheap tests of all combinations, (pairs of neighbours, K of i, K of j).
    far = _square(s.wall[j, :2] - s.wall[i, :2]).sqrt()[:, None, None]
    x, y = (partner[j, :, d][:, None] - partner[i, :, d][:, :, None] for d in (0, 1))
    square = x * x + y * y
    real = (square < (far + OFFSET_M) ** 2) & (square > (far - OFFSET_M).clamp(min=0) ** 2)
    real = real & (turn[i] @ turn[j].transpose(1, 2) > LEAST_COS)
    real = real & (floor[i][:, :, None] == floor[j][:, None]) & (floor[i] >= 0)[:, :, None]
    pair, at, other = real.nonzero().unbind(-1)
    i, j = i[pair], j[pair]
    p, q = column[i, at], column[j, other]
    compared = Compared.of(s.wall[i], s.wall[j], a.wall[p], a.wall[q])
    kept = ((compared.cos > LEAST_COS) & (compared.most < LEFT_M)).nonzero()[:, 0]
    i, j, p, q, at, other = (index[kept] for index in (i, j, p, q, at, other))
    k = column.shape[1]
    compared = Compared(*(x[kept] for x in compared))
    return Support(i * k + at, j * k + other, _comparison(s, a, (i, j), (p, q), compared))


def _comparison(
    s: Encoded, a: Encoded, of_s: tuple[Tensor, Tensor], of_a: tuple[Tensor, Tensor], compared: Compared
) -> Tensor:
    """(E, COMPARED_SIZE) how alike two pairs of walls are: offsets at several scales, angle, distance, rooms."""
    (i, j), (p, q) = of_s, of_a
    scales = torch.tensor(SCALES_M, device=i.device)
    sharp = torch.cat((compared.left, compared.off[:, ::2]), dim=-1)  # across walls also without sliding
    sharp = torch.exp(-((sharp[..., None] / scales) ** 2)).flatten(1)
    half_angle = compared.sin.abs() / (2 + 2 * compared.cos).sqrt()  # its sine
    cos, far = compared.turn[:, 0], _square(compared.offset[:, :2]).sqrt()
    with_room = (s.room[i] >= 0) & (s.room[j] >= 0)
    same_s, same_a = s.room[i] == s.room[j], (a.room[p] == a.room[q]) & (a.room[p] >= 0)
    columns = [10 * half_angle, cos.abs(), (cos < -0.9).float(), torch.exp(-far / 2), far / 8]
    columns += [(same_s & with_room).float(), ((same_s == same_a) & with_room).float()]
    columns += [(p == q).float(), compared.slide]
    return torch.cat((sharp, torch.stack(columns, dim=-1)), dim=-1)


def agreement(s: Encoded, a: Encoded, column: Tensor, likely: Tensor, size: Tensor) -> Tensor:
    """(N, K, 3) shares in [0, 1] of the map's likeliest candidates that agree with each candidate (N, K).

    Under the motion that aligns wall i with its candidate, do the other walls lie on theirs? Within a sharp reach,
    within a wide one, and the latter beside the best candidate's. Reaches grow with distance, since the map may have
    drifted on the way. `size` (N,) are the weights of the walls.
    """
    voice, at = pad((likely * size[:, None]).flatten(), (0, VOTERS)).topk(VOTERS)
    voice, at = voice[kept := (voice > 0).nonzero()[:, 0]], at[kept]
    voice = voice / voice.sum().clamp(min=1e-3)
    partner = a.wall[column]
    turn, floor, wall = turns(s, partner), a.floor[column], at // column.shape[1]
    # The voters' walls (V,) as seen from each wall, (N, V), and moved with each candidate, (N, K, V).
    x, y = (s.wall[wall, d] - s.wall[:, None, d] for d in (0, 1))
    cos, sin = turn[..., None, 0], turn[..., None, 1]
    there = partner.flatten(0, 1)[at]
    off_x = cos * x[:, None] - sin * y[:, None] + (partner[..., None, 0] - there[:, 0])
    off_y = sin * x[:, None] + cos * y[:, None] + (partner[..., None, 1] - there[:, 1])
    heard = turn @ turn.flatten(0, 1)[at].T > LEAST_VOTER_COS
    heard = heard & (floor[..., None] == floor.flatten()[at])
    heard = heard & (wall != torch.arange(s.wall.shape[0], device=wall.device)[:, None])[:, None]
    square, far = off_x * off_x + off_y * off_y, torch.sqrt(x * x + y * y)
    sharp, wide = (
        (torch.exp(square * (-0.5 / (reach + slope * far) ** 2)[:, None]) * heard) @ voice for reach, slope in REACHES
    )
    return torch.stack((sharp, wide, wide / (wide.max() + 1e-3)), dim=-1)


def pair_features(s: Encoded, a: Encoded, found: Candidates, likely: Tensor, rooms: Tensor, whole: Tensor) -> Tensor:
    """(N, K, PAIR_SIZE) features of candidates: their own, those of their competitors, the agreement of the `whole`.

    `likely` (N, K) are probabilities, `rooms` (M + 1, B + 1) logits of rooms.
    """
    wall = torch.where(found.column >= 0, found.column, a.wall.shape[0] - 1)
    taken = added(torch.zeros_like(a.wall[:, 0]), wall.flatten(), likely.flatten())
    with_room, at = _in_rooms(s, a, found.column, rooms)
    of_room = torch.where(with_room, rooms.softmax(dim=-1).flatten()[at], 0.0)
    longer = s.wall[:, None, 4] - a.wall[found.column.clamp(min=0)][..., 4]
    columns = [found.logit.clamp(min=-30) / 10, likely, likely / (taken[wall] + 1e-3), of_room, with_room.float()]
    columns += [longer.clamp(min=0), (-longer).clamp(min=0)]
    return torch.cat((torch.stack(columns, dim=-1), whole), dim=-1)


def _in_rooms(s: Encoded, a: Encoded, column: Tensor, rooms: Tensor) -> tuple[Tensor, Tensor]:
    """(N, K) whether a wall and its candidate have a room, and where the two are in the flattened table of rooms."""
    room, there = s.room[:, None], a.room[column]
    with_room = (room >= 0) & (there >= 0)
    return with_room, torch.where(with_room, room * rooms.shape[1] + there, 0)


def room_shares(s: Encoded, a: Encoded, column: Tensor, likely: Tensor, size: Tensor, rooms: Tensor) -> Tensor:
    """(M + 1, B, SHARE_SIZE) the shares of a map room's walls in each planned room, and the first estimate.

    `rooms` (M + 1, B + 1) are the logits of that; `size` (N,) the weights of the walls.
    """
    with_room, at = _in_rooms(s, a, column, rooms)
    heard, nothing = torch.where(with_room, likely, 0.0), torch.zeros_like(rooms).flatten()
    at, values = at.flatten(), (heard * size[:, None], heard)
    by_size, count = (added(nothing, at, value.flatten()).view(rooms.shape)[:, :-1] for value in values)
    own = added(torch.zeros_like(rooms[:, 0]), s.room.clamp(min=0), torch.where(s.room >= 0, size, 0.0))
    share = by_size / (own[:, None] + 1e-3)
    claimed = share / (share.sum(dim=0, keepdim=True) + 1e-2)
    guess = rooms.log_softmax(dim=-1)[:, :-1].clamp(min=LEAST_ODDS) / 5
    return torch.stack((share, torch.sqrt(share + 1e-4), count.clamp(max=8) / 4, claimed, guess, guess.exp()), dim=-1)
