"""Assigns rooms and wall surfaces under a field of motions: each surface under its own room's motion."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from data.geometry.se2 import Array
from matching.arrays import Index, Walls
from matching.engine.field import judge
from matching.engine.field_loops import SIGMA_SCORE
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
DOUBT = 0.02  # quality of a wall of no plan
COMMON = 0.5  # of a piece's length that may lie beside another piece of the same wall; the other may be shorter
Matches = tuple[tuple[int, int, float], ...]  # indices into S and A, and a share in [0, 1]


@dataclass(frozen=True)
class Pairs:
    """Matches as indices into S and A, each with its share in [0, 1] among what stood to choose."""

    rooms: Matches
    surfaces: Matches


@dataclass(frozen=True)
class _Layout:
    """The possible pairs (Ns, P) of S walls with A walls of one storey."""

    s: Walls
    a: Walls
    partner: Index  # 0 where there is none, with quality 0
    quality: Array  # in [0, 1]
    along: Array  # S's mid point from A's


def assign(found: Hypotheses, k: int) -> Pairs:
    """Returns the matches of hypothesis k as indices into S's walls and rooms and those of its storey.

    The share of a surface pair is q / (q + q' + 0.02) of its quality q, where q' is that of the next best A wall; that
    of a room pair is the share of the S room's walls, by length, that lie in the A room.
    """
    layout = _layout(found, k)
    share = _shares(layout)
    rooms = _rooms(layout, share)
    return Pairs(rooms, _surfaces(layout, share, rooms))


def _layout(found: Hypotheses, k: int) -> _Layout:
    """The quality of a pair combines the offset across, the direction, the overlap and both ends, which are inaccurate
    or stop short of the plan's; a short piece may slide off a short wall."""
    scene, table, storey = found.scene, found.table[k], int(found.fields.storey[k])
    a, there = scene.plan.storeys[storey], table >= 0
    partner = np.where(there, table - scene.plan.first[storey], 0)
    now = judge(scene, table[None], found.fields.state[k, None], SIGMA_SCORE)
    across, along, turned = now.across[0], now.along[0], now.turned[0]
    half, a_half = scene.s.half[:, None], a.half[partner]
    common, short = _beside(along, half, 0.0, a_half), half + a_half < SIGMA_END
    likely = np.where(short, 1.0, np.clip(common / (UPON * 2 * half), 0.0, 1.0))
    likely *= np.exp(-0.5 * (across / SIGMA_ACROSS) ** 2 - 0.5 * (turned / SIGMA_TURN) ** 2)
    for side in (-1, 1):
        beyond = side * along + half - a_half
        slid = np.exp(-0.5 * (beyond / SIGMA_END) ** 2)
        likely *= np.where(beyond > 0, slid, (1 - CUT_SHORT) * slid + CUT_SHORT)
    quality = np.where(there & ((common > 0) | (short & (likely > LEAST_OFF))), likely, 0.0)
    return _Layout(scene.s, a, partner, quality, along)


def _beside(at: Any, half: Any, other_at: Any, other_half: Any) -> Array:
    """The overlap of two pieces of a wall at these places along it, numbers or arrays; negative if there is a gap."""
    return np.asarray(np.minimum(at + half, other_at + other_half) - np.maximum(at - half, other_at - other_half))


def _shares(layout: _Layout) -> Array:
    """(S rooms, A rooms) the share of each S room's walls, by length, that lies on walls of the A room."""
    s, a = layout.s, layout.a
    share = np.zeros((len(s.rooms), len(a.rooms)))
    home = a.room[layout.partner]
    part = s.half[:, None] * layout.quality / (layout.quality.sum(axis=1, keepdims=True) + DOUBT)
    i, p = np.nonzero((s.room[:, None] >= 0) & (home >= 0))
    np.add.at(share, (s.room[i], home[i, p]), part[i, p])
    size = np.bincount(s.room[s.room >= 0], s.half[s.room >= 0], len(s.rooms))
    return np.asarray(share / np.maximum(size, 1e-9)[:, None])


def _rooms(layout: _Layout, share: Array) -> Matches:
    """The best A room of each S room; those with the largest shares choose first.

    An S room that merges two A rooms of about the same size stays unmatched. Two S rooms may be parts of one A room, if
    they lie on different walls, or different parts of walls, of it.
    """
    if not share.size:
        return ()
    chosen = np.full(len(share), -1)
    best, (first, second) = share.argmax(axis=1), _best_two(share)
    for r in np.argsort(-first, kind="stable").tolist():
        q = int(best[r])
        if share[r, q] < LEAST_SHARE or second[r] > CONTESTED * share[r, q]:
            continue
        others = np.flatnonzero(chosen == q).tolist()
        if not others or (share[r, q] >= SECOND_SHARE and all(_apart(layout, r, o, q) for o in others)):
            chosen[r] = q
    return tuple((r, int(q), float(first[r])) for r, q in enumerate(chosen) if q >= 0)


def _apart(layout: _Layout, r: int, o: int, q: int) -> bool:
    """Whether two S rooms lie on different walls, or different parts of walls, of one A room."""
    s, quality = layout.s, np.where(layout.a.room[layout.partner] == q, layout.quality, 0.0)
    best, rows = quality.argmax(axis=1), np.arange(len(quality))
    on = quality[rows, best] > LEAST_QUALITY
    n, m = (np.flatnonzero(on & (s.room == room)) for room in (r, o))
    at, wall = layout.along[rows, best], layout.partner[rows, best]
    common = _beside(at[n, None], s.half[n, None], at[m], s.half[m])
    same = wall[n, None] == wall[m]
    return bool(np.maximum(common, 0.0)[same].sum() < COMMON * 2 * min(s.half[n].sum(), s.half[m].sum()))


def _best_two(value: Array) -> Array:
    """(2, N) the largest and the next value of each row (N, P), 0 where there are fewer."""
    return np.asarray(-np.partition(-np.pad(value, ((0, 0), (0, 2))), 1, axis=1)[:, :2].T)


def _surfaces(layout: _Layout, share: Array, rooms: Matches) -> Matches:
    """The surface pairs, likeliest first; several S walls on one A wall are its pieces if they lie side by side.

    A longer wall may overlap: a wall is often mapped as a short, accurate piece and a long one.
    """
    s, a = layout.s, layout.a
    trust = np.ones((len(share) + 1, share.shape[1] + 1))  # the last of each: of walls without a room
    trust[:-1, :-1] = np.where(share > PART_SHARE, OTHER_PART, OTHER_ROOM)
    trust[:-1][~(share > PART_SHARE).any(axis=1)] = 1.0  # unknown
    for r, q, _ in rooms:
        trust[r, q] = 1.0
    quality = layout.quality * trust[s.room[:, None], a.room[layout.partner]]
    first, second = _best_two(quality)
    rows, columns = np.nonzero(quality > LEAST_QUALITY)
    order = np.argsort(-quality[rows, columns], kind="stable")
    pieces: dict[int, list[tuple[int, float]]] = {}  # of each A wall: the S walls on it, and where along it
    matched: dict[int, tuple[int, float]] = {}
    for i, p in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        j, at, half = int(layout.partner[i, p]), float(layout.along[i, p]), float(s.half[i])
        on = pieces.setdefault(j, [])
        if i not in matched and all(_beside(at, half, there, s.half[k]) <= COMMON * 2 * half for k, there in on):
            on.append((i, at))
            one, other = quality[i, p], second[i] if quality[i, p] == first[i] else first[i]
            matched[i] = j, float(one / (one + other + DOUBT))
    return tuple((i, *matched[i]) for i in sorted(matched))
