"""Doors as evidence: a map's door should be one of the plan's, and doors between observed rooms should be in the map.

Walls alone are often alike, from office to office and from a flat to its mirror image; doors are not. As with walls, a
door of the map is either one of the plan, with a deviation that is marginalised over, or something else, such as a
narrow passage in a room that the map took for two. Chance is a door of the plan at a random place.
"""

import numpy as np

from data.common.compiled import compiled
from data.geometry import se2
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.engine.field import Fields, Scene

SIGMAS = np.array([0.15, 0.45])  # metres, of both axes
SHARES = np.array([0.75, 0.25])  # prior of each deviation
NO_DOOR = 0.25  # share of the map's doors that are not in the plan
OTHER_ROOMS = 0.3  # weight of a door that joins other rooms than the map's door
DENSITY = 0.06  # doors per square metre, by chance
FAR_M = 4.5  # more distant doors are ignored: ten deviations
OPEN = 0.7  # of the plan's doors between two rooms that were seen


def door_evidence(scene: Scene, fields: Fields, homes: Index) -> Array:
    """(K,) nats of the doors; `homes` (K, R) are the A rooms of the S rooms, in the field's storey, -1 for none."""
    if not len(scene.doors) and not any(len(d) for d in scene.plan.doors):
        return np.zeros(len(fields))
    nats, own = [], scene.doors
    for k, storey in enumerate(fields.storey.tolist()):
        plan, rooms = scene.plan.doors[storey], len(scene.plan.storeys[storey].rooms)
        nats.append(_of_one(placed_doors(scene, fields.state[k]), own.rooms, homes[k], plan.place, plan.rooms, rooms))
    return np.array(nats)


def placed_doors(scene: Scene, state: Array) -> Array:
    """(D, 2) the map's doors, placed by the mean motion of their rooms in a field (G, 3)."""
    doors = scene.doors
    group, known = scene.group_of_room[doors.rooms], doors.rooms >= 0
    placed = se2.rotate(state[group, 0], doors.place[:, None] - scene.groups.centre[group]) + state[group, 1:]
    share = known / np.maximum(known.sum(axis=1, keepdims=True), 1)
    return np.asarray((share[..., None] * placed).sum(axis=1))


@compiled
def _of_one(placed: Array, doors: Index, home: Index, plan: Array, plan_rooms: Index, rooms: int) -> float:
    """Nats of the map's doors, placed at `placed` (D, 2) between rooms `doors` (D, 2).

    The storey has doors at `plan` (M, 2) between its rooms (M, 2).
    """
    seen, is_home, total = np.zeros(len(plan), dtype=np.bool_), np.zeros(rooms + 1, dtype=np.bool_), 0.0
    for room in home:
        is_home[room] |= room >= 0
    for d in range(len(doors)):
        here = home[doors[d, 0]] if doors[d, 0] >= 0 else -1
        there = home[doors[d, 1]] if doors[d, 1] >= 0 else -1
        most, best = 0.0, -1
        for m in range(len(plan)):
            square = (placed[d, 0] - plan[m, 0]) ** 2 + (placed[d, 1] - plan[m, 1]) ** 2
            if square < FAR_M**2:
                density = 0.0
                for n in range(len(SIGMAS)):
                    density += SHARES[n] * np.exp(-0.5 * square / SIGMAS[n] ** 2) / (2 * np.pi * SIGMAS[n] ** 2)
                one, other = plan_rooms[m, 0], plan_rooms[m, 1]
                same = (here == one and there == other) or (here == other and there == one)
                density *= 1.0 if same else OTHER_ROOMS
                if density > most:
                    most, best = density, m
        total += np.log(NO_DOOR + (1 - NO_DOOR) * most / DENSITY)
        if most > DENSITY:
            seen[best] = True
    for m in range(len(plan)):
        if is_home[plan_rooms[m, 0]] and is_home[plan_rooms[m, 1]]:
            total += np.log((OPEN if seen[m] else 1 - OPEN) / 0.5)
    return total
