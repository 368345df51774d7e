"""`network.MatchingNetwork` for one map and one plan, without gradients: the same answers, by compiled loops.

The steps are the network's: vectors of each graph on its own, a few candidates for each S wall, rounds of consensus.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from data.compiled import compiled
from matching import compiled_candidates as candidates
from matching import compiled_consensus as consensus
from matching import compiled_encoder as encoder
from matching.arithmetic import Linear, linear, normed, softmax
from matching.compiled_candidates import Choice, Vectors
from matching.compiled_encoder import State, linear_of
from matching.features import Array32, GraphFeatures
from matching.shared_numbers import HEARD, Settings
from matching.support_loops import WallRows
from matching.walls import Index

if TYPE_CHECKING:
    from matching.network import MatchingNetwork

_NO_LENGTH = np.float32(1e-12)  # of torch's normalize


@dataclass(frozen=True)
class Encoded:
    """A graph with the vectors of its walls and rooms."""

    walls: WallRows
    vectors: Vectors


@dataclass(frozen=True)
class Likely:
    """What the network says in the end: (N, K) candidates, rows of A's walls, -1 for none, and how likely they are;
    (M, A rooms) how likely rooms are."""

    column: Index
    walls: Array32
    rooms: Array32


class CompiledNetwork:
    """The network of given settings and weights, ready to be asked."""

    def __init__(self, settings: Settings, state: State) -> None:
        self._settings = settings
        self._encoder, self._layers = encoder.encoder_of(state), encoder.layers_of(state, settings.layers)
        self._heads = tuple(linear_of(state, of) for of in ("wall_vector", "room_vector", "no_wall", "no_room"))
        self._sharpness = state["sharpness"]
        self._consensus = consensus.consensus_of(state)

    @staticmethod
    def of(network: "MatchingNetwork") -> "CompiledNetwork":
        """With the weights of a network of torch's that is on the CPU."""
        return CompiledNetwork(network.settings, {k: v.numpy() for k, v in network.state_dict().items()})

    def encode(self, f: GraphFeatures) -> Encoded:
        """What a graph is on its own."""
        h, edge = encoder.begun(f.node, f.edge, self._encoder)
        for layer in self._layers:
            h = encoder.asked(h, edge, f.neighbour, layer)
        h = normed(h, self._encoder.after)
        return Encoded(_rows_of(f), _vectors(h[f.wall_node], h[f.room_node], *self._heads))

    def ask(self, s: Encoded, a: Encoded, enough: float) -> Likely:
        """What is likely of a map and a plan, each with at least one wall; no further cycle follows once the walls'
        best answers have a probability of `enough`, in the mean."""
        dense, first_rooms = candidates.tables(s.vectors, a.vectors, s.walls.room, a.walls.room, self._sharpness)
        choice, likely = candidates.first_choice(dense, self._settings.candidates)
        rooms, size = first_rooms, np.sqrt(np.clip(2 * s.walls.half, np.float32(0.35), np.float32(6)))
        for cycle in range(self._settings.cycles):
            if cycle > 0:
                more = self._settings.more
                choice, likely = candidates.expanded(s.walls, a.walls, dense, choice, likely, more)
            likely, rooms, sure = self._cycle(s.walls, a.walls, choice, likely, size, first_rooms, rooms)
            if enough < 1 and sure >= enough:
                break
        return Likely(choice.column, likely, softmax(rooms)[:, :-1])

    def _cycle(
        self, s: WallRows, a: WallRows, choice: Choice, likely: Array32, size: Array32, first: Array32, rooms: Array32
    ) -> tuple[Array32, Array32, float]:
        """Rounds of consensus among given candidates: (N, K) and (M, A rooms + 1) as they are after, and the mean
        probability of the walls' best answers."""
        w, state = self._consensus, None
        support = consensus.support(s, a, choice.column, w)
        whole = candidates.agreement(s, a, choice, likely, size)
        for _ in range(self._settings.rounds):
            feature = consensus.features(s, a, choice, likely, whole, rooms)
            state = consensus.begun(feature, w) if state is None else state
            state, table = consensus.one_round(state, feature, likely, choice, support, w)
            answer = softmax(table)
            likely = np.ascontiguousarray(answer[:, :-1])
            rooms = consensus.rooms_told(s, a, choice, likely, size, first, w)
        return likely, rooms, float(answer.max(axis=1).mean())


def _rows_of(f: GraphFeatures) -> WallRows:
    """The walls of a graph; nodes of rooms become rows of rooms, those of neighbours rows of walls."""
    wall, room = np.full(len(f) + 1, -1), np.full(len(f) + 1, -1)  # the last is -1's
    wall[f.wall_node], room[f.room_node] = np.arange(len(f.wall_node)), np.arange(len(f.room_node))
    w, heading = f.wall_node, f.heading[f.wall_node]
    pose = np.stack((*f.centre[w].T, np.cos(heading), np.sin(heading)), axis=-1)
    return WallRows(pose, f.half[w], room[f.home[w]], f.floor[w], wall[f.neighbour[w, :HEARD]])


@compiled
def _vectors(
    walls: Array32, rooms: Array32, of_wall: Linear, of_room: Linear, no_wall: Linear, no_room: Linear
) -> Vectors:
    return Vectors(
        _unit(linear(walls, of_wall)), _unit(linear(rooms, of_room)),
        linear(walls, no_wall)[:, 0].copy(), linear(rooms, no_room)[:, 0].copy(),
    )  # fmt: skip


@compiled
def _unit(vectors: Array32) -> Array32:
    for row in vectors:
        square = np.float32(0)
        for x in row:
            square += x * x
        row /= max(np.sqrt(square), _NO_LENGTH)
    return vectors
