"""The network that proposes which S wall surface is which A wall surface, and which S room which A room.

Three steps: vectors of the nodes of each graph on its own (`encoder`); a few candidates for each S wall, by their
vectors and by those of their rooms; and rounds of consensus between candidates (`consensus`), with rooms and walls
telling each other. Every node may stay without a partner.
"""

from dataclasses import asdict, dataclass

import torch
from torch import Tensor, nn

from matching.consensus import PAIR_SIZE, Candidates, Consensus, support
from matching.encoder import Encoder, GraphTensors
from matching.features import PairRows

NOTHING = -1e4  # a logit that is as good as minus infinity
SHARE_SIZE = 6


@dataclass(frozen=True)
class Settings:
    """The size of a network; kept in its file."""

    width: int = 64
    layers: int = 3
    candidates: int = 16
    rounds: int = 4
    state: int = 32


@dataclass(frozen=True)
class Encoded:
    """A graph with the vectors of its walls (N, width) and rooms (M, width), of unit length."""

    graph: GraphTensors
    nodes: Tensor  # (V, width) of the encoder
    walls: Tensor
    rooms: Tensor


@dataclass(frozen=True)
class Output:
    """Log odds for N S walls and M S rooms. Columns are A's walls and rooms of the pair, counted from its first.

    The last column of all tables is "none". `partner` are the columns of the K candidates, -1 where there are
    fewer; the tables of rounds are the first guess, then after each round.
    """

    dense: Tensor  # (N, most A walls + 1) from the vectors alone
    partner: Tensor  # (N, K)
    walls: list[Tensor]  # (N, K + 1)
    rooms: list[Tensor]  # (M, most A rooms + 1)


class MatchingNetwork(nn.Module):
    """Proposes partners. Each pair of a batch is worked on as if it were alone."""

    def __init__(self, settings: Settings) -> None:
        super().__init__()
        self.settings = settings
        width = settings.width
        self.encoder = Encoder(width, settings.layers)
        self.wall_vector, self.room_vector = nn.Linear(width, width), nn.Linear(width, width)
        self.sharpness = nn.Parameter(torch.tensor([12.0, 8.0, 0.5]))  # of walls, of rooms, of rooms' say on walls
        self.no_wall, self.no_room = nn.Linear(width, 1), nn.Linear(width, 1)
        self.consensus = Consensus(settings.state)
        self.room_step = nn.Sequential(nn.Linear(SHARE_SIZE, 24), nn.GELU(), nn.Linear(24, 1))

    def encode(self, graph: GraphTensors) -> Encoded:
        """What a graph is on its own."""
        nodes = self.encoder(graph)
        walls = nn.functional.normalize(self.wall_vector(nodes[graph.wall_node]), dim=-1)
        rooms = nn.functional.normalize(self.room_vector(nodes[graph.room_node]), dim=-1)
        return Encoded(graph, nodes, walls, rooms)

    def forward(self, s: Encoded, a: Encoded, pairs: list[PairRows], truth: Tensor | None = None) -> Output:
        """`truth` (N,), in training: the column of each S wall's partner, made sure to be a candidate, -1 for none."""
        rooms = self._room_table(s, a, pairs)
        dense = self._wall_table(s, a, pairs, rooms)
        partner = _candidates(dense[:, :-1].detach(), self.settings.candidates, truth)
        first_wall = _spread([(p.s_walls, p.a_walls[0]) for p in pairs], partner)
        first_room = _spread([(p.s_walls, p.a_rooms[0]) for p in pairs], partner)
        logit = dense.gather(1, partner.clamp(min=0)).masked_fill(partner < 0, NOTHING)
        row = torch.where(partner >= 0, partner + first_wall[:, None], -1)
        candidates = Candidates(row, logit, dense[:, -1])
        a_room = a.graph.numbers(a.graph.room_node)[a.graph.home[a.graph.wall_node]]
        a_room = torch.where(a.graph.home[a.graph.wall_node] >= 0, a_room, -1)
        column = a_room[row.clamp(min=0)] - first_room[:, None] if len(a_room) else row
        column = torch.where((row >= 0) & (column >= 0), column, -1)
        pair = _spread([(p.s_walls, k) for k, p in enumerate(pairs)], partner)
        return self._rounds(s.graph, a.graph, candidates, partner, dense, rooms, column, pair)

    def _room_table(self, s: Encoded, a: Encoded, pairs: list[PairRows]) -> Tensor:
        none = self.no_room(s.nodes[s.graph.room_node])
        tables = [self.sharpness[1] * s.rooms[slice(*p.s_rooms)] @ a.rooms[slice(*p.a_rooms)].T for p in pairs]
        return torch.cat((_stacked(tables), none), dim=-1)

    def _wall_table(self, s: Encoded, a: Encoded, pairs: list[PairRows], rooms: Tensor) -> Tensor:
        """Walls by their vectors, and by the odds of their rooms where both have one."""
        none = self.no_wall(s.nodes[s.graph.wall_node])
        told = rooms.log_softmax(dim=-1).clamp(min=-12)
        s_home, a_home = _homes(s.graph), _homes(a.graph)
        tables = []
        for p in pairs:
            table = self.sharpness[0] * s.walls[slice(*p.s_walls)] @ a.walls[slice(*p.a_walls)].T
            r, q = s_home[slice(*p.s_walls)], a_home[slice(*p.a_walls)]
            if p.s_rooms[0] < p.s_rooms[1] and p.a_rooms[0] < p.a_rooms[1]:
                housed = (r >= 0)[:, None] & (q >= 0)[None, :]
                of_room = told[r.clamp(min=0)][:, (q - p.a_rooms[0]).clamp(min=0)]
                table = table + self.sharpness[2] * torch.where(housed, of_room, -3.0)
            tables.append(table)
        return torch.cat((_stacked(tables), none), dim=-1)

    def _rounds(
        self, s: GraphTensors, a: GraphTensors, candidates: Candidates, partner: Tensor, dense: Tensor,
        rooms: Tensor, column: Tensor, pair: Tensor,
    ) -> Output:  # fmt: skip
        combinations = support(s, a, candidates)
        weight = self.consensus.weights(combinations)
        walls = [torch.cat((candidates.logit, candidates.dustbin[:, None]), dim=-1)]
        tables, home = [rooms], _homes(s)
        size = torch.sqrt((2 * s.half[s.wall_node]).clamp(0.35, 6.0))
        state = None
        for _ in range(self.settings.rounds):
            likely = walls[-1].softmax(dim=-1)[:, :-1]
            feature = _feature(s, a, candidates, likely, tables[-1], home, column, pair)
            state = self.consensus.begun(feature) if state is None else state
            state = self.consensus.round(state, feature, likely.flatten(), combinations, weight)
            walls.append(self.consensus.logits(state, candidates))
            share = _shares(a, walls[-1].softmax(dim=-1)[:, :-1], home, column, size, rooms)
            told = self.room_step(share)[..., 0]
            tables.append(torch.cat((rooms[:, :-1] + told, rooms[:, -1:]), dim=-1))
        return Output(dense, partner, walls, tables)

    def to_dict(self) -> dict[str, int]:
        """The settings, as they are kept beside the weights."""
        return asdict(self.settings)


def _stacked(tables: list[Tensor]) -> Tensor:
    """Tables below each other, padded to one width."""
    wide = max([t.shape[1] for t in tables])
    return torch.cat([nn.functional.pad(t, (0, wide - t.shape[1]), value=NOTHING) for t in tables])


def _spread(values: list[tuple[tuple[int, int], int]], like: Tensor) -> Tensor:
    """(N,) a value for all rows of each pair."""
    return torch.cat([torch.full((last - first,), v, device=like.device) for (first, last), v in values])


def _homes(g: GraphTensors) -> Tensor:
    """(N,) the row of each wall's room among the rooms, -1 where not known."""
    home = g.home[g.wall_node]
    return torch.where(home >= 0, g.numbers(g.room_node)[home.clamp(min=0)], -1)


def _candidates(dense: Tensor, most: int, truth: Tensor | None) -> Tensor:
    """(N, K) columns, best first; `truth` takes the last place where it is not among them."""
    value, partner = dense.topk(min(most, dense.shape[1]), dim=1)
    partner = torch.where(value > NOTHING / 2, partner, -1)
    if truth is not None and partner.shape[1]:
        missed = (truth >= 0) & ~(partner == truth[:, None]).any(dim=1)
        partner[missed, -1] = truth[missed]
    return partner


def _feature(
    s: GraphTensors, a: GraphTensors, candidates: Candidates, likely: Tensor, rooms: Tensor, home: Tensor,
    column: Tensor, pair: Tensor,
) -> Tensor:  # fmt: skip
    """(N K, PAIR_SIZE) what is known of each candidate by itself, and of its rivals for the A wall."""
    row = candidates.partner
    rival = torch.where(row >= 0, row + 1, 0) + (len(a.wall_node) + 1) * pair[:, None]
    taken = torch.zeros(int(rival.max()) + 1, device=likely.device).index_add(0, rival.flatten(), likely.flatten())
    of_room = rooms.softmax(dim=-1)
    told = of_room[home.clamp(min=0)].gather(1, column.clamp(min=0)) if len(of_room) else torch.zeros_like(likely)
    housed = (home >= 0)[:, None] & (column >= 0)
    longer = s.half[s.wall_node][:, None] - a.half[a.wall_node[row.clamp(min=0)]] if len(a.wall_node) else likely
    columns = [
        candidates.logit.clamp(min=-30) / 10, likely, likely / (taken[rival] + 1e-3), torch.where(housed, told, 0.0),
        housed.float(), longer.clamp(min=0), (-longer).clamp(min=0),
    ]  # fmt: skip
    assert len(columns) == PAIR_SIZE
    return torch.stack(columns, dim=-1).flatten(0, 1)


def _shares(a: GraphTensors, likely: Tensor, home: Tensor, column: Tensor, size: Tensor, rooms: Tensor) -> Tensor:
    """(M, A rooms, SHARE_SIZE) how far the walls of an S room are those of an A room, and the first guess."""
    shape = rooms.shape[0], rooms.shape[1] - 1
    housed = (home >= 0)[:, None] & (column >= 0)
    at = (home[:, None] * shape[1] + column)[housed]
    by_size = torch.zeros(shape, device=rooms.device).flatten().index_add(0, at, (likely * size[:, None])[housed])
    by_count = torch.zeros(shape, device=rooms.device).flatten().index_add(0, at, likely[housed])
    own = torch.zeros(shape[0], device=rooms.device).index_add(0, home[home >= 0], size[home >= 0])
    share = by_size.view(shape) / (own[:, None] + 1e-3)
    claimed = share / (share.sum(dim=0, keepdim=True) + 1e-2)
    guess = rooms.log_softmax(dim=-1)[:, :-1].clamp(min=-12) / 5
    count = by_count.view(shape)
    return torch.stack((share, torch.sqrt(share + 1e-4), count.clamp(max=8) / 4, claimed, guess, guess.exp()), dim=-1)
