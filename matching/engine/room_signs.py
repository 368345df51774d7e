"""What tells whether a room of the map is named right: where the map drifts, a room may come to lie on its neighbour's
place, and fit there as well.
"""

import numpy as np

from data.common.compiled import compiled
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.engine.assignment import Matches
from matching.engine.field_loops import Loops, compared, sharpness, turns, wall_poses
from matching.engine.guided_field import strain
from matching.engine.hypotheses import Hypotheses

ASIDE = np.arange(-1.2, 1.3, 0.3)  # metres, along both axes of the plan: how far a room may have drifted
SIGMA = 0.15  # metres across: half a step
LEAST = 0.1  # share of a room's walls that any place explains


def room_signs(found: Hypotheses, rooms: Matches) -> Array:
    """(R, 3) of the first hypothesis' pairs of rooms: the logarithms of their share, of how much better the S room fits
    into this A room than into any other one nearby, and of one plus its mean chi^2 to its neighbours.
    """
    scene, a = found.scene, found.scene.plan
    r, q, share = (np.array(column) for column in zip(*rooms, strict=True)) if rooms else np.zeros((3, 0), int)
    most = np.zeros((len(scene.s.rooms), a.room.max() + 2))  # the last is for walls without a room
    fit = _fits(scene.loops, found.fields.state[0], found.table[0], scene.s.room, a.room, most)[r, :-1]
    own = fit[np.arange(len(r)), q]
    fit[np.arange(len(r)), q] = 0.0
    margin = np.log((own + LEAST) / (fit.max(axis=1, initial=0.0) + LEAST))
    strained = strain(scene, found.fields.state[:1])[0, scene.group_of_room[r]]
    return np.stack((np.log(share), margin, np.log1p(strained)), axis=-1)


@compiled
def _fits(m: Loops, state: Array, table: Index, room: Index, a_room: Index, most: Array) -> Array:
    """`most` (S rooms, A rooms), zeros before: the share of an S room's walls, by length, that lie on walls of an A
    room, where it is most if the S room moves aside.
    """
    pose, sharp = wall_poses(m, state, turns(state)), sharpness(SIGMA)
    rooms, width = most.shape
    here, best, at = np.zeros(width), np.zeros(width), pose.copy()
    for r in range(rooms):
        length = 0.0
        for i in range(len(room)):
            length += m.half[i] if room[i] == r else 0.0
        for x in ASIDE:
            for y in ASIDE:
                for i in range(len(room)):
                    if room[i] != r:
                        continue
                    at[i, 1], at[i, 2] = pose[i, 1] + x, pose[i, 2] + y
                    for j in table[i]:
                        if j >= 0:
                            across, _, turned, beside = compared(m.lines, j, m.half[i], at, i)
                            quality = beside * np.exp(-sharp[0] * across**2 - sharp[1] * turned**2)
                            best[a_room[j]] = max(best[a_room[j]], quality)
                    for j in table[i]:
                        if j >= 0:
                            here[a_room[j]] += m.half[i] * best[a_room[j]]
                            best[a_room[j]] = 0.0
                for q in range(width):
                    most[r, q], here[q] = max(most[r, q], here[q]), 0.0
        for q in range(width):
            most[r, q] /= length
    return most
