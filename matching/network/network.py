"""The network that proposes which S wall surface is which A wall surface, and which S room which A room.

Three steps: vectors of the nodes of each graph on its own (`encoder`); a few candidates for each S wall, from their
vectors and those of their rooms; and rounds of consensus between candidates (`consensus`), in which rooms and walls
update each other. Every node may stay unmatched.
"""

from dataclasses import asdict, dataclass

import torch
from torch import Tensor, nn

from matching.network.agreement import agreement
from matching.network.candidates import Batched, Candidates, expanded, first_candidates, homes
from matching.network.consensus import Consensus, support
from matching.network.dimensions import LEAST_ODDS, NOTHING, PAIR_SIZE, ROOM_UNKNOWN, ROOM_WIDTH, SHARE_SIZE, Settings
from matching.network.encoder import Encoder, GraphTensors
from matching.network.features import PairRows


@dataclass(frozen=True)
class Encoded:
    """A graph with unit vectors of its walls (N, width) and rooms (M, width)."""

    graph: GraphTensors
    nodes: Tensor  # (V, width) of the encoder
    walls: Tensor
    rooms: Tensor


@dataclass(frozen=True)
class Output:
    """Log odds for N S walls and M S rooms. Columns are A's walls and rooms of the pair, counted from its first.

    The last column of all tables is "no match". Tables of walls come with the columns of their K candidates, -1 for
    none; tables of rooms are the first estimate, then one after each round.
    """

    dense: Tensor  # (N, most A walls + 1) from the vectors alone
    walls: list[tuple[Tensor, Tensor]]  # after each round (N, K) candidates, (N, K + 1) log odds
    rooms: list[Tensor]  # (M, most A rooms + 1)


class MatchingNetwork(nn.Module):
    """Proposes matches. The pairs of a batch do not influence each other."""

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

    def encode(self, graph: GraphTensors) -> Encoded:
        """Encodes a graph on its own."""
        nodes = self.encoder(graph)
        walls = nn.functional.normalize(self.wall_vector(nodes[graph.wall_node]), dim=-1)
        rooms = nn.functional.normalize(self.room_vector(nodes[graph.room_node]), dim=-1)
        return Encoded(graph, nodes, walls, rooms)

    def forward(self, s: Encoded, a: Encoded, pairs: list[PairRows], enough: float = 1.0) -> Output:
        """Matches every pair of a batch; each has at least one wall on both sides.

        Cycles end early once the mean probability of the walls' best candidates reaches `enough`.
        """
        batched = Batched.of(s.graph, a.graph, pairs)
        rooms = self._room_table(s, a, pairs)
        dense = self._wall_table(s, a, pairs, rooms)
        candidates = first_candidates(dense, batched, self.settings.candidates)
        output = Output(dense, [], [rooms])
        for cycle in range(self.settings.cycles):
            if cycle > 0:
                likely = output.walls[-1][1].softmax(dim=-1)[:, :-1]
                more = self.settings.more
                candidates = expanded(s.graph, a.graph, batched, dense, candidates, likely, more)
            self._cycle(s.graph, a.graph, batched, candidates, output)
            if enough < 1 and output.walls[-1][1].softmax(dim=-1).amax(dim=-1).mean() >= enough:
                break
        return output

    def _cycle(self, s: GraphTensors, a: GraphTensors, batched: Batched, c: Candidates, output: Output) -> None:
        """Rounds of consensus among given candidates; appends their tables to the output."""
        combinations = support(s, a, c)
        weight = self.consensus.weights(combinations)
        size = torch.sqrt((2 * s.half[s.wall_node]).clamp(0.35, 6.0))
        first, likely = output.rooms[0], c.likely
        whole = agreement(s, a, batched, c, likely.detach())
        state = None
        for _ in range(self.settings.rounds):
            feature = _feature(s, a, batched, c, likely, output.rooms[-1], whole)
            state = self.consensus.initial_state(feature) if state is None else state
            state = self.consensus.round(state, feature, likely.flatten(), combinations, weight)
            output.walls.append((c.column, self.consensus.logits(state, c)))
            likely = output.walls[-1][1].softmax(dim=-1)[:, :-1]
            update = self.room_step(_shares(batched, c, likely, size, first))[..., 0]
            output.rooms.append(torch.cat((first[:, :-1] + update, first[:, -1:]), dim=-1))

    def _room_table(self, s: Encoded, a: Encoded, pairs: list[PairRows]) -> Tensor:
        none = self.no_room(s.nodes[s.graph.room_node])
        tables = [self.sharpness[1] * s.rooms[slice(*p.s_rooms)] @ a.rooms[slice(*p.a_rooms)].T for p in pairs]
        return torch.cat((_stacked(tables), none), dim=-1)

    def _wall_table(self, s: Encoded, a: Encoded, pairs: list[PairRows], rooms: Tensor) -> Tensor:
        """Log odds of walls from their vectors, and from those of their rooms if both have one."""
        none = self.no_wall(s.nodes[s.graph.wall_node])
        update = rooms.log_softmax(dim=-1).clamp(min=LEAST_ODDS)
        s_home, a_home = homes(s.graph), homes(a.graph)
        tables = []
        for p in pairs:
            table = self.sharpness[0] * s.walls[slice(*p.s_walls)] @ a.walls[slice(*p.a_walls)].T
            r, q = s_home[slice(*p.s_walls)], a_home[slice(*p.a_walls)]
            if p.s_rooms[0] < p.s_rooms[1] and p.a_rooms[0] < p.a_rooms[1]:
                with_room = (r >= 0)[:, None] & (q >= 0)[None, :]
                of_room = update[r.clamp(min=0)][:, (q - p.a_rooms[0]).clamp(min=0)]
                table = table + self.sharpness[2] * torch.where(with_room, of_room, ROOM_UNKNOWN)
            tables.append(table)
        return torch.cat((_stacked(tables), none), dim=-1)

    def to_dict(self) -> dict[str, int]:
        """Returns the settings as stored with the weights."""
        return asdict(self.settings)


def _stacked(tables: list[Tensor]) -> Tensor:
    """Concatenates tables, padded to one width."""
    wide = max([t.shape[1] for t in tables])
    return torch.cat([nn.functional.pad(t, (0, wide - t.shape[1]), value=NOTHING) for t in tables])


def _feature(
    s: GraphTensors, a: GraphTensors, batched: Batched, c: Candidates, likely: Tensor, rooms: Tensor, whole: Tensor
) -> Tensor:
    """(N K, PAIR_SIZE) features of each candidate: its own, those of its competitors, and the agreement of the
    `whole` map.
    """
    wall = torch.where(c.row >= 0, c.row + 1, 0) + (len(a.wall_node) + 1) * batched.pair[:, None]
    taken = torch.zeros(int(wall.max()) + 1, device=likely.device).index_add(0, wall.flatten(), likely.flatten())
    with_room = (batched.s_home >= 0)[:, None] & (c.room >= 0)
    of_room = torch.zeros_like(likely)
    if len(rooms):
        of_room = rooms.softmax(dim=-1)[batched.s_home.clamp(min=0)].gather(1, c.room.clamp(min=0))
    longer = s.half[s.wall_node][:, None] - a.half[a.wall_node[c.row.clamp(min=0)]]
    columns = [
        c.logit.clamp(min=-30) / 10, likely, likely / (taken[wall] + 1e-3), torch.where(with_room, of_room, 0.0),
        with_room.float(), longer.clamp(min=0), (-longer).clamp(min=0),
    ]  # fmt: skip
    feature = torch.cat((torch.stack(columns, dim=-1), whole), dim=-1)
    assert feature.shape[-1] == PAIR_SIZE
    return feature.flatten(0, 1)


def _shares(batched: Batched, c: Candidates, likely: Tensor, size: Tensor, rooms: Tensor) -> Tensor:
    """(M, A rooms, SHARE_SIZE) the shares of an S room's walls in each A room, and the first estimate."""
    shape, home = (rooms.shape[0], rooms.shape[1] - 1), batched.s_home
    nothing = torch.zeros(shape[0] * shape[1], device=rooms.device)
    with_room = (home >= 0)[:, None] & (c.room >= 0)
    at = (home[:, None] * shape[1] + c.room)[with_room]
    by_size = nothing.index_add(0, at, (likely * size[:, None])[with_room]).view(shape)
    count = nothing.index_add(0, at, likely[with_room]).view(shape)
    own = torch.zeros(shape[0], device=rooms.device).index_add(0, home[home >= 0], size[home >= 0])
    share = by_size / (own[:, None] + 1e-3)
    claimed = share / (share.sum(dim=0, keepdim=True) + 1e-2)
    guess = rooms.log_softmax(dim=-1)[:, :-1].clamp(min=LEAST_ODDS) / 5
    return torch.stack((share, torch.sqrt(share + 1e-4), count.clamp(max=8) / 4, claimed, guess, guess.exp()), dim=-1)
