"""PCA-GM and SuperGlue as matchers: the network's own assignment is the answer, without verification."""

from pathlib import Path

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment

from data.common.errors import UserError
from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.arrays import Index
from matching.learned.torch_weights import load_network
from matching.network.encoder import GraphTensors
from matching.network.features import PairRows, map_features, plan_features
from matching.network.registry import Network, kind_of
from matching.result import MatchResult, Pair
from matching.search import Start, fit_pairs
from matching.search.unchecked import match_unchecked

WEIGHTS = Path(__file__).parents[1] / "weights"
FORBIDDEN = -1e4
REASON = "the network's own assignment, of which nothing was checked"


class BaselineMatcher:
    """Matches by a network alone: PCA-GM by the Hungarian algorithm, SuperGlue by mutual best matches."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self._assign = mutual_best if kind_of(network) == "superglue" else hungarian

    @staticmethod
    def load(kind: str, weights: Path | str | None = None) -> "BaselineMatcher":
        """Loads weights from a file, by default the shipped ones. Raises UserError if they are of another network."""
        path = Path(weights or WEIGHTS / f"{kind}.pt")
        if weights is None and not path.is_file():
            raise UserError(f"the weights of '{kind}' are not installed; give a file that matching.train wrote")
        return BaselineMatcher(load_network(path, kind))

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """See `Matcher.match`. The status is `unique` whenever anything is matched, since the method cannot reject a
        match.

        `T_a_s` is not part of the method; it is fitted to the matched pairs. `start` only drops an answer far from it.
        """
        return match_unchecked(s, a, self._pairs, _fitted, REASON, "nothing of the map has a partner", floor, start)

    def _pairs(self, s: SceneGraph, a: SceneGraph) -> tuple[tuple[Pair, ...], tuple[Pair, ...]]:
        seen, plan = map_features(s), plan_features(a)
        sizes = (seen.walls, plan.walls, seen.rooms, plan.rooms)
        with torch.inference_mode():
            encoded = [self._network.encode(GraphTensors.of(g)) for g in (seen, plan)]
            output = self._network(*encoded, [PairRows(*((0, len(x)) for x in sizes))])
            tables = [t.log_softmax(dim=-1).double().numpy() for t in (output.rooms[-1], output.walls[-1][1])]
        found = []
        for table, ours, theirs in zip(tables, (seen.rooms, seen.walls), (plan.rooms, plan.walls), strict=True):
            at = self._assign(table)
            found.append(tuple((ours[i], theirs[j], float(np.exp(table[i, j]))) for i, j in enumerate(at) if j >= 0))
        return found[0], found[1]


def hungarian(table: Array) -> Index:
    """Returns the assignment with the highest sum of a table of log odds (Hungarian algorithm).

    `table` is (n, m + 1), its last column "no match". Returns (n,) columns, -1 for no match.
    """
    n, m = len(table), table.shape[1] - 1
    alone = np.full((n, n), FORBIDDEN)
    np.fill_diagonal(alone, table[:, -1])
    _, column = linear_sum_assignment(np.hstack((table[:, :-1], alone)), maximize=True)
    return np.where(column < m, column, -1)


def mutual_best(table: Array) -> Index:
    """Returns mutual best matches of a table of log odds (n, m + 1), whose last column is "no match".

    Returns (n,) columns, -1 where the best column is "no match" or has a better row.
    """
    if not table.size or table.shape[1] == 1:
        return np.full(len(table), -1)
    best = table.argmax(axis=1)
    back = table[:, :-1].argmax(axis=0)
    mutual = (best < len(back)) & (back[np.minimum(best, len(back) - 1)] == np.arange(len(table)))
    return np.where(mutual, best, -1)


def _fitted(s: SceneGraph, a: SceneGraph, rooms: tuple[Pair, ...], walls: tuple[Pair, ...]) -> Array:
    def lines(graph: SceneGraph, side: int) -> Array:
        own = [graph.surface_by_id[str(p[side])] for p in walls]
        return np.array([(*w.centroid, *w.normal) for w in own], dtype=float).reshape(-1, 4)

    def places(graph: SceneGraph, side: int) -> Array:
        return np.array([graph.room_by_id[str(p[side])].centroid for p in rooms], dtype=float).reshape(-1, 2)

    return fit_pairs(lines(s, 0), lines(a, 1), places(s, 0), places(a, 1))
