"""The methods of the matching benchmark: those of `Matcher`, `oracle`, and three ablations of the network's proposals.

The ablations verify and complete their proposals as `learned` does. `proposals-voting`: the map's corners vote, as in
`voting`. `proposals-parts`: each room with its neighbours votes too. `proposals-shuffled`: the network's proposals,
permuted over the walls.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from data import SceneGraph
from data.common.json_files import read_json
from evaluation.matching_benchmark.oracle import oracle_match
from evaluation.matching_benchmark.pairs import Prepared
from matching import Matcher
from matching.arrays import Walls
from matching.matcher import WITH_WEIGHTS
from matching.published.baselines import WEIGHTS
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


def trained_on(name: str) -> set[str]:
    """The files and folders whose plans a method's network was trained on, by the model card beside its weights; empty
    without one."""
    kind, _, weights = name.partition("@")
    if kind not in WITH_WEIGHTS:
        return set()
    path = Path(weights) if weights else WEIGHTS / f"{kind}.pt"
    cards = [card for card in (path.with_suffix(".json"), path.parent / "model_card.json") if card.is_file()]
    return set(read_json(cards[0], "the model card of a network")["data"]["files"]) if cards else set()


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
