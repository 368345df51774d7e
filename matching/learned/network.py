"""`network.MatchingNetwork` for one map and one plan, without gradients and without PyTorch.

The steps are the same: vectors of each graph on its own, a few candidates for each S wall, rounds of consensus.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from data.common.compiled import compiled
from matching.arrays import Index
from matching.learned import candidates as candidates
from matching.learned import encoder as encoder
from matching.learned.candidates import Vectors
from matching.learned.consensus import consensus_of, run_consensus
from matching.learned.named_weights import NamedWeights
from matching.network.arithmetic import Linear, Norm, linear, normed
from matching.network.dimensions import SUPPORTERS, Settings
from matching.network.features import Array32, GraphFeatures
from matching.network.support_loops import WallRows

if TYPE_CHECKING:
    from matching.network.network import MatchingNetwork

_NO_LENGTH = np.float32(1e-12)  # of torch's normalize


@dataclass(frozen=True)
class Encoded:
    """A graph with the vectors of its walls and rooms."""

    walls: WallRows
    vectors: Vectors


@dataclass(frozen=True)
class Likely:
    """The network's result: (N, K) candidates as rows of A's walls, -1 for none, and their probabilities;
    (M, A rooms) probabilities of rooms.
    """

    column: Index
    walls: Array32
    rooms: Array32


class CompiledNetwork:
    """The network of given settings and weights, which are named as in torch.

    Raises ValueError unless these are exactly the weights that it needs.
    """

    def __init__(self, settings: Settings, state: Mapping[str, Array32]) -> None:
        w, width = NamedWeights(state), settings.width
        self._settings = settings
        self._encoder, self._layers = encoder.encoder_of(w, width), encoder.layers_of(w, width, settings.layers)
        vectors = (w.linear(of, width, width) for of in ("wall_vector", "room_vector"))
        self._heads = (*vectors, *(w.linear(of, width, 1) for of in ("no_wall", "no_room")))
        self._sharpness = w.array("sharpness", 3)
        self._consensus = consensus_of(w, settings.state)
        w.end()

    @staticmethod
    def of(network: "MatchingNetwork") -> "CompiledNetwork":
        """Creates the network from a torch network on the CPU."""
        return CompiledNetwork(network.settings, {k: v.numpy() for k, v in network.state_dict().items()})

    def encode(self, f: GraphFeatures) -> Encoded:
        """Encodes a graph on its own."""
        h, edge = encoder.embedded(f.node, f.edge, self._encoder)
        for layer in self._layers:
            h = encoder.attention_layer(h, edge, f.neighbour, layer)
        return Encoded(_rows_of(f), _vectors(h, f.wall_node, f.room_node, self._encoder.after, *self._heads))

    def match(self, s: Encoded, a: Encoded, enough: float) -> Likely:
        """Matches a map with a plan, each with at least one wall. Cycles end early once the mean probability of the
        walls' best candidates reaches `enough`.
        """
        dense, rooms = candidates.tables(s.vectors, a.vectors, s.walls.room, a.walls.room, self._sharpness)
        choice, likely = candidates.first_choice(dense, self._settings.candidates)
        of = self._settings
        column, walls, rooms = run_consensus(
            s.walls, a.walls, dense, choice, likely, rooms, (of.cycles, of.rounds, of.more), enough, self._consensus
        )
        return Likely(column, walls, rooms[:, :-1])


def _rows_of(f: GraphFeatures) -> WallRows:
    """The walls of a graph, with nodes of rooms and neighbours converted to rows of rooms and walls."""
    wall, room = np.full(len(f) + 1, -1), np.full(len(f) + 1, -1)  # the last is -1's
    wall[f.wall_node], room[f.room_node] = np.arange(len(f.wall_node)), np.arange(len(f.room_node))
    w, heading = f.wall_node, f.heading[f.wall_node]
    pose = np.stack((*f.centre[w].T, np.cos(heading), np.sin(heading)), axis=-1)
    return WallRows(pose, f.half[w], room[f.home[w]], f.floor[w], wall[f.neighbour[w, :SUPPORTERS]])


@compiled
def _vectors(
    h: Array32, wall_node: Index, room_node: Index, after: Norm,
    of_wall: Linear, of_room: Linear, no_wall: Linear, no_room: Linear,
) -> Vectors:  # fmt: skip
    """Unit vectors from the encoder's last layer (V, width)."""
    nodes = normed(h, after)
    walls, rooms = nodes[wall_node], nodes[room_node]
    return Vectors(
        _unit(linear(walls, of_wall)), _unit(linear(rooms, of_room)),
        linear(walls, no_wall).reshape(len(walls)), linear(rooms, no_room).reshape(len(rooms)),
    )  # fmt: skip


@compiled
def _unit(vectors: Array32) -> Array32:
    for row in vectors:
        square = np.float32(0)
        for x in row:
            square += x * x
        row /= max(np.sqrt(square), _NO_LENGTH)
    return vectors
