"""The network as a proposer: an S-graph and an A-graph in, likely partners out; to be verified by others."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data.errors import UserError
from data.scene_graph import SceneGraph
from matching.encoder import GraphTensors
from matching.features import GraphFeatures, PairRows, map_features, plan_features
from matching.kept import Kept
from matching.network import Encoded, MatchingNetwork
from matching.networks import Network
from matching.proposals import MOST, Proposals, TopK
from matching.relatives_parts import Embedded
from matching.walls import Index
from matching.weights_file import load_network

SHIPPED = Path(__file__).parent / "weights" / "learned.pt"
ENOUGH = 0.93  # mean probability of the walls' best answers; further cycles would change little


@dataclass(frozen=True)
class _Plan:
    features: GraphFeatures
    encoded: Encoded | Embedded


class LearnedProposer:
    """Asks the network, which goes on until it is sure `enough`; keeps what it knows of the last plans."""

    def __init__(self, network: Network, enough: float = ENOUGH) -> None:
        self._network = network
        self._ask = partial(network, enough=enough) if isinstance(network, MatchingNetwork) else network
        self._plan = Kept(self._plan_of)

    @staticmethod
    def load(path: Path | str | None = None) -> "LearnedProposer":
        """With the weights of a file, the shipped ones unless told; raises UserError where it is no network's."""
        if path is None and not SHIPPED.is_file():
            raise UserError("the learned matcher's weights are not installed; give a file that matching.train wrote")
        return LearnedProposer(load_network(Path(path or SHIPPED)))

    def propose(self, s: SceneGraph, a: SceneGraph) -> Proposals:
        """The likely partners of each S wall surface and room, in the order of the graphs."""
        plan = self._plan(a)
        seen = map_features(s)
        walls, rooms = _none(len(s.wall_surfaces)), _none(len(s.rooms))
        if not seen.walls or not plan.features.walls:
            return Proposals(walls, rooms)
        sizes = (seen.walls, plan.features.walls, seen.rooms, plan.features.rooms)
        with _asked():
            encoded = self._network.encode(GraphTensors.of(seen))
            output = self._ask(encoded, plan.encoded, [PairRows(*((0, len(x)) for x in sizes))])
            column, table = output.walls[-1]
            wall_score = table.softmax(dim=-1)[:, :-1]
            room_score = output.rooms[-1].softmax(dim=-1)[:, :-1]
        of_s = [w.id for w in s.wall_surfaces], [r.id for r in s.rooms]
        of_a = [w.id for w in a.wall_surfaces], [r.id for r in a.rooms]
        walls = _best(wall_score, column, _places(seen.walls, of_s[0]), _places(plan.features.walls, of_a[0]))
        if seen.rooms and plan.features.rooms:
            every = torch.arange(room_score.shape[1]).expand_as(room_score)
            rows, columns = _places(seen.rooms, of_s[1]), _places(plan.features.rooms, of_a[1])
            rooms = _best(room_score, every, rows, columns, len(s.rooms))
        return Proposals(walls, rooms)

    def _plan_of(self, a: SceneGraph) -> _Plan:
        found = plan_features(a)
        with _asked():
            return _Plan(found, self._network.encode(GraphTensors.of(found)))


@contextmanager
def _asked() -> Iterator[None]:
    """Without gradients, and on one thread: graphs are small, and threads would wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.inference_mode():
            yield
    finally:
        torch.set_num_threads(threads)


def _none(count: int) -> TopK:
    return TopK(np.full((count, 0), -1), np.zeros((count, 0)))


def _places(ids: tuple[str, ...], order: list[str]) -> Index:
    """(N,) where each id stands in the graph."""
    place = {name: k for k, name in enumerate(order)}
    return np.array([place[name] for name in ids], dtype=np.int64)


def _best(score: Tensor, column: Tensor, rows: Index, columns: Index, count: int | None = None) -> TopK:
    """The best few of each row; rows of the graph that the network was not given have none."""
    value, at = score.topk(min(MOST, score.shape[1]), dim=1)
    chosen = column.gather(1, at).numpy()
    real = chosen >= 0
    count = len(rows) if count is None else count
    partner, kept = np.full((count, value.shape[1]), -1), np.zeros((count, value.shape[1]))
    partner[rows] = np.where(real, columns[np.maximum(chosen, 0)], -1)
    kept[rows] = np.where(real, value.numpy().astype(float), 0.0)
    return TopK(partner, kept)
