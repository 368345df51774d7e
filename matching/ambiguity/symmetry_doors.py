"""Doors as evidence for or against a symmetric place: it should have the same doors, and no others."""

from dataclasses import dataclass

import numpy as np

from data import SceneGraph
from data.geometry import se2
from data.geometry.se2 import Array
from data.synthetic_maps.noise_models import SIGMA_DOOR, DrawnGraph
from data.synthetic_maps.room_noise import DOOR_MISSING
from matching.ambiguity.symmetry_evidence import Part, PlacedPart
from matching.arrays import Doors, Index, Walls
from matching.arrays.doors import doors

NO_DOOR = 3.0  # nats: a neck within a room may be taken for a door
NEAR = 1.0  # m from a door of the plan: further off it is none of the plan's
SAME = 3 * SIGMA_DOOR  # m


@dataclass(frozen=True, eq=False)
class ObservedDoors:
    """The plan's doors that are in the map, in the own frame of a part's walls, and the groups beside them."""

    place: Array  # (D, 2)
    group: Index  # (D, 2), -1 for none


def observed_doors(drawn: DrawnGraph, a: SceneGraph, part: Part) -> ObservedDoors:
    """Returns the doors of the A-graph that match doors of the S-graph."""
    plan = [d for d in a.doors if len(d.rooms) == 2]
    group_of = {part.walls.rooms[r].id: int(g) for r, g in zip(part.walls.room, part.group, strict=True) if r >= 0}
    found: dict[str, tuple[Array, list[int]]] = {}
    for door in drawn.s_graph.doors:
        rooms = {drawn.rooms[r] for r in door.rooms if r in drawn.rooms}
        here = [d for d in plan if set(d.rooms) == rooms]
        motion = np.array(drawn.T_a_s_by_room.get(door.rooms[0], drawn.T_a_s))
        off = [float(np.hypot(*(se2.apply(motion, np.array(door.centroid)) - d.centroid))) for d in here]
        if off and min(off) < NEAR:
            true = here[int(np.argmin(off))]
            found[true.id] = np.array(true.centroid), [group_of.get(r, -1) for r in true.rooms]
    place = np.array([p for p, _ in found.values()], dtype=float).reshape(-1, 2)
    return ObservedDoors(
        se2.apply(se2.inverse(part.walls.T_graph_own), place),
        np.array([g for _, g in found.values()], dtype=np.int64).reshape(-1, 2),
    )


def doors_at_home(seen: ObservedDoors, part: Part, a: SceneGraph, home: Walls, rooms: Index) -> float:
    """Nats (at most 0) for which doors between the entered rooms are in the map."""
    T_home_part = se2.compose(se2.inverse(home.T_graph_own), part.walls.T_graph_own)
    return _completeness(doors(a, home), rooms, se2.apply(T_home_part, seen.place))


def doors_there(
    seen: ObservedDoors, part: Part, placed_part: PlacedPart, a: SceneGraph, storey: Walls, rooms: Index
) -> float:
    """Nats (at least 0) against the place of a part in these rooms of a storey."""
    plan, at = doors(a, storey), _placed(seen, part, placed_part)
    off = np.hypot(*np.moveaxis(at[:, None] - plan.place, -1, 0)).min(axis=1, initial=np.inf)
    return float(np.minimum(0.5 * (off / SIGMA_DOOR) ** 2, NO_DOOR).sum() - _completeness(plan, rooms, at))


def _placed(seen: ObservedDoors, part: Part, placed_part: PlacedPart) -> Array:
    """(D, 2) the doors in the storey's own frame, by the mean motion of the groups beside each."""
    known = (seen.group >= 0).astype(float)
    known = np.where(known.any(axis=1, keepdims=True), known, 1.0)
    state = placed_part.state[seen.group]
    moved = se2.rotate(state[..., 0], seen.place[:, None] - part.centre[seen.group]) + state[..., 1:]
    return np.asarray(np.einsum("drc,dr->dc", moved, known / known.sum(axis=1, keepdims=True)))


def _completeness(plan: Doors, rooms: Index, seen: Array) -> float:
    """Nats for which doors between the rooms were observed and which were not."""
    between = (plan.rooms >= 0).all(axis=1) & np.isin(plan.rooms, rooms).all(axis=1)
    off = np.hypot(*np.moveaxis(plan.place[between, None] - seen, -1, 0)).min(axis=1, initial=np.inf)
    return float(np.log(np.where(off < SAME, 1 - DOOR_MISSING, DOOR_MISSING)).sum())
