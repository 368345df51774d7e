"""Scene graphs for the published matcher: one node per room or wall surface, seven features, directed edges.

"Learning-Based Hierarchical Scene Graph Matching for Robot Localization Leveraging Prior Maps" (Ndulue,
Millan-Romera, et al.), sections III-A and V: the features and edges of the text (`paper`) or of the public code
(`code`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from data.scene_graph import SceneGraph
from data.synthetic_maps.exploration import Storey, storeys_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
EDGES = ("paper", "code")
WITHOUT = ("rooms", "ring", "mlp")  # parts that the ablation removes: two kinds of edges, the encoder before them
FEATURES = 7
NO_LENGTH = -1.0


@dataclass(frozen=True)
class PaperGraph:
    """N nodes, rooms first, in the order of the scene graph; messages go from `edges[0]` to `edges[1]`."""

    ids: tuple[str, ...]
    rooms: int
    features: Array  # (N, 7): is room, is wall surface, x, y, normal x, normal y, length or -1; metres
    edges: Index  # (2, E)


def paper_graph(graph: SceneGraph, edges: str = "paper", without: Sequence[str] = ()) -> PaperGraph:
    """Returns the nodes and edges of a scene graph, in its own frame.

    Edges go from a room to its wall surfaces, between rooms, and in a ring between the wall surfaces of a room. In
    `paper`, rooms are joined both ways if they share a wall (antiparallel sides near each other), and the ring follows
    the angle about the room's centre, counter-clockwise. In `code`, rooms are joined if a door or passage joins them,
    from the earlier to the later in the graph, and the ring follows the room's polygon, its last edge from the first
    surface to the last; a room without a polygon uses the angle, from its first surface. (The published S-graphs are
    copies of the plan in its order, which a robot does not know.) `without` names kinds of edges to leave out: `rooms`,
    `ring`.
    """
    ids = [r.id for r in graph.rooms] + [w.id for w in graph.wall_surfaces]
    node = {name: k for k, name in enumerate(ids)}
    pairs = [(node[w.room], node[w.id]) for w in graph.wall_surfaces if w.room is not None]
    for storey in storeys_of(graph):
        if "rooms" not in without:
            near = _across_walls(storey) if edges == "paper" else _through_doors(storey)
            pairs += [(node[storey.rooms[i].id], node[storey.rooms[j].id]) for i, j in near]
        if "ring" not in without:
            for room in range(len(storey.rooms)):
                steps = _by_angle(storey, room) if edges == "paper" else _along_polygon(storey, room)
                pairs += [(node[storey.ids[i]], node[storey.ids[j]]) for i, j in steps]
    joined = np.array(sorted(set(pairs)), dtype=np.int64).reshape(-1, 2).T
    return PaperGraph(tuple(ids), len(graph.rooms), _features(graph), joined)


def _features(graph: SceneGraph) -> Array:
    rooms = [(1.0, 0.0, *r.centroid, 0.0, 0.0, NO_LENGTH) for r in graph.rooms]
    walls = [(0.0, 1.0, *w.centroid, *w.normal, w.length or NO_LENGTH) for w in graph.wall_surfaces]
    return np.array(rooms + walls, dtype=float).reshape(-1, FEATURES)


def _across_walls(storey: Storey) -> list[tuple[int, int]]:
    return [(i, j) for i, others in enumerate(storey.across_walls) for j in others]


def _through_doors(storey: Storey) -> list[tuple[int, int]]:
    return [(i, j) for i, others in enumerate(storey.by_door) for j in others if i < j]


def _by_angle(storey: Storey, room: int) -> list[tuple[int, int]]:
    walls = _angular(storey, room).tolist()
    return list(zip(walls, walls[1:] + walls[:1], strict=True)) if len(walls) > 1 else []


def _along_polygon(storey: Storey, room: int) -> list[tuple[int, int]]:
    walls, area = storey.walls_of[room], storey.areas[room]
    if area is not None and area.geom_type == "Polygon":
        places = shapely.line_locate_point(area.exterior, shapely.points(storey.centre[walls]))
        ring = walls[np.argsort(places)].tolist()
    else:
        ring = _angular(storey, room).tolist()
        first = ring.index(min(ring)) if ring else 0
        ring = ring[first:] + ring[:first]
    steps = list(pairwise(ring))
    return [*steps, (ring[0], ring[-1])] if len(ring) > 2 else steps


def _angular(storey: Storey, room: int) -> Index:
    walls = storey.walls_of[room]
    around = storey.centre[walls] - storey.middle[room]
    return walls[np.argsort(np.arctan2(around[:, 1], around[:, 0]), kind="stable")]
