"""The network as a proposer: takes an S-graph and an A-graph, returns likely partners, which are then verified."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.scene_graph import SceneGraph
from matching.arrays import Index, PlanCache, Walls
from matching.learned.network import CompiledNetwork, Encoded
from matching.learned.weights_file import SUFFIX, load_learned
from matching.network.features import Array32, GraphFeatures, map_features, plan_features
from matching.search import Proposals, TopK
from matching.search.proposals import MOST

SHIPPED = Path(__file__).parents[1] / "weights" / "learned.npz"
ENOUGH = 0.93  # mean probability of the walls' best answers; further cycles would change little


@dataclass(frozen=True)
class _Plan:
    features: GraphFeatures
    encoded: Encoded
    walls: Index  # (walls,) where each is in the graph
    rooms: Index


class LearnedProposer:
    """Proposes matches with the network, whose cycles end at a certainty of `enough`; caches the last few plans."""

    def __init__(self, network: CompiledNetwork, enough: float = ENOUGH) -> None:
        self._network, self._enough = network, enough
        self._plan = PlanCache(self._plan_of)

    @staticmethod
    def load(path: Path | str | None = None) -> "LearnedProposer":
        """Loads weights from a file, by default the shipped ones. Raises UserError if the file does not hold them."""
        if path is None and not SHIPPED.is_file():
            raise UserError("the learned matcher's weights are not installed; give a file that matching.train wrote")
        return LearnedProposer(_network(Path(path or SHIPPED)))

    def propose(self, s: SceneGraph, a: SceneGraph, known: Walls | None = None) -> Proposals:
        """Returns the likely partners of each S wall surface and room, in the order of the graphs. `known` are the
        surfaces of S as arrays, if already computed.
        """
        plan = self._plan(a)
        seen = map_features(s, known)
        walls, rooms = _none(len(s.wall_surfaces)), _none(len(s.rooms))
        if not seen.walls or not plan.features.walls:
            return Proposals(walls, rooms)
        found = self._network.match(self._network.encode(seen), plan.encoded, self._enough)
        walls = _best(found.walls, found.column, np.arange(len(seen.walls)), plan.walls, len(s.wall_surfaces))
        if found.rooms.size:
            every = np.broadcast_to(np.arange(found.rooms.shape[1]), found.rooms.shape)
            rooms = _best(found.rooms, every, _places(seen.rooms, [r.id for r in s.rooms]), plan.rooms, len(s.rooms))
        return Proposals(walls, rooms)

    def _plan_of(self, a: SceneGraph) -> _Plan:
        found = plan_features(a)
        walls, rooms = [w.id for w in a.wall_surfaces], [r.id for r in a.rooms]
        return _Plan(found, self._network.encode(found), _places(found.walls, walls), _places(found.rooms, rooms))


def _network(path: Path) -> CompiledNetwork:
    if path.suffix == SUFFIX:
        return load_learned(path)
    from matching.learned.torch_weights import load_network
    from matching.network.network import MatchingNetwork  # torch is slow to import

    network = load_network(path)
    assert isinstance(network, MatchingNetwork)
    return CompiledNetwork.of(network)


def _none(count: int) -> TopK:
    return TopK(np.full((count, 0), -1), np.zeros((count, 0)))


def _places(ids: tuple[str, ...], order: list[str]) -> Index:
    """(N,) the position of each id in the graph."""
    place = {name: k for k, name in enumerate(order)}
    return np.array([place[name] for name in ids], dtype=np.int64)


def _best(score: Array32, column: Index, rows: Index, columns: Index, count: int) -> TopK:
    """The best few of each row; rows of the graph that the network did not get have none."""
    at = np.argsort(-score, axis=1, kind="stable")[:, :MOST]
    row = np.arange(len(at))[:, None]
    chosen, value = column[row, at], score[row, at]
    partner, kept = np.full((count, at.shape[1]), -1), np.zeros((count, at.shape[1]))
    partner[rows] = np.where(chosen >= 0, columns[np.maximum(chosen, 0)], -1)
    kept[rows] = np.where(chosen >= 0, value, 0.0)
    return TopK(partner, kept)
