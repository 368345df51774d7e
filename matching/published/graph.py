"""Scene graphs for the published matcher: one node per room or wall surface, seven features, directed edges.

Sections III-A and V of the paper.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import SceneGraph
from data.synthetic_maps.exploration import storeys_of

FEATURES = 7
NO_LENGTH = -1.0


@dataclass(frozen=True)
class PaperGraph:
    """N nodes, rooms first, in the order of the scene graph; messages go from `edges[0]` to `edges[1]`."""

    ids: tuple[str, ...]
    rooms: int
    features: NDArray[np.float64]  # (N, 7): is room, is wall surface, x, y, normal x, normal y, length or -1; metres
    edges: NDArray[np.int64]  # (2, E)


def paper_graph(graph: SceneGraph) -> PaperGraph:
    """Returns the nodes and edges of a scene graph, in its own frame.

    Edges go from a room to its wall surfaces, both ways between rooms that share a wall (antiparallel sides near each
    other), and in a ring between the wall surfaces of a room, counter-clockwise about its centre.
    """
    ids = [r.id for r in graph.rooms] + [w.id for w in graph.wall_surfaces]
    node = {name: k for k, name in enumerate(ids)}
    edges = {(node[w.room], node[w.id]) for w in graph.wall_surfaces if w.room is not None}
    for storey in storeys_of(graph):
        rooms = [node[r.id] for r in storey.rooms]
        edges |= {(rooms[i], rooms[j]) for i, others in enumerate(storey.across_walls) for j in others}
        for middle, walls in zip(storey.middle, storey.walls_of, strict=True):
            around = storey.centre[walls] - middle
            order = walls[np.argsort(np.arctan2(around[:, 1], around[:, 0]), kind="stable")]
            ring = [node[storey.ids[k]] for k in order]
            edges |= {(i, j) for i, j in zip(ring, ring[1:] + ring[:1], strict=True) if i != j}
    rows = [(1.0, 0.0, *r.centroid, 0.0, 0.0, NO_LENGTH) for r in graph.rooms]
    rows += [(0.0, 1.0, *w.centroid, *w.normal, w.length or NO_LENGTH) for w in graph.wall_surfaces]
    features = np.array(rows, dtype=float).reshape(-1, FEATURES)
    return PaperGraph(tuple(ids), len(graph.rooms), features, np.array(sorted(edges), dtype=np.int64).reshape(-1, 2).T)
