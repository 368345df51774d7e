"""Rooms and wall surfaces matched under a field of motions: each surface under its own room's motion."""

from dataclasses import dataclass

import numpy as np

from matching import se2
from matching.bent import Bent
from matching.complete import LEAST_QUALITY, Pairs
from matching.field import judge, motions
from matching.se2 import Array
from matching.walls import Walls

SIGMA = 0.15  # metres across
LEAST_SHARE = 0.25  # of an S room's walls, by length, that lie in its A room
PART_SHARE = 0.2  # of a room's walls in another A room: it may be two rooms in one
OTHER_ROOM = 0.4  # what a wall pair is worth whose rooms were not matched to each other
INSIDE = 0.15  # of share, that a room counts more in which the S room's centroid lies
DOUBT = 0.1  # quality of a wall of no plan
COMMON = 0.5  # of a piece's length that may lie beside another piece of the same wall

Matches = tuple[tuple[int, int, float], ...]  # indices into S and A, confidence


@dataclass(frozen=True)
class _Laid:
    s: Walls
    a: Walls
    quality: Array  # (Ns, Na)
    along: Array  # (Ns, Na)
    moved: Array  # (Ns, 3) motion of each S wall, between own frames


def complete(found: Bent, k: int) -> Pairs:
    """The pairs of one hypothesis, indices into S's walls and rooms and into those of its storey.

    A surface pair's confidence is q / (q + q' + 0.1) with its quality q, q' the next best A wall's; a room pair's the
    same with the shares of the S room's walls, by length.
    """
    laid = _laid(found, k)
    share = _shares(laid)
    rooms = _rooms(laid, share)
    return Pairs(rooms, _surfaces(laid, share, rooms))


def _laid(found: Bent, k: int) -> _Laid:
    scene, table, storey = found.scene, found.table[k], int(found.fields.storey[k])
    a, first = scene.plan.storeys[storey], int(scene.plan.first[storey])
    now = judge(scene, table[None], found.fields.state[k : k + 1], SIGMA)
    i, p = np.nonzero(table >= 0)
    quality, along = np.zeros((len(scene.s), len(a))), np.zeros((len(scene.s), len(a)))
    quality[i, table[i, p] - first], along[i, table[i, p] - first] = now.quality[0, i, p], now.along[0, i, p]
    moved = motions(scene, found.fields.state[k : k + 1])[0, scene.groups.of_wall]
    return _Laid(scene.s, a, quality, along, moved)


def _shares(laid: _Laid) -> Array:
    """(S rooms, A rooms) of each S room's walls, by length, what lies on walls of the A room."""
    s, a = laid.s, laid.a
    share = np.zeros((len(s.rooms), len(a.rooms)))
    housed = s.room >= 0
    if not housed.any() or not len(a.rooms):
        return share
    certain = laid.quality.max(axis=1, initial=0.0)
    each = laid.quality**2
    each *= (certain / np.maximum(each.sum(axis=1), 1e-12))[:, None]
    by_room = np.zeros((len(s), len(a.rooms)))
    inside = a.room >= 0
    np.add.at(by_room.T, a.room[inside], each[:, inside].T)
    np.add.at(share, s.room[housed], (s.half[:, None] * by_room)[housed])
    return np.asarray(share / np.bincount(s.room[housed], s.half[housed], len(s.rooms))[:, None])


def _rooms(laid: _Laid, share: Array) -> Matches:
    """Each S room's best A room; of two S rooms with the same one the lesser keeps it where it is another part."""
    if not share.size:
        return ()
    merit = share + INSIDE * _inside(laid)
    chosen: dict[int, int] = {}
    for r in np.argsort(-merit.max(axis=1), kind="stable").tolist():
        for q in np.argsort(-merit[r], kind="stable")[:3].tolist():
            if share[r, q] < LEAST_SHARE:
                continue
            others = [o for o, taken in chosen.items() if taken == q]
            if not others or all(_apart(laid, r, o, q) for o in others):
                chosen[r] = q
                break
    return tuple((r, q, _confidence(merit[r], q)) for r, q in sorted(chosen.items()))


def _apart(laid: _Laid, r: int, o: int, q: int) -> bool:
    """Whether two S rooms lie on different walls, or different parts of walls, of one A room."""
    spans: list[dict[int, list[tuple[float, float]]]] = []
    for room in (r, o):
        own: dict[int, list[tuple[float, float]]] = {}
        for i in np.nonzero(laid.s.room == room)[0]:
            j = int(np.argmax(np.where(laid.a.room == q, laid.quality[i], 0.0)))
            if laid.quality[i, j] > LEAST_QUALITY:
                own.setdefault(j, []).append((laid.along[i, j] - laid.s.half[i], laid.along[i, j] + laid.s.half[i]))
        spans.append(own)
    total = min(sum(v - u for parts in own.values() for u, v in parts) for own in spans)
    common = sum(
        max(0.0, min(v, y) - max(u, x))
        for j in spans[0].keys() & spans[1].keys()
        for u, v in spans[0][j]
        for x, y in spans[1][j]
    )
    return common < COMMON * total


def _inside(laid: _Laid) -> Array:
    """(S rooms, A rooms) 1 where the S room's centroid lies in the A room's footprint."""
    import shapely  # slow to import

    s, a = laid.s, laid.a
    first = np.array([np.nonzero(s.room == r)[0][0] for r in range(len(s.rooms))])
    own = se2.apply(se2.inverse(s.T_graph_own), np.array([r.centroid for r in s.rooms], dtype=float))
    placed = se2.apply(a.T_graph_own, se2.apply(laid.moved[first], own))
    inside = np.zeros((len(s.rooms), len(a.rooms)))
    for q, room in enumerate(a.rooms):
        if room.polygon is not None and len(room.polygon) > 2:
            inside[:, q] = shapely.contains_xy(shapely.Polygon(room.polygon), placed[:, 0], placed[:, 1])
    return inside


def _confidence(value: Array, chosen: int) -> float:
    others = np.delete(value, chosen)
    return float(value[chosen] / (value[chosen] + others.max(initial=0.0) + DOUBT))


def _surfaces(laid: _Laid, share: Array, rooms: Matches) -> Matches:
    from scipy.optimize import linear_sum_assignment  # slow to import

    s, a, quality = laid.s, laid.a, laid.quality
    told = np.zeros((len(s.rooms) + 1, len(a.rooms) + 1), dtype=bool)
    told[:-1, :-1] = share > PART_SHARE
    for r, q, _ in rooms:
        told[r, q] = True
    told[~told.any(axis=1)] = True  # of rooms that lie nowhere, and of walls without a room, nothing is known
    told[:, -1] = True
    quality = np.where(told[s.room][:, a.room], quality, OTHER_ROOM * quality)
    columns = np.nonzero(quality.max(axis=0, initial=0.0) > LEAST_QUALITY)[0]
    rows, best = linear_sum_assignment(-quality[:, columns])
    chosen = zip(rows.tolist(), columns[best].tolist(), strict=True)
    matched = {i: j for i, j in chosen if quality[i, j] > LEAST_QUALITY}
    for i in np.argsort(-s.half, kind="stable").tolist():  # further pieces of a wall, where they lie beside its others
        if i in matched or not quality.shape[1]:
            continue
        j = int(np.argmax(quality[i]))
        if quality[i, j] > LEAST_QUALITY and not _covered(laid, i, j, matched):
            matched[i] = j
    return tuple((i, j, _confidence(quality[i], j)) for i, j in sorted(matched.items()))


def _covered(laid: _Laid, i: int, j: int, matched: dict[int, int]) -> bool:
    """Whether S wall i lies mostly beside others that are matched to the same A wall."""
    at, half = laid.along[:, j], laid.s.half
    common = [
        min(at[i] + half[i], at[o] + half[o]) - max(at[i] - half[i], at[o] - half[o])
        for o, taken in matched.items()
        if taken == j
    ]
    return max(common, default=0.0) >= COMMON * 2 * half[i]

