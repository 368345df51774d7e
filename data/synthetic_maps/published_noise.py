"""The perturbation with which the published matcher was trained and evaluated, as in its public code.

(snt-arg, graph_matching_gnn and situational_graphs_datasets: room and wall dropout, global noise, local noise.) Rooms
are dropped independently, with their walls, so the rest need not be connected. The rotation is about the origin of the
A-graph's own frame; lengths and room positions are exact.
"""

import numpy as np
import shapely

from data.geometry import se2
from data.geometry.se2 import Array
from data.synthetic_maps.exploration import Index, Storey
from data.synthetic_maps.wall_noise import ObservedWalls

DROPPED = 0.15  # of the rooms, and of the walls of those that are left
SHIFT = 0.01  # m: the width of the uniform shift of the whole graph along each axis,
LOCAL_SHIFT = 0.01  # and of each wall's centre;
LOCAL_TURN = float(np.radians(0.012 * 360))  # and of each wall's normal


def surviving_rooms(storey: Storey, rng: np.random.Generator) -> Index:
    """Returns the remaining rooms, at least one of those that have walls."""
    walled = np.flatnonzero([len(w) > 0 for w in storey.walls_of])
    while True:
        kept = walled[rng.random(len(walled)) >= DROPPED]
        if len(kept):
            return kept


def surviving_walls(storey: Storey, rooms: Index, rng: np.random.Generator) -> ObservedWalls:
    """Returns the remaining walls of these rooms, with local noise.

    A wall drawn for dropout is only dropped if more than one of it and its two neighbours in the room's ring remain.
    """
    kept = []
    for room in rooms.tolist():
        ring = _ring(storey, room)
        left = np.ones(len(ring), dtype=bool)
        for k in np.flatnonzero(rng.random(len(ring)) < DROPPED).tolist():
            around = {k, k - 1 if k else len(ring) - 1, (k + 1) % len(ring)}
            left[k] = left[list(around)].sum() <= 1
        kept.append(ring[left])
    wall = np.concatenate(kept)
    centre = storey.centre[wall] + LOCAL_SHIFT * (rng.random((len(wall), 2)) - 0.5)
    heading = storey.heading[wall] + LOCAL_TURN * (rng.random(len(wall)) - 0.5)
    return ObservedWalls(wall, storey.room[wall], centre, heading, storey.length[wall])


def global_noise(rng: np.random.Generator) -> Array:
    """(3,) T_map_a: a shift by at most 5 mm along each axis, then a random rotation about the origin."""
    yaw = rng.uniform(0, 2 * np.pi)
    return np.array([se2.wrap(np.array(yaw)), *se2.rotate(yaw, SHIFT * (rng.random(2) - 0.5))])


def _ring(storey: Storey, room: int) -> Index:
    """A room's walls in order around the room."""
    walls = storey.walls_of[room]
    area = storey.areas[room]
    if area is not None and area.geom_type == "Polygon":
        return walls[np.argsort(shapely.line_locate_point(area.exterior, shapely.points(storey.centre[walls])))]
    around = storey.centre[walls] - storey.middle[room]
    return walls[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]
