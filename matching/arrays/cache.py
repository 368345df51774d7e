"""What is worked out of a plan alone is worked out once: matches of many maps with one plan share it."""

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

from data.scene_graph import SceneGraph

T = TypeVar("T")
PLANS_CACHED = 4


class PlanCache(Generic[T]):
    """The results of a function of a graph, for the last few graphs; a graph is known by its identity."""

    def __init__(self, work: Callable[[SceneGraph], T]) -> None:
        self._work = work
        self._known: OrderedDict[int, tuple[SceneGraph, T]] = OrderedDict()

    def __call__(self, graph: SceneGraph) -> T:
        """As the function."""
        if id(graph) not in self._known:
            self._known[id(graph)] = graph, self._work(graph)  # the graph is held, so that no other takes its identity
            while len(self._known) > PLANS_CACHED:
                self._known.popitem(last=False)
        self._known.move_to_end(id(graph))
        return self._known[id(graph)][1]
