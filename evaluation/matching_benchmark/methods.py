"""The methods of the matching benchmark: those of `Matcher`, and three ablations of the network's proposals.

The ablations verify and complete their proposals as `learned` does. `proposals-voting`: the map's corners vote, as in
`voting`. `proposals-parts`: each room with its neighbours votes too. `proposals-shuffled`: the network's proposals,
permuted over the walls.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from data import SceneGraph
from matching import Matcher
from matching.arrays import Walls
from matching.search import Proposals, TopK


def load_method(name: str) -> Matcher:
    """The matcher with this name. Raises UserError for an unknown name."""
    variants: dict[str, Callable[[], Matcher]] = {
        "proposals-voting": lambda: _voting(by_parts=False), "proposals-parts": lambda: _voting(by_parts=True),
        "proposals-shuffled": _shuffled,
    }  # fmt: skip
    return variants[name]() if name in variants else Matcher.load(name)


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
