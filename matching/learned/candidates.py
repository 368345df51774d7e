"""`network.candidates` and `network.agreement` for one pair of graphs, as compiled loops."""

from typing import NamedTuple

import numpy as np

from data.common.compiled import compiled, compiled_within
from matching.arrays import Index
from matching.network.arithmetic import exp, softmax
from matching.network.dimensions import (
    AGREEMENTS,
    LEAST_LIKELY,
    LEAST_ODDS,
    LEAST_VOTER_COS,
    NOTHING,
    REACHES,
    ROOM_UNKNOWN,
    TRUST,
    VOTERS,
    VOTES_EACH,
)  # fmt: skip
from matching.network.features import Array32
from matching.network.support_loops import WallRows, alike

_NOTHING, _HALF, _1, _0 = np.float32(NOTHING), np.float32(0.5), np.float32(1), np.float32(0)
_ODDS, _STRANGE = np.float32(LEAST_ODDS), np.float32(ROOM_UNKNOWN)
_LIKELY, _TRUST, _COS = (np.float32(x) for x in (LEAST_LIKELY, TRUST, LEAST_VOTER_COS))
(_NEAR, _SLOPE), (_WIDE, _WIDE_SLOPE) = (tuple(np.float32(x) for x in reach) for reach in REACHES)
_LEAST_VOICE, _LITTLE = np.float32(1e-3), np.float32(0.05)


class Vectors(NamedTuple):
    """Unit vectors of a graph's walls (N, width) and rooms (M, width), and their log odds of no match, (N,) and
    (M,).
    """

    walls: Array32
    rooms: Array32
    no_wall: Array32
    no_room: Array32


class Choice(NamedTuple):
    """K candidates of each of N S walls, as in `network.candidates.Candidates`."""

    column: Index  # (N, K) rows of A's walls, -1 where there are fewer
    logit: Array32  # (N, K)
    dustbin: Array32  # (N,)


@compiled
def tables(s: Vectors, a: Vectors, s_room: Index, a_room: Index, sharpness: Array32) -> tuple[Array32, Array32]:
    """(N, A walls + 1) and (M, A rooms + 1) log odds from the vectors; those of walls also use their rooms."""
    rooms = np.empty((len(s.rooms), len(a.rooms) + 1), dtype=np.float32)
    room_odds = np.zeros_like(rooms)
    if rooms.size > len(rooms):
        rooms[:, :-1] = np.dot(s.rooms, a.rooms.T)
        rooms[:, :-1] *= sharpness[1]
    rooms[:, -1] = s.no_room
    for r in range(len(rooms)):
        odds = log_softmax(rooms[r])
        for q in range(len(odds)):
            room_odds[r, q] = max(odds[q], _ODDS)
    walls = np.empty((len(s.walls), len(a.walls) + 1), dtype=np.float32)
    near = np.dot(s.walls, a.walls.T)
    for i in range(len(walls)):
        r = s_room[i]
        for j in range(len(a.walls)):
            walls[i, j] = sharpness[0] * near[i, j]
        for j in range(len(a.walls) if rooms.size > len(rooms) else 0):
            walls[i, j] += sharpness[2] * (room_odds[r, a_room[j]] if r >= 0 and a_room[j] >= 0 else _STRANGE)
        walls[i, -1] = s.no_wall[i]
    return walls, rooms


@compiled
def log_softmax(row: Array32) -> Array32:
    """(m,) logarithms of the softmax."""
    most, total = row.max(), _0
    for x in row:
        total += exp(x - most)
    return row - (most + np.log(total))


@compiled
def first_choice(dense: Array32, most: int) -> tuple[Choice, Array32]:
    """Returns the likeliest candidates by `dense` (N, A walls + 1), and their probabilities (N, K)."""
    n, plan = len(dense), dense.shape[1] - 1
    size = min(most, plan)
    column, value = np.full((n, size), -1), np.full((n, size + 1), _NOTHING)
    for i in range(n):
        for j in range(plan):
            if size == 0 or dense[i, j] <= value[i, size - 1]:
                continue
            at = size
            while at > 0 and dense[i, j] > value[i, at - 1]:
                at -= 1
                if at + 1 < size:
                    column[i, at + 1], value[i, at + 1] = column[i, at], value[i, at]
            if at < size:
                column[i, at], value[i, at] = j, dense[i, j]
        value[i, size] = dense[i, plan]
    logit, dustbin = np.ascontiguousarray(value[:, :size]), np.ascontiguousarray(value[:, size])
    return Choice(column, logit, dustbin), np.ascontiguousarray(softmax(value)[:, :size])


@compiled
def expanded(
    s: WallRows, a: WallRows, dense: Array32, known: Choice, likely: Array32, more: int
) -> tuple[Choice, Array32]:
    """Returns the known candidates, with probabilities (N, K), and up to `more` near the likely partners of each wall's
    neighbours; see `network.candidates.expanded`.
    """
    n, k = likely.shape
    column, logit = np.full((n, k + more), -1), np.full((n, k + more), _NOTHING)
    begins, total, met = np.zeros((n, k + more), dtype=np.float32), np.zeros(len(a.half), dtype=np.float32), [0]
    votes_each = _first_two(likely)
    for i in range(n):
        met.clear()
        _vote(s, a, known.column, likely, votes_each, i, total, met)
        for t in range(k):
            column[i, t], logit[i, t], begins[i, t] = known.column[i, t], known.logit[i, t], likely[i, t]
            if column[i, t] >= 0:
                total[column[i, t]] = _0  # it is no new one
        for t in range(k, k + more):
            best = -1
            for c in met:
                least = total[best] if best >= 0 else _0
                if total[c] > least or (total[c] == least and best > c):
                    best = c
            if best >= 0:
                column[i, t], logit[i, t], begins[i, t] = best, dense[i, best], _TRUST * min(total[best], _1)
                total[best] = _0
        for c in met:
            total[c] = _0
        whole = max(begins[i].sum(), _1)
        for t in range(k + more):
            begins[i, t] /= whole
    return Choice(column, logit, known.dustbin), begins


@compiled
def _first_two(likely: Array32) -> Index:
    """(N, VOTES_EACH) positions of the likeliest candidates."""
    size = min(VOTES_EACH, likely.shape[1])
    found = np.empty((len(likely), size), dtype=np.int64)
    for i in range(len(likely)):
        for t in range(size):
            best = -1
            for k in range(likely.shape[1]):
                taken = False
                for earlier in found[i, :t]:
                    taken |= earlier == k
                if not taken and (best < 0 or likely[i, k] > likely[i, best]):
                    best = k
            found[i, t] = best
    return found


@compiled_within
def _vote(
    s: WallRows, a: WallRows, column: Index, likely: Array32, votes_each: Index, i: int, total: Array32, met: list[int]
) -> None:
    """Adds the votes of S wall i's neighbours to `total` (A walls,) and lists the A walls that got one."""
    own, their = np.empty((2, 5), dtype=np.float32), np.empty((2, 5), dtype=np.float32)
    own[1, :4], own[1, 4] = s.pose[i], s.half[i]
    for j in s.near[i]:
        for t in votes_each[j] if j >= 0 else votes_each[0, :0]:
            b = column[j, t]
            if b < 0 or not likely[j, t] > _LIKELY:
                continue
            own[0, :4], own[0, 4] = s.pose[j], s.half[j]
            their[0, :4], their[0, 4] = a.pose[b], a.half[b]
            for m in range(-1, a.near.shape[1]):
                c = b if m < 0 else a.near[b, m]  # b itself: seen in pieces
                if c < 0:
                    continue
                their[1, :4], their[1, 4] = a.pose[c], a.half[c]
                like = alike(own, their)
                if like > _LITTLE:
                    if total[c] == 0:
                        met.append(c)
                    total[c] += likely[j, t] * like


@compiled
def agreement(s: WallRows, a: WallRows, c: Choice, likely: Array32, size: Array32) -> Array32:
    """(N, K, AGREEMENTS) shares in [0, 1] of the map's likeliest candidates that agree; see `network.agreement`.

    `size` (N,) are the weights of the S walls.
    """
    n, k = likely.shape
    voter, voice = _voters(likely, size)
    own, turn, there, floor = _motions(s, a, c.column, voter)
    found, most = np.empty((n, k, AGREEMENTS), dtype=np.float32), _LEAST_VOICE
    sharp, wide = np.empty((k, len(voter)), dtype=np.float32), np.empty((k, len(voter)), dtype=np.float32)
    for i in range(n):
        for t in range(k):
            p = max(c.column[i, t], 0)
            cos, sin = _turn(s.pose[i, 2], s.pose[i, 3], a.pose[p, 2], a.pose[p, 3])
            for v in range(len(voter)):
                x, y = own[0, v] - s.pose[i, 0], own[1, v] - s.pose[i, 1]
                off_x = cos * x - sin * y + a.pose[p, 0] - there[0, v]
                off_y = sin * x + cos * y + a.pose[p, 1] - there[1, v]
                off, far = -_HALF * (off_x * off_x + off_y * off_y), np.sqrt(x * x + y * y)
                heard = cos * turn[0, v] + sin * turn[1, v] > _COS and floor[v] == a.floor[p] and voter[v] // k != i
                near, wider = _NEAR + _SLOPE * far, _WIDE + _WIDE_SLOPE * far
                sharp[t, v] = exp(off / (near * near)) if heard else _0
                wide[t, v] = exp(off / (wider * wider)) if heard else _0
        near_say, wide_say = np.dot(sharp, voice), np.dot(wide, voice)
        for t in range(k):
            found[i, t, 0], found[i, t, 1] = near_say[t], wide_say[t]
            most = max(most, wide_say[t] + _LEAST_VOICE)
    for i in range(n):
        for t in range(k):
            found[i, t, 2] = found[i, t, 1] / most
    return found


@compiled
def _motions(s: WallRows, a: WallRows, column: Index, voter: Index) -> tuple[Array32, Array32, Array32, Index]:
    """Of V voters: (2, V) positions of their S walls, cosines and sines of their motions, positions of their A walls,
    and (V,) storeys.
    """
    size = len(voter)
    own, turn = np.empty((2, size), dtype=np.float32), np.empty((2, size), dtype=np.float32)
    there, floor = np.empty((2, size), dtype=np.float32), np.empty(size, dtype=np.int64)
    for v in range(size):
        i = voter[v] // column.shape[1]
        p = max(column[i, voter[v] - i * column.shape[1]], 0)
        own[0, v], own[1, v], there[0, v], there[1, v] = s.pose[i, 0], s.pose[i, 1], a.pose[p, 0], a.pose[p, 1]
        turn[0, v], turn[1, v] = _turn(s.pose[i, 2], s.pose[i, 3], a.pose[p, 2], a.pose[p, 3])
        floor[v] = a.floor[p]
    return own, turn, there, floor


@compiled
def _turn(c: np.float32, s: np.float32, u: np.float32, v: np.float32) -> tuple[np.float32, np.float32]:
    """Cosine and sine of the angle from one heading to another."""
    return c * u + s * v, c * v - s * u


@compiled
def _voters(likely: Array32, size: Array32) -> tuple[Index, Array32]:
    """(V,) the likeliest and largest candidates as positions in `likely` (N, K), and their shares of the total
    weight.
    """
    n, k = likely.shape
    most, count, total = min(VOTERS, n * k), 0, _0
    found, voice = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.float32)
    for i in range(n):
        for t in range(k):
            new = likely[i, t] * size[i]
            at = count
            while at > 0 and new > voice[at - 1]:
                at -= 1
                if at + 1 < most:
                    found[at + 1], voice[at + 1] = found[at], voice[at]
            if at < most:
                found[at], voice[at] = i * k + t, new
                count = min(count + 1, most)
    for v in range(most):
        total += voice[v]
    for v in range(most):
        voice[v] /= max(total, _LEAST_VOICE)
    return found, voice
