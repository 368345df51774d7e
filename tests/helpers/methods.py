"""The matching methods by name, each loaded once for all tests, and plans on which all of them end quickly."""

import functools
from dataclasses import replace

import numpy as np
from plans import a_graph, box, flat

from data import SceneGraph
from matching import Matcher

METHODS = ("learned", "voting", "paper", "combinatorial")
VERIFYING = ("learned", "voting")  # they compare every place with the others before they call one unique

# no mirror image of these rooms fits them
CHIRAL = [box(0, 0, 5, 3), box(5.2, 0, 3, 4), box(0, 3.2, 3.5, 4.5), box(8.4, 0, 6, 2.5), box(3.7, 4.2, 4.3, 3),
          box(8.4, 2.7, 2.5, 5)]  # fmt: skip
SMALL = a_graph(flat(np.random.default_rng(5), 11, 8), "ground")  # six rooms


@functools.cache
def matcher(method: str) -> Matcher:
    """The method of that name."""
    return Matcher.load(method)


def as_map(plan: SceneGraph) -> SceneGraph:
    """A plan as if all of it had been seen, without noise; its ids are the plan's."""
    return replace(plan, frame="map")
