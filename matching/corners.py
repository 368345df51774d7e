"""The corners that vote, as `voting.marks` finds them, of storeys of thousands of walls: room by room."""

import numpy as np

from matching import se2
from matching.voting import REACH, Marks
from matching.walls import Index, Walls

LEAST_SINE = np.sin(np.radians(30))


def corners(walls: Walls) -> Marks:
    """Where two walls of a room meet, or a wall without a room meets any; each corner has one heading."""
    i, k = _candidates(walls)
    turn = se2.wrap(walls.heading[k] - walls.heading[i])
    i, k, turn = np.where(turn > 0, i, k), np.where(turn > 0, k, i), np.abs(turn)
    sine = np.sin(turn)
    steep = sine > LEAST_SINE
    i, k, turn, sine = i[steep], k[steep], turn[steep], sine[steep]
    step = walls.centre[k] - walls.centre[i]
    along = np.sum(step * walls.normal[k], axis=-1) / sine
    back = np.sum(step * walls.normal[i], axis=-1) / sine
    met = (np.abs(np.abs(along) - walls.half[i]) < REACH) & (np.abs(np.abs(back) - walls.half[k]) < REACH)
    i, k, turn, along, back = i[met], k[met], turn[met], along[met], back[met]
    point = walls.centre[i] + along[:, None] * walls.tangent[i]
    kind = 2 * (along > 0) + (back > 0)
    return Marks(point, walls.heading[i] + turn / 2, turn, kind.astype(np.int64))


def pairs_within(group: Index) -> tuple[Index, Index]:
    """All pairs of indices that have one group, each once."""
    order = np.argsort(group, kind="stable")
    first = np.searchsorted(group[order], np.unique(group))
    size = np.diff(np.append(first, len(order)))
    pairs = [np.triu_indices(n, 1) for n in size]
    i, k = (np.concatenate([order[f + p[end]] for f, p in zip(first, pairs, strict=True)]) for end in (0, 1))
    return i, k


def _candidates(walls: Walls) -> tuple[Index, Index]:
    housed, stray = np.flatnonzero(walls.room >= 0), np.flatnonzero(walls.room < 0)
    if not len(stray):
        return pairs_within(walls.room)
    apart = np.linalg.norm(walls.centre[stray][:, None] - walls.centre[None], axis=-1)
    near = apart < walls.half[stray][:, None] + walls.half + 2 * REACH
    near[np.arange(len(stray)), stray] = False
    near[:, stray] &= stray[:, None] < stray[None]
    i, k = np.nonzero(near)
    if not len(housed):
        return stray[i], k
    of_rooms = pairs_within(walls.room[housed])
    return np.append(housed[of_rooms[0]], stray[i]), np.append(housed[of_rooms[1]], k)
