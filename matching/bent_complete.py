"""Rooms and wall surfaces matched under a field of motions: each surface under its own room's motion."""

from dataclasses import dataclass

import numpy as np

from data.scene_graph import Room
from matching import se2
from matching.bent import Bent
from matching.complete import Pairs
from matching.confidence import room_confidence, surface_confidence
from matching.field import Judged, judge, motions
from matching.se2 import Array
from matching.walls import Index, Walls

SIGMA_ACROSS, SIGMA_TURN, SIGMA_END = 0.12, np.radians(4), 0.5  # metres, radians, metres
CUT_SHORT = 0.25  # of the ends of walls that are not where the plan has them, but before
LEAST_QUALITY = 0.008
LEAST_SHARE = 0.25  # of an S room's walls, by length, that lie in its A room
PART_SHARE = 0.2  # of a room's walls in another A room: it may be two rooms in one
OTHER_ROOM, OTHER_PART = 0.1, 0.5  # what a wall pair is worth whose rooms were not matched, or may be, to each other
SECOND_SHARE = 0.6  # of the walls of an S room in an A room that another S room has: it was cut in two
CONTESTED = 0.5  # of the best A room's share; where another one has more, the S room is not matched
INSIDE = 0.05  # of share, that a room counts more in which the S room's centroid lies
DOUBT = 0.02  # quality of a wall of no plan
DOUBT_ROOM = 0.1
TRIED = 3  # A rooms of each S room
COMMON = 0.5  # of a piece's length that may lie beside another piece of the same wall
Matches = tuple[tuple[int, int, float], ...]  # indices into S and A, share among what stood to choose


@dataclass(frozen=True)
class _Laid:
    """The pairs (Ns, P) of S walls with A walls of one storey, and the motion (Ns, 3) of each S wall."""

    s: Walls
    a: Walls
    partner: Index  # 0 where there is none, with quality 0
    quality: Array  # in [0, 1]
    along: Array  # S's mid point from A's
    moved: Array  # between own frames


def complete(found: Bent, k: int) -> Pairs:
    """The pairs of one hypothesis, indices into S's walls and rooms and into those of its storey.

    A surface pair's confidence is that of the share q / (q + q' + 0.02) with its quality q, q' the next best A wall's;
    a room pair's the like with the shares of the S room's walls, by length.
    """
    laid = _laid(found, k)
    share = _shares(laid)
    rooms = _rooms(laid, share)
    told = tuple((r, q, room_confidence(c)) for r, q, c in rooms)
    return Pairs(told, tuple((i, j, surface_confidence(c)) for i, j, c in _surfaces(laid, share, rooms)))


def complete_rooms(found: Bent, k: int) -> Matches:
    """The rooms alone."""
    laid = _laid(found, k)
    return _rooms(laid, _shares(laid))


def _laid(found: Bent, k: int) -> _Laid:
    scene, table, storey = found.scene, found.table[k], int(found.fields.storey[k])
    now = judge(scene, table[None], found.fields.state[k : k + 1], SIGMA_ACROSS)
    quality = np.where(table >= 0, _likely(scene.s, scene.plan.half[table], now), 0.0)
    partner = np.where(table >= 0, table - scene.plan.first[storey], 0)
    moved = motions(scene, found.fields.state[k : k + 1])[0, scene.groups.of_wall]
    return _Laid(scene.s, scene.plan.storeys[storey], partner, quality, now.along[0], moved)


def _likely(s: Walls, half: Array, now: Judged) -> Array:
    """(Ns, P) in [0, 1]: across, in direction, and by both ends, which slide, or stop short of the plan's."""
    quality = np.exp(-0.5 * (now.across[0] / SIGMA_ACROSS) ** 2 - 0.5 * (now.turned[0] / SIGMA_TURN) ** 2)
    for side in (-1, 1):
        beyond = side * now.along[0] + s.half[:, None] - half
        slid = np.exp(-0.5 * (beyond / SIGMA_END) ** 2)
        quality *= np.where(beyond > 0, slid, (1 - CUT_SHORT) * slid + CUT_SHORT)
    return np.asarray(np.where(now.beside[0] > 0, quality, 0.0))


def _shares(laid: _Laid) -> Array:
    """(S rooms, A rooms) of each S room's walls, by length, what lies on walls of the A room."""
    s, a = laid.s, laid.a
    each = laid.quality / (laid.quality.sum(axis=1, keepdims=True) + DOUBT)
    share = np.zeros((len(s.rooms) + 1, len(a.rooms) + 1))  # the last of each: of walls without a room
    np.add.at(share, (s.room[:, None], a.room[laid.partner]), s.half[:, None] * each)
    size = np.bincount(s.room[s.room >= 0], s.half[s.room >= 0], len(s.rooms))
    return np.asarray(share[:-1, :-1] / size[:, None])


def _rooms(laid: _Laid, share: Array) -> Matches:
    """Each S room's best A room; of two S rooms with the same one the lesser keeps it where it is another part.

    Two rooms that the map took for one, about equally large, are left unmatched.
    """
    if not share.size:
        return ()
    s, a = laid.s, laid.a
    first = np.unique(s.room[s.room >= 0], return_index=True)[1]
    first = np.flatnonzero(s.room >= 0)[first]
    own = se2.apply(se2.inverse(s.T_graph_own), np.array([r.centroid for r in s.rooms], dtype=float))
    placed = se2.apply(a.T_graph_own, se2.apply(laid.moved[first], own))
    merit = share.copy()
    for r, q in np.argwhere(share >= LEAST_SHARE).tolist():
        merit[r, q] += INSIDE * _holds(a.rooms[q], placed[r])
    likely = np.argsort(-merit, axis=1, kind="stable")[:, :TRIED]
    chosen: dict[int, int] = {}
    for r in np.argsort(-merit.max(axis=1), kind="stable").tolist():
        for q in likely[r].tolist():
            if share[r, q] < LEAST_SHARE or _most_but(share[r], q) > CONTESTED * share[r, q]:
                continue
            others = [o for o, taken in chosen.items() if taken == q]
            if not others or (share[r, q] >= SECOND_SHARE and all(_apart(laid, r, o, q) for o in others)):
                chosen[r] = q
                break
    return tuple((r, q, _among(merit[r], q, DOUBT_ROOM)) for r, q in sorted(chosen.items()))


def _apart(laid: _Laid, r: int, o: int, q: int) -> bool:
    """Whether two S rooms lie on different walls, or different parts of walls, of one A room."""
    spans: list[dict[int, list[tuple[float, float]]]] = []
    for room in (r, o):
        own: dict[int, list[tuple[float, float]]] = {}
        for i in np.flatnonzero(laid.s.room == room).tolist():
            of_room = np.where(laid.a.room[laid.partner[i]] == q, laid.quality[i], 0.0)
            p = int(np.argmax(of_room))
            if of_room[p] > LEAST_QUALITY:
                at, half = laid.along[i, p], laid.s.half[i]
                own.setdefault(int(laid.partner[i, p]), []).append((at - half, at + half))
        spans.append(own)
    total = min(sum(v - u for parts in own.values() for u, v in parts) for own in spans)
    common = sum(
        max(0.0, min(v, y) - max(u, x))
        for j in spans[0].keys() & spans[1].keys()
        for u, v in spans[0][j]
        for x, y in spans[1][j]
    )
    return common < COMMON * total


def _holds(room: Room, point: Array) -> bool:
    """Whether a point lies in a room's footprint."""
    if room.polygon is None or len(room.polygon) < 3:
        return False
    x, y = (np.array(room.polygon) - point).T
    u, v = np.roll(x, -1), np.roll(y, -1)
    up = (y > 0) != (v > 0)  # edges that the line from the point along x crosses
    return bool(np.count_nonzero((x * v - u * y)[up] * (v - y)[up] > 0) % 2)


def _among(value: Array, chosen: int, doubt: float) -> float:
    return float(value[chosen] / (value[chosen] + _most_but(value, chosen) + doubt))


def _most_but(value: Array, chosen: int) -> float:
    """The largest of values, none below 0, but for one."""
    return float(max(value[:chosen].max(initial=0.0), value[chosen + 1 :].max(initial=0.0)))


def _surfaces(laid: _Laid, share: Array, rooms: Matches) -> Matches:
    """The likeliest pairs first; of several S walls on one A wall those that lie beside each other are its pieces."""
    s, a = laid.s, laid.a
    trust = np.where(share > PART_SHARE, OTHER_PART, OTHER_ROOM)
    trust[~(share > PART_SHARE).any(axis=1)] = 1.0  # nothing is known of them
    for r, q, _ in rooms:
        trust[r, q] = 1.0
    trust = np.pad(trust, ((0, 1), (0, 1)), constant_values=1.0)  # the last of each: of walls without a room
    quality = laid.quality * trust[s.room[:, None], a.room[laid.partner]]
    rows, columns = np.nonzero(quality > LEAST_QUALITY)
    matched: dict[int, tuple[int, float]] = {}
    pieces: dict[int, list[tuple[float, float]]] = {}  # of each A wall: along it, and half the length
    for e in np.argsort(-quality[rows, columns], kind="stable").tolist():
        i, p = int(rows[e]), int(columns[e])
        j, at, half = int(laid.partner[i, p]), float(laid.along[i, p]), float(s.half[i])
        if i in matched or any(_covers(at, half, *other) for other in pieces.get(j, ())):
            continue
        matched[i] = j, _among(quality[i], p, DOUBT)
        pieces.setdefault(j, []).append((at, half))
    return tuple((i, j, merit) for i, (j, merit) in sorted(matched.items()))


def _covers(at: float, half: float, other_at: float, other_half: float) -> bool:
    """Whether one of two pieces lies mostly beside the other."""
    common = min(at + half, other_at + other_half) - max(at - half, other_at - other_half)
    return common > COMMON * 2 * min(half, other_half)
