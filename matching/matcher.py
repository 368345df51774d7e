"""`Matcher`: finds where an S-graph lies in an A-graph, by one of several methods."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from data.common.errors import UserError
from data.scene_graph import SceneGraph, implausible
from matching.arrays import Walls, arrays, storeys
from matching.combinatorial import DEVELOP, GRID, CombinatorialMatcher
from matching.result import Hypothesis, MatchResult
from matching.search import Start, near_start
from matching.search.assignment import assign
from matching.search.hypotheses import Placement, search
from matching.search.verification import verify
from matching.torch_extra import need_torch

LISTED = 10  # hypotheses in the result, at most
WITH_WEIGHTS = ("learned", "paper")
WITH_TORCH = ("paper",)


class Method(Protocol):
    """The interface of every matching method."""

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """See `Matcher.match`."""


class VotingMatcher:
    """Generalised Hough transform: wall corners vote for motions, which are scored wall by wall and verified."""

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """See `Matcher.match`."""
        began = time.perf_counter()
        candidates = [w for w in storeys(a) if floor is None or w.floor == floor]
        for what, empty in (("S-graph", not s.wall_surfaces), ("A-graph", not candidates)):
            if empty:
                return MatchResult("none", f"the {what} has no wall surface")
        walls = arrays(s, None, list(s.wall_surfaces))
        found = search(walls, candidates, None if start is None else partial(near_start, start))
        if not found:
            near = "" if start is None else " near the start that was given (its yaw is in radians)"
            reason = f"no wall corner of the map matches one in the plan{near}"
            return MatchResult("none", reason, seconds=_since(began))
        return _answer(found, candidates, began)


class Matcher:
    """Finds where an S-graph is in an A-graph. Create one with `Matcher.load(method)`."""

    def __init__(self, method: Method) -> None:
        self._method = method

    @staticmethod
    def load(method: str = "learned", weights: Path | str | None = None) -> "Matcher":
        """Loads a matching method by name.

        Args:
            method: One of
                `learned`: a graph network proposes matches, which are verified geometrically (the default);
                `voting`: wall corners vote for motions, which are verified; no weights, no network;
                `paper`: the published GATv2-Sinkhorn matcher; its assignment is the answer, without verification;
                `combinatorial`, `combinatorial-grid`: the search of iS-Graphs, as released and as in its later branch.
                `NAME@WEIGHTS` gives both name and weights, for example `paper@repository`.
            weights: A file of weights; for `paper` also `published` (the default) or `repository`. None loads the
                weights that come with the package.

        Returns:
            A matcher. It may be used for any number of graphs; what it computes for the last few plans is cached.

        Raises:
            UserError: The name is unknown, the method takes no weights, the file has no weights that fit, or PyTorch,
                which `paper` needs, is not installed.
        """
        name, _, named = method.partition("@")
        weights = named or weights
        methods: dict[str, Callable[[], Method]] = {
            "voting": VotingMatcher,
            "learned": lambda: _learned(weights),
            "paper": lambda: _paper(weights),
            "combinatorial": lambda: CombinatorialMatcher(DEVELOP),
            "combinatorial-grid": lambda: CombinatorialMatcher(GRID),
        }
        if name not in methods:
            raise UserError(f"no matching method '{name}'; there are: {', '.join(methods)}")
        if weights is not None and name not in WITH_WEIGHTS:
            raise UserError(f"the matching method '{name}' takes no weights; {', '.join(WITH_WEIGHTS)} do")
        if name in WITH_TORCH:
            need_torch(f"the matching method '{name}'")
        return Matcher(methods[name]())

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """Finds the place of an S-graph in an A-graph.

        Args:
            s: The S-graph of one storey, in the map frame (metres, z up).
            a: The A-graph of any number of storeys, in the BIM frame (metres).
            floor: The id of the only A floor to search; None searches all.
            start: A rough pose (yaw, x, y) of the map's origin in the BIM frame, in radians and metres, in the order
                of `T_a_s`. Placements more than 3 m or 60 degrees away from it are dropped.

        Returns:
            The match. `T_a_s` is (yaw, x, y) in radians and metres: p_a = R(yaw) p_s + (x, y). Rely on it only if the
            status is `unique`. `learned` and `voting` do not search for mirror images, but a mirrored map of many rooms
            may get a unique answer: if the map may be mirrored, match `data.scene_graph.motion.mirrored(s)` too, as
            runs do, and rely on the answer only if that one explains less. Graphs without wall surfaces, and graphs
            that cannot be in metres or whose normals point out of their rooms (see `data.scene_graph.implausible`), do
            not raise: they give the status `none` and the reason.
        """
        for what, graph in (("S-graph", s), ("A-graph", a)):
            if (wrong := implausible(graph)) is not None:
                return MatchResult("none", f"{what}: {wrong}")
        return self._method.match(s, a, floor=floor, start=start)


def _learned(weights: Path | str | None) -> Method:
    from matching.deformation import DeformableMatcher  # compiled loops are slow to import
    from matching.proposals.learned import LearnedProposer
    from matching.search.proposals import Proposals, TopK
    from matching.search.voting_proposals import voting_proposals

    network = LearnedProposer.load(weights)

    def proposed(s: SceneGraph, a: SceneGraph, known: Walls) -> Proposals:
        no_rooms = TopK.of_dense(np.zeros((len(s.rooms), 0)))
        return Proposals(network.propose(s, a, known), no_rooms)

    return DeformableMatcher(proposed, voting_proposals)


def _paper(weights: Path | str | None) -> Method:
    from matching.published.matcher import PaperMatcher

    return PaperMatcher.load(weights)


def _answer(found: list[Placement], candidates: list[Walls], began: float) -> MatchResult:
    best = found[0]
    s, a = best.pairing.s, best.storey
    pairs = [assign(p) for p in found[:LISTED]]
    verdict = verify(found, candidates, pairs[0])
    hypotheses = []
    for p, of in zip(found, pairs, strict=False):
        rooms = tuple((s.rooms[r].id, p.storey.rooms[q].id) for r, q, _ in of.rooms)
        hypotheses.append(Hypothesis(p.score, _triple(p), p.storey.floor, rooms))
    return MatchResult(
        verdict.status,
        verdict.reason,
        tuple((s.rooms[r].id, a.rooms[q].id, c * verdict.probability) for r, q, c in pairs[0].rooms),
        tuple((s.ids[i], a.ids[j], c * verdict.probability) for i, j, c in pairs[0].surfaces),
        None if verdict.status == "none" else _triple(best),
        a.floor,
        tuple(hypotheses),
        _since(began),
    )


def _triple(placement: Placement) -> tuple[float, float, float]:
    yaw, x, y = placement.T_a_s.tolist()
    return yaw, x, y


def _since(began: float) -> float:
    return time.perf_counter() - began
