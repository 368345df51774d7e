"""Doors as evidence: a door of the map should be one of the plan's, and doors between rooms seen should be in the map.

Walls alone are often alike, from office to office and from flat to mirrored flat; where their doors are is not. As
with walls, a door of the map is either one of the plan, off by what is marginalised over, or something else: a neck
in a room that the map took for two. Chance is a door of the plan at a random place.
"""

import numpy as np

from matching.field import Fields, Scene, motions
from matching.se2 import Array, apply
from matching.walls import Index

SIGMAS = np.array([0.15, 0.45])  # metres, of both axes
SHARES = np.array([0.75, 0.25])  # of the doors that are off by so much
NO_DOOR = 0.25  # of the map's doors are none of the plan's
OTHER_ROOMS = 0.3  # what a door counts that joins other rooms than the map's does
DENSITY = 0.06  # doors a square metre, that are met by chance
FAR_M = 5.0  # doors of the plan beyond the map's are not looked at
OPEN = 0.7  # of the plan's doors between two rooms that were seen


def door_evidence(scene: Scene, fields: Fields, homes: Index) -> Array:
    """(K,) nats of the doors; `homes` (K, R) are the A rooms, of the field's storey, of the S rooms, -1 for none."""
    if not len(scene.doors) and not any(len(d) for d in scene.plan.doors):
        return np.zeros(len(fields))
    placed = _placed(scene, fields)
    return np.array([_of_one(scene, int(fields.storey[k]), placed[k], homes[k]) for k in range(len(fields))])


def _placed(scene: Scene, fields: Fields) -> Array:
    """(K, D, 2) the map's doors, each where its rooms' motions lay it, in the mean."""
    group = np.append(scene.group_of_room, -1)[scene.doors.rooms]  # (D, 2)
    known = (group >= 0).astype(float)
    known /= np.maximum(known.sum(axis=1, keepdims=True), 1.0)
    moved = apply(motions(scene, fields.state)[:, group], scene.doors.place[:, None])
    return np.einsum("kdrc,dr->kdc", moved, known)


def _of_one(scene: Scene, storey: int, placed: Array, home: Index) -> float:
    plan = scene.plan.doors[storey]
    home = np.append(home, -1)
    total = 0.0
    if len(placed):
        low, high = placed.min(axis=0) - FAR_M, placed.max(axis=0) + FAR_M
        of_homes = np.isin(plan.rooms, home[home >= 0]).all(axis=1)
        plan = plan[np.flatnonzero(((plan.place > low) & (plan.place < high)).all(axis=1) | of_homes)]
    seen = np.zeros(len(plan), dtype=bool)
    if len(placed) and len(plan):
        off = np.hypot(*np.moveaxis(placed[:, None] - plan.place, -1, 0))[..., None]  # (D, M, 1)
        density = np.exp(-0.5 * (off / SIGMAS) ** 2) / (2 * np.pi * SIGMAS**2) @ SHARES
        here, there = np.sort(home[scene.doors.rooms], axis=1), np.sort(plan.rooms, axis=1)
        same = (here[:, None] == there).all(axis=-1)
        density *= np.where(same, 1.0, OTHER_ROOMS)
        total += float(np.log(NO_DOOR + (1 - NO_DOOR) * density.max(axis=1) / DENSITY).sum())
        seen[density.argmax(axis=1)[density.max(axis=1) > DENSITY]] = True
    elif len(placed):
        total += len(placed) * float(np.log(NO_DOOR))
    between = np.isin(plan.rooms, home[home >= 0]).all(axis=1)
    return total + float(np.log(np.where(seen, OPEN, 1 - OPEN)[between] / 0.5).sum())
