"""The methods of the matching benchmark: the matcher's own, and two that show what the network's proposals are worth.

Both lay proposals into the plan, verify and complete them as `learned` does. `proposals-voting`: the proposals are
those that corners vote for; `proposals-shuffled`: they are the network's, each wall's given to another wall.
"""

from collections.abc import Callable

import numpy as np

from data import SceneGraph
from matching import Matcher
from matching.proposals import Proposals, TopK


def load_method(name: str) -> Matcher:
    """The matcher of a name; raises UserError for one that does not exist."""
    arms: dict[str, Callable[[], Matcher]] = {"proposals-voting": _voting, "proposals-shuffled": _shuffled}
    return arms[name]() if name in arms else Matcher.load(name)


def _voting() -> Matcher:
    from matching.bent_matcher import BentMatcher
    from matching.voting_proposals import voting_proposals

    return Matcher(BentMatcher(voting_proposals))


def _shuffled() -> Matcher:
    from matching.bent_matcher import BentMatcher
    from matching.learned import LearnedProposer  # torch is slow to import

    network = LearnedProposer.load()

    def propose(s: SceneGraph, a: SceneGraph) -> Proposals:
        proposals = network.propose(s, a)
        rng = np.random.default_rng(len(s.wall_surfaces))
        return Proposals(_mixed(proposals.walls, rng), _mixed(proposals.rooms, rng))

    return Matcher(BentMatcher(propose))


def _mixed(of: TopK, rng: np.random.Generator) -> TopK:
    order = rng.permutation(len(of.partner))
    return TopK(of.partner[order], of.score[order])
