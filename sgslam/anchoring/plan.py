"""The plan in which a map is anchored."""

import numpy as np
from numpy.typing import NDArray

from data import LevelSurface, SceneGraph

Floats = NDArray[np.float64]


class Plan:
    """An A-graph in the BIM frame. `partial`: it is the map of an earlier run and lacks rooms that were not visited.

    The factor graph uses a local frame, the BIM frame moved by `origin` (3,) into the building: a site may lie
    kilometres from zero, and priors at zero hold poorly that far away.
    """

    def __init__(self, a_graph: SceneGraph, partial: bool = False) -> None:
        self.a_graph, self.partial = a_graph, partial
        self.count = len({surface.floor for surface in a_graph.wall_surfaces})  # of storeys
        self._elevations = {floor.id: floor.elevation for floor in a_graph.floors if floor.elevation is not None}
        self.origin: Floats = np.array([*a_graph.centroid(), min(self._elevations.values(), default=0.0)])
        self._shift = np.array([0.0, *self.origin[:2]])
        self._storeys: dict[str | None, SceneGraph] = {None: a_graph}

    def storey(self, storey: str | None) -> SceneGraph:
        """The A-graph of a storey by its id; the whole A-graph for None."""
        if storey not in self._storeys:
            self._storeys[storey] = self.a_graph.on_floor(storey)
        return self._storeys[storey]

    def height(self, storey: str | None) -> float:
        """Height (m) of a storey's floor in the local frame; 0 where the plan does not give it."""
        elevation = None if storey is None else self._elevations.get(storey)
        return 0.0 if elevation is None else elevation - float(self.origin[2])

    def levels(self, storey: str | None) -> tuple[LevelSurface, ...]:
        """The level surfaces of a storey; where the plan has none, its floor at its elevation, if that is known."""
        graph = self.storey(storey)
        if graph.level_surfaces or storey not in self._elevations or not graph.wall_surfaces:
            return graph.level_surfaces
        ends = np.array([end for surface in graph.wall_surfaces for end in surface.ends()])
        (x0, y0), (x1, y1) = ends.min(axis=0).tolist(), ends.max(axis=0).tolist()
        corners = (x0, y0), (x1, y0), (x1, y1), (x0, y1)
        return (LevelSurface(storey, (0.0, 0.0, 1.0, -self._elevations[storey]), corners, floor=storey),)

    def T_a_s(self, place: Floats) -> Floats:  # noqa: N802
        """(3,) yaw x y in the BIM frame of a place (3,) in the local frame."""
        return np.asarray(place + self._shift)

    def in_local(self, T_a_s: tuple[float, float, float]) -> Floats:
        """(3,) the place in the local frame of one in the BIM frame."""
        return np.asarray(np.array(T_a_s) - self._shift)
