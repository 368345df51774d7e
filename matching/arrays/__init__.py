"""Scene graphs as numpy arrays: walls, doors, neighbours."""

from matching.arrays.cache import PlanCache
from matching.arrays.doors import Doors
from matching.arrays.walls import Index, Walls, arrays, storeys

__all__ = [
    "Doors",
    "Index",
    "PlanCache",
    "Walls",
    "arrays",
    "storeys",
]
