"""The doors of a storey, or of a map, beside its walls."""

from dataclasses import dataclass

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.arrays.walls import Index, Walls


@dataclass(frozen=True)
class Doors:
    """N doors between rooms, in the own frame of the walls."""

    place: Array  # (N, 2)
    rooms: Index  # (N, 2) indices into the walls' rooms; -1 where a door leads out, or to a room without walls

    def __getitem__(self, chosen: Index) -> "Doors":
        return Doors(self.place[chosen], self.rooms[chosen])

    def __len__(self) -> int:
        return len(self.rooms)


def doors(graph: SceneGraph, walls: Walls) -> Doors:
    """The doors of a graph that lead into a room of these walls."""
    index = {room.id: n for n, room in enumerate(walls.rooms)}
    joined = [(*(index.get(r, -1) for r in door.rooms[:2]), -1, -1)[:2] for door in graph.doors]
    rooms = np.array(joined, dtype=np.int64).reshape(-1, 2)
    place = np.array([door.centroid for door in graph.doors], dtype=float).reshape(-1, 2)
    here = (rooms >= 0).any(axis=1)
    return Doors(se2.apply(se2.inverse(walls.T_graph_own), place[here]), rooms[here])
