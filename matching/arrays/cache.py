"""A cache for what is computed of a plan alone and shared by matches of many maps."""

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

from data.scene_graph import SceneGraph

T = TypeVar("T")
PLANS_CACHED = 4


class PlanCache(Generic[T]):
    """The results of a function for the last few graphs; a graph is recognised by its identity."""

    def __init__(self, work: Callable[[SceneGraph], T]) -> None:
        self._work = work
        self._known: OrderedDict[int, tuple[SceneGraph, T]] = OrderedDict()

    def __call__(self, graph: SceneGraph) -> T:
        """Returns the function's result for a graph."""
        if id(graph) not in self._known:
            self._known[id(graph)] = graph, self._work(graph)  # keeps the graph alive, so that no other gets its id
            while len(self._known) > PLANS_CACHED:
                self._known.popitem(last=False)
        self._known.move_to_end(id(graph))
        return self._known[id(graph)][1]
