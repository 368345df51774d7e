"""The published matcher: every node of the S-graph gets a partner, without verification."""

from pathlib import Path

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph import SceneGraph, Xy
from matching.published.graph import paper_graph
from matching.published.network import Nodes, PaperNetwork
from matching.published.weights import load_paper_network
from matching.result import MatchResult, Pair
from matching.search import Start
from matching.search.unchecked import match_unchecked

REASON = "the published matcher answers every time; nothing was checked"


class PaperMatcher:
    """Matches by the network's soft assignment and the Hungarian algorithm."""

    def __init__(self, network: PaperNetwork) -> None:
        self._network = network

    @staticmethod
    def load(weights: Path | str | None = None) -> "PaperMatcher":
        """Loads weights from a file, or the shipped ones of a preset: `published` (default) or `repository`.

        Raises UserError if a file does not hold such a network.
        """
        return PaperMatcher(load_paper_network(weights or "published"))

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """See `Matcher.match`. The status is always `unique`, since the method cannot reject a match.

        Confidences are the entries of the soft assignment. The method allows a room to be matched to a wall surface;
        such matches are dropped. `T_a_s` is not part of the method; it brings the centroids of partners closest to each
        other. `start` only drops an answer that is far from it.
        """
        return match_unchecked(s, a, self._pairs, _fitted, REASON, "no partner is of its own type", floor, start)

    def _pairs(self, s: SceneGraph, a: SceneGraph) -> tuple[tuple[Pair, ...], tuple[Pair, ...]]:
        settings = self._network.settings
        ours, theirs = (paper_graph(g, settings.edges, settings.without) for g in (a, s))
        with torch.inference_mode():
            soft = self._network(Nodes.of([ours]), Nodes.of([theirs]))[0].double().numpy()
        found: tuple[list[Pair], list[Pair]] = ([], [])
        for j, i in zip(*linear_sum_assignment(soft, maximize=True), strict=True):
            is_wall = bool(i >= theirs.rooms)
            if is_wall == bool(j >= ours.rooms):
                found[is_wall].append((theirs.ids[i], ours.ids[j], float(min(max(soft[j, i], 0.0), 1.0))))
        return tuple(found[0]), tuple(found[1])


def _fitted(s: SceneGraph, a: SceneGraph, rooms: tuple[Pair, ...], walls: tuple[Pair, ...]) -> Array:
    """(3,) T_a_s (yaw, x, y) that minimises the squared distances between the centroids of partners."""
    p, q = (np.array([_place(g, str(pair[k])) for pair in (*rooms, *walls)]) for k, g in enumerate((s, a)))
    middle_p, middle_q = p.mean(axis=0), q.mean(axis=0)
    p, q = (((x - m) @ [1, 1j]) for x, m in ((p, middle_p), (q, middle_q)))
    yaw = float(np.angle(np.vdot(p, q)))
    return np.array([yaw, *(middle_q - se2.rotate(yaw, middle_p))])


def _place(graph: SceneGraph, node: str) -> Xy:
    room = graph.room_by_id.get(node)
    return graph.surface_by_id[node].centroid if room is None else room.centroid
