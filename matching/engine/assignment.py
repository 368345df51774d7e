"""Assigns rooms and wall surfaces under a field of motions: each surface under its own room's motion."""

from dataclasses import dataclass

import numpy as np

from data.common.compiled import compiled
from data.geometry.se2 import Array
from matching.arrays import Index, Walls
from matching.engine.field_loops import Loops, compared, turns, wall_poses
from matching.engine.hypotheses import Hypotheses

SIGMA_ACROSS, SIGMA_TURN, SIGMA_END = 0.12, float(np.radians(3.5)), 0.5  # metres, radians, metres
UPON = 0.2  # of a wall's own length beside the plan's, from which on it does not matter how much it is
CUT_SHORT = 0.3  # of the ends of walls that are not where the plan has them, but before
LEAST_QUALITY = 0.008
LEAST_OFF = 0.05  # quality of a short piece that slid wholly off its short wall
LEAST_SHARE = 0.25  # of an S room's walls, by length, that lie in its A room
PART_SHARE = 0.2  # of a room's walls in another A room: it may be two rooms in one
OTHER_ROOM, OTHER_PART = 0.2, 0.5  # weight of a wall pair whose rooms are not matched to each other, or may be
SECOND_SHARE = 0.6  # of the walls of an S room in an A room that another S room has: it was cut in two
CONTESTED = 0.5  # of the best A room's share; where another one has more, the S room is not matched
INSIDE = 0.05  # of share, that a room counts more in which the S room's centroid lies
DOUBT = 0.02  # quality of a wall of no plan
DOUBT_ROOM = 0.1
TRIED = 3  # A rooms of each S room
COMMON = 0.5  # of a piece's length that may lie beside another piece of the same wall; the other may be shorter
Matches = tuple[tuple[int, int, float], ...]  # indices into S and A, and a share in [0, 1]


@dataclass(frozen=True)
class Pairs:
    """Matches as indices into S and A, each with its share in [0, 1] among what stood to choose."""

    rooms: Matches
    surfaces: Matches


@dataclass(frozen=True)
class _Layout:
    """The possible pairs (Ns, P) of S walls with A walls of one storey, and where the map's rooms lie."""

    s: Walls
    a: Walls
    footprints: tuple[Array, Index]  # of A's rooms
    partner: Index  # 0 where there is none, with quality 0
    quality: Array  # in [0, 1]
    along: Array  # S's mid point from A's
    placed: Array  # (R, 2) the centroids of S's rooms, in the plan's frame


def assign(found: Hypotheses, k: int) -> Pairs:
    """Returns the matches of hypothesis k as indices into S's walls and rooms and into those of its storey.

    The share of a surface pair is q / (q + q' + 0.02) of its quality q, where q' is that of the next best A wall; that
    of a room pair likewise from the shares of the S room's walls, by length.
    """
    layout = _layout(found, k)
    share = _shares(layout)
    rooms = _rooms(layout, share)
    return Pairs(rooms, _surfaces(layout, share, rooms))


def assign_rooms(found: Hypotheses, k: int) -> Matches:
    """Returns the room matches alone."""
    layout = _layout(found, k)
    return _rooms(layout, _shares(layout))


def _layout(found: Hypotheses, k: int) -> _Layout:
    scene, table, storey = found.scene, found.table[k], int(found.fields.storey[k])
    quality, along = _likely(scene.loops, table, found.fields.state[k])
    partner = np.where(table >= 0, table - scene.plan.first[storey], 0)
    placed = found.rooms_placed[k]
    return _Layout(scene.s, scene.plan.storeys[storey], scene.plan.footprints[storey], partner, quality, along, placed)


@compiled
def _likely(m: Loops, table: Index, state: Array) -> tuple[Array, Array]:
    """(Ns, P) quality in [0, 1], and S's mid point along A's wall.

    The quality combines the offset across, the direction, the overlap and both ends, which are inaccurate or stop short
    of the plan's; a short piece may slide off a short wall.
    """
    quality, at, pose = np.zeros(table.shape), np.zeros(table.shape), wall_poses(m, state, turns(state))
    for i in range(len(table)):
        for p in range(table.shape[1]):
            if table[i, p] < 0:
                continue
            j, half = table[i, p], m.half[i]
            across, along, turned, _ = compared(m.lines, j, half, pose, i)
            at[i, p] = along
            common = beside(along, half, 0.0, m.lines[j, 0])
            short = half + m.lines[j, 0] < SIGMA_END
            if common <= 0 and not short:
                continue
            likely = 1.0 if short else min(common / (UPON * 2 * half), 1.0)
            likely *= np.exp(-0.5 * (across / SIGMA_ACROSS) ** 2 - 0.5 * (turned / SIGMA_TURN) ** 2)
            for side in (-1, 1):
                beyond = side * along + half - m.lines[j, 0]
                slid = np.exp(-0.5 * (beyond / SIGMA_END) ** 2)
                likely *= slid if beyond > 0 else (1 - CUT_SHORT) * slid + CUT_SHORT
            if common > 0 or likely > LEAST_OFF:
                quality[i, p] = likely
    return quality, at


def _shares(layout: _Layout) -> Array:
    """(S rooms, A rooms) the share of each S room's walls, by length, that lies on walls of the A room."""
    s, a = layout.s, layout.a
    return np.asarray(_shared(s.room, s.half, a.room, layout.partner, layout.quality, len(s.rooms), len(a.rooms)))


@compiled
def _shared(room: Index, half: Array, a_room: Index, partner: Index, quality: Array, rooms: int, a_rooms: int) -> Array:
    """See `_shares`."""
    share, size = np.zeros((rooms, a_rooms)), np.zeros(rooms)
    for i in range(len(room)):
        if room[i] < 0:
            continue
        size[room[i]] += half[i]
        total = quality[i].sum() + DOUBT
        for p in range(partner.shape[1]):
            home = a_room[partner[i, p]]
            if home >= 0:
                share[room[i], home] += half[i] * (quality[i, p] / total)
    for r in range(rooms):
        for q in range(a_rooms):
            share[r, q] /= size[r]
    return share


def _rooms(layout: _Layout, share: Array) -> Matches:
    """The best A room of each S room. Of two S rooms with the same one, the smaller keeps it if it is another part of
    it.

    An S room that merges two A rooms of about the same size stays unmatched.
    """
    if not share.size:
        return ()
    s, a = layout.s, layout.a
    merit = _merit(share, layout.placed, *layout.footprints)
    order = np.argsort(-merit.max(axis=1), kind="stable")
    chosen = _chosen(share, merit, order, s.room, s.half, a.room, layout.partner, layout.quality, layout.along)
    rows = zip(range(len(chosen)), chosen.tolist(), _among(merit, chosen, DOUBT_ROOM).tolist(), strict=True)
    return tuple((r, q, c) for r, q, c in rows if q >= 0)


@compiled
def _merit(share: Array, placed: Array, corners: Array, first: Index) -> Array:
    """(S rooms, A rooms) the shares, raised if the S room's centroid (S rooms, 2) lies in the A room's footprint."""
    merit = share.copy()
    for r in range(share.shape[0]):
        for q in range(share.shape[1]):
            if share[r, q] >= LEAST_SHARE and _holds(corners[first[q] : first[q + 1]], placed[r, 0], placed[r, 1]):
                merit[r, q] += INSIDE
    return merit


@compiled
def _holds(corners: Array, x: float, y: float) -> bool:
    """Whether a point lies in a footprint (C, 2), by counting the edges that a ray along x crosses."""
    inside = False
    for n in range(len(corners)):
        x1, y1, x2, y2 = corners[n - 1, 0] - x, corners[n - 1, 1] - y, corners[n, 0] - x, corners[n, 1] - y
        if (y1 > 0) != (y2 > 0) and (x1 * y2 - x2 * y1) * (y2 - y1) > 0:
            inside = not inside
    return inside


@compiled
def _chosen(
    share: Array, merit: Array, order: Index, s_room: Index, half: Array, a_room: Index, partner: Index,
    quality: Array, along: Array,
) -> Index:  # fmt: skip
    """(S rooms,) the A rooms, among the few of most merit, -1 for none; `order` is the order in which S rooms
    choose.
    """
    chosen = np.full(len(share), -1)
    for r in order:
        left = merit[r].copy()
        for _ in range(min(TRIED, len(left))):
            q = left.argmax()
            left[q] = -1.0
            if share[r, q] < LEAST_SHARE or _most_but(share[r], q) > CONTESTED * share[r, q]:
                continue
            free = True
            for o in range(len(chosen)):
                if free and chosen[o] == q:
                    free = share[r, q] >= SECOND_SHARE
                    free = free and _apart(r, o, q, s_room, half, a_room, partner, quality, along)
            if free:
                chosen[r] = q
                break
    return chosen


@compiled
def _apart(
    r: int,
    o: int,
    q: int,
    s_room: Index,
    half: Array,
    a_room: Index,
    partner: Index,
    quality: Array,
    along: Array,
) -> bool:
    """Whether two S rooms lie on different walls, or different parts of walls, of one A room."""
    best = np.full(len(s_room), -1)  # the pair of each wall of the two rooms with the A room's
    length = np.zeros(2)
    for i in range(len(s_room)):
        if s_room[i] != r and s_room[i] != o:
            continue
        most = LEAST_QUALITY
        for p in range(partner.shape[1]):
            if a_room[partner[i, p]] == q and quality[i, p] > most:
                best[i], most = p, float(quality[i, p])
        if best[i] >= 0:
            length[int(s_room[i] == o)] += 2 * half[i]
    common = 0.0
    for n in range(len(best)):
        for m in range(len(best)):
            both = s_room[n] == r and s_room[m] == o and best[n] >= 0 and best[m] >= 0
            if both and partner[n, best[n]] == partner[m, best[m]]:
                common += max(0.0, beside(along[n, best[n]], half[n], along[m, best[m]], half[m]))
    return common < COMMON * length.min()


@compiled
def beside(at: float, half: float, other_at: float, other_half: float) -> float:
    """The overlap of two pieces of a wall at these places along it; negative if there is a gap."""
    return min(at + half, other_at + other_half) - max(at - half, other_at - other_half)


@compiled
def _most_but(value: Array, chosen: int) -> float:
    """The largest of non-negative values, except for one."""
    most = 0.0
    for n in range(len(value)):
        if n != chosen and value[n] > most:
            most = value[n]
    return most


@compiled
def _among(value: Array, chosen: Index, doubt: float) -> Array:
    """(N,) the share of the chosen value in each row of values (N, P), 0 if none is chosen (-1)."""
    found = np.zeros(len(value))
    for n in range(len(value)):
        if chosen[n] >= 0:
            one = value[n, chosen[n]]
            found[n] = one / (one + _most_but(value[n], chosen[n]) + doubt)
    return found


def _surfaces(layout: _Layout, share: Array, rooms: Matches) -> Matches:
    """The surface pairs, likeliest first; several S walls on one A wall are its pieces if they lie side by side."""
    s, a = layout.s, layout.a
    trust = np.ones((len(share) + 1, share.shape[1] + 1))  # the last of each: of walls without a room
    trust[:-1, :-1] = np.where(share > PART_SHARE, OTHER_PART, OTHER_ROOM)
    trust[:-1][~(share > PART_SHARE).any(axis=1)] = 1.0  # unknown
    for r, q, _ in rooms:
        trust[r, q] = 1.0
    quality = layout.quality * trust[s.room[:, None], a.room[layout.partner]]
    rows, columns = np.nonzero(quality > LEAST_QUALITY)
    order = np.argsort(-quality[rows, columns], kind="stable")
    matched = _pieces(rows[order], columns[order], layout.partner, layout.along, s.half)
    found = np.flatnonzero(matched >= 0)
    partner, sure = layout.partner[found, matched[found]], _among(quality, matched, DOUBT)[found]
    return tuple(zip(found.tolist(), partner.tolist(), sure.tolist(), strict=True))


@compiled
def _pieces(rows: Index, columns: Index, partner: Index, along: Array, half: Array) -> Index:
    """(Ns,) the pair of each wall, -1 for none: the first in the given order that does not mostly overlap another on
    its A wall.

    A longer wall may overlap: a wall is often mapped as a short, accurate piece and a long one.
    """
    matched = np.full(len(half), -1)
    for e in range(len(rows)):
        i, p = rows[e], columns[e]
        free = matched[i] < 0
        for k in range(len(half)):
            if free and matched[k] >= 0 and partner[k, matched[k]] == partner[i, p]:
                common = beside(along[i, p], half[i], along[k, matched[k]], half[k])
                free = common <= COMMON * 2 * half[i]
        if free:
            matched[i] = p
    return matched
