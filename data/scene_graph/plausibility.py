"""What is wrong with a scene graph that has the right form: lengths in another unit, normals that point outwards."""

import numpy as np

from data.scene_graph.graph import SceneGraph
from data.scene_graph.nodes import WallSurface

_LONGEST_MEDIAN = 50.0  # m; drawn and real graphs have 1 to 10, in centimetres 80 and more
_FEWEST = 4  # walls; fewer say nothing about all


def implausible(graph: SceneGraph) -> str | None:
    """Returns what seems to be wrong with a graph, in one line; None if nothing does.

    Lengths seem to be in millimetres or centimetres if half of the walls are longer than 50 m or, if no length is
    known, farther than that from their room's centroid. Normals seem to be flipped if there are at least four walls
    with a room, more than half of them face away from its centroid, and the sum over all walls of length times distance
    to the centroid along the normal is negative: around a room of any shape it is twice the floor area (divergence
    theorem).
    """
    walls = [w for w in graph.wall_surfaces if w.room is not None]
    inwards = np.array([_towards_centroid(graph, wall) for wall in walls])
    lengths = [w.length for w in graph.wall_surfaces if w.length is not None]
    sizes = lengths or np.abs(inwards).tolist()
    if sizes and (median := float(np.median(sizes))) > _LONGEST_MEDIAN:
        what = "the median wall is" if lengths else "the median wall is, from its room's centroid,"
        return f"{what} {median:.0f} m; its lengths seem to be in millimetres or centimetres, give metres"
    outwards = int(np.count_nonzero(inwards < 0))
    area = float(inwards @ [w.length or 1.0 for w in walls]) / 2 if walls else 0.0
    if len(walls) >= _FEWEST and 2 * outwards > len(walls) and area < 0:
        return f"the normals of {outwards} of {len(walls)} walls point out of the room they bound; flip them"
    return None


def _towards_centroid(graph: SceneGraph, wall: WallSurface) -> float:
    """How far (m) the centroid of the wall's room is before the wall; negative behind it."""
    (x, y), (cx, cy), (nx, ny) = wall.centroid, graph.room_by_id[wall.room or ""].centroid, wall.normal
    return (cx - x) * nx + (cy - y) * ny
