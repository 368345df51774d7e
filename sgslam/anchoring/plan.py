"""The plan that a map is anchored to: the A-graph, its storeys, and the local frame of the factor graph."""

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.anchoring.free_space_conflict import conflict_share
from sgslam.anchoring.place_verification import WITHDRAWAL_CONFLICT

Floats = NDArray[np.float64]


class Plan:
    """An A-graph in the BIM frame. `partial`: it is the map of an earlier run and lacks rooms that were not visited.

    The factor graph uses a local frame, the BIM frame moved by `origin` (3,) into the building: a site may lie
    kilometres from zero, and priors at zero hold poorly that far away.
    """

    def __init__(self, a_graph: SceneGraph, partial: bool = False) -> None:
        self.a_graph, self.partial = a_graph, partial
        elevations = [floor.elevation for floor in a_graph.floors if floor.elevation is not None]
        self.origin: Floats = np.array([*a_graph.centroid(), min(elevations, default=0.0)])
        self._storeys: dict[str, SceneGraph] = {}

    def storey(self, storey: str | None) -> SceneGraph:
        """The A-graph of a storey by its id, always the same object; the whole A-graph for None."""
        if storey is None:
            return self.a_graph
        if storey not in self._storeys:
            self._storeys[storey] = self.a_graph.on_floor(storey)
        return self._storeys[storey]

    def height(self, storey: str | None) -> float | None:
        """Height (m) of a storey's floor in the local frame; None where the plan does not give it."""
        elevation = next((f.elevation for f in self.a_graph.floors if f.id == storey), None)
        return None if elevation is None else elevation - float(self.origin[2])

    def T_a_s(self, place: Floats) -> Floats:  # noqa: N802
        """(3,) yaw x y in the BIM frame of a place (3,) in the local frame."""
        return np.asarray(place + np.array([0.0, *self.origin[:2]]))

    def conflicts(self, s: SceneGraph, place: Floats, storey: str | None) -> bool:
        """Whether a partial plan and an S-graph at `place` (3,), T_local_level, have walls in each other's free space.

        False for a complete plan, which is not checked.
        """
        return self.partial and conflict_share(s, self.storey(storey), self.T_a_s(place)) > WITHDRAWAL_CONFLICT
