"""The methods of the matching benchmark: those of `Matcher`, `oracle`, and three ablations of the network's proposals.

The ablations verify and complete their proposals as `learned` does. `proposals-voting`: the map's corners vote, as in
`voting`. `proposals-parts`: each room with its neighbours votes too. `proposals-shuffled`: the network's proposals,
permuted over the walls.
"""

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np

from data import SceneGraph
from evaluation.matching_benchmark.oracle import oracle_match
from evaluation.matching_benchmark.pairs import Prepared
from matching import Matcher
from matching.arrays import Walls
from matching.result import MatchResult
from matching.search import Proposals, TopK
from matching.self_test import make_ready

ORACLE = "oracle"  # is given the true place


@lru_cache(maxsize=8)
def load_method(name: str) -> Callable[[Prepared], MatchResult]:
    """The method with this name. Raises UserError for an unknown name."""
    if name == ORACLE:
        return lambda pair: oracle_match(pair.drawn, pair.plan.graph)
    variants: dict[str, Callable[[], Matcher]] = {
        "proposals-voting": lambda: _voting(by_parts=False), "proposals-parts": lambda: _voting(by_parts=True),
        "proposals-shuffled": _shuffled,
    }  # fmt: skip
    matcher = variants[name]() if name in variants else Matcher.load(name)
    make_ready(matcher, name)  # a new installation's machine code takes about a minute, which counts for no match
    return lambda pair: matcher.match(pair.drawn.s_graph, pair.plan.graph)


def _voting(by_parts: bool) -> Matcher:
    from matching.deformation import DeformableMatcher
    from matching.search.voting_proposals import voting_proposals

    return Matcher(DeformableMatcher(partial(voting_proposals, by_parts=by_parts)))


def _shuffled() -> Matcher:
    from matching.deformation import DeformableMatcher
    from matching.learned import LearnedProposer

    network = LearnedProposer.load()

    def propose(s: SceneGraph, a: SceneGraph, known: Walls) -> Proposals:
        proposals = network.propose(s, a, known)
        rng = np.random.default_rng(len(s.wall_surfaces))
        return Proposals(_mixed(proposals.walls, rng), _mixed(proposals.rooms, rng))

    return Matcher(DeformableMatcher(propose))


def _mixed(of: TopK, rng: np.random.Generator) -> TopK:
    order = rng.permutation(len(of.partner))
    return TopK(of.partner[order], of.score[order])
