"""Scene graphs as numpy arrays: walls, doors, neighbours."""

from matching.arrays.walls import Doors, Index, PlanCache, Walls, arrays, storeys

__all__ = ["Doors", "Index", "PlanCache", "Walls", "arrays", "storeys"]
