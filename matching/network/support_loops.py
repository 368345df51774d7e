"""`consensus.support` as a compiled loop for graphs on the CPU."""

from typing import NamedTuple

import numpy as np

from data.common.compiled import compiled
from matching.arrays import Index
from matching.network.arithmetic import exp
from matching.network.dimensions import CLOSE_M, COMPARED_SIZE, LEAST_COS, LEFT_M, OFFSET_M, SCALES_M
from matching.network.features import Array32

OFFSETS = 6  # columns given at all scales: all remaining offsets, and those across unreduced
REST = COMPARED_SIZE - OFFSETS * len(SCALES_M)  # of the other columns
_COS, _LEFT, _OFFSET, _CLOSE = (np.float32(x) for x in (LEAST_COS, LEFT_M, OFFSET_M, CLOSE_M))
_0, _HALF, _2, _8, _10 = np.float32(0), np.float32(0.5), np.float32(2), np.float32(8), np.float32(10)
_SHARES = 1 / np.array(SCALES_M, dtype=np.float32)


class WallRows(NamedTuple):
    """N walls of a graph."""

    pose: Array32  # (N, 4) centre, and cosine and sine of the heading
    half: Array32  # (N,) half the length
    room: Index  # (N,) the same number for walls of one room, -1 where it is not known
    floor: Index  # (N,)
    near: Index  # (N, HEARD) the nearest walls, -1 where there are fewer


@compiled
def combinations(s: WallRows, a: WallRows, candidate: Index) -> tuple[Index, Index, Array32]:
    """Returns the combinations of candidates (N, K), -1 for none: pair and other (E,), and (E, COMPARED_SIZE) as in
    `consensus.Support`.
    """
    pair, other = _near(s, candidate, _places(candidate, s.pose, a))
    offset, rest = np.empty((len(pair), OFFSETS), dtype=np.float32), np.empty((len(pair), REST), dtype=np.float32)
    count = _compared(s, a, candidate, pair, other, offset, rest)
    return pair[:count], other[:count], _columns(offset[:count], rest[:count])


@compiled
def _places(candidate: Index, pose_s: Array32, a: WallRows) -> Array32:
    """(N, 5, K) of each wall's candidates: cosine and sine of the angle to them, x, y, storey (-1: no candidate)."""
    found = np.full((candidate.shape[0], 5, candidate.shape[1]), np.float32(-1))
    for i in range(candidate.shape[0]):
        for t in range(candidate.shape[1]):
            p = candidate[i, t]
            if p >= 0:
                c, s, u, v = pose_s[i, 2], pose_s[i, 3], a.pose[p, 2], a.pose[p, 3]
                found[i, 0, t], found[i, 1, t] = c * u + s * v, c * v - s * u
                found[i, 2, t], found[i, 3, t], found[i, 4, t] = a.pose[p, 0], a.pose[p, 1], a.floor[p]
    return found


@compiled
def _near(s: WallRows, candidate: Index, place: Array32) -> tuple[Index, Index]:
    """(F,) and (F,) pairs whose partners may belong together: on one storey, at a similar angle and distance."""
    width, most, count = candidate.shape[1], 8 * candidate.size, 0
    pair, other = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    fits = np.empty(width, dtype=np.bool_)
    for i in range(len(candidate)):
        for j in s.near[i]:
            if j < 0:
                continue
            if count + width * width > most:
                most = 2 * most + width * width
                pair, other = _longer(pair, most), _longer(other, most)
            east, north = s.pose[j, 0] - s.pose[i, 0], s.pose[j, 1] - s.pose[i, 1]
            far = np.sqrt(east * east + north * north)
            low, high = max(far - _OFFSET, _0), far + _OFFSET
            low, high = low * low, high * high
            for t in range(width):
                cos, sin, x, y, floor = place[i, 0, t], place[i, 1, t], place[i, 2, t], place[i, 3, t], place[i, 4, t]
                if floor < 0:
                    continue
                some = False
                for u in range(width):
                    right, up = place[j, 2, u] - x, place[j, 3, u] - y
                    square = right * right + up * up
                    alike = (cos * place[j, 0, u] + sin * place[j, 1, u] > _COS) & (floor == place[j, 4, u])
                    fits[u] = alike & (square > low) & (square < high)
                    some |= fits[u]
                for u in range(width if some else 0):
                    pair[count], other[count] = i * width + t, j * width + u
                    count += fits[u]
    return pair[:count], other[:count]


@compiled
def _longer(values: Index, size: int) -> Index:
    found = np.empty(size, dtype=np.int64)
    found[: len(values)] = values
    return found


@compiled
def _compared(
    s: WallRows, a: WallRows, candidate: Index, pair: Index, other: Index, offset: Array32, rest: Array32
) -> int:
    """Keeps the pairs (F,) and (F,) that are alike in both graphs; writes (F, OFFSETS) metres and (F, REST) other
    columns, as `relations.compared`; returns the number of pairs kept.
    """
    width, count = candidate.shape[1], 0
    for n in range(len(pair)):
        i, j = pair[n] // width, other[n] // width
        p, q = candidate[i, pair[n] - i * width], candidate[j, other[n] - j * width]
        in_s = _related(
            s.pose[j, 0] - s.pose[i, 0], s.pose[j, 1] - s.pose[i, 1],
            s.pose[i, 2], s.pose[i, 3], s.pose[j, 2], s.pose[j, 3],
        )  # fmt: skip
        in_a = _related(
            a.pose[q, 0] - a.pose[p, 0], a.pose[q, 1] - a.pose[p, 1],
            a.pose[p, 2], a.pose[p, 3], a.pose[q, 2], a.pose[q, 3],
        )  # fmt: skip
        one, two = abs(s.half[i] - a.half[p]), abs(s.half[j] - a.half[q])
        across, along, across_j, along_j = _left(in_s, in_a, one, two)
        if max(max(across, along), max(across_j, along_j)) >= _LEFT:
            continue
        offset[count, 0], offset[count, 1], offset[count, 2], offset[count, 3] = across, along, across_j, along_j
        offset[count, 4], offset[count, 5] = abs(in_s[0] - in_a[0]), abs(in_s[2] - in_a[2])
        cos, sin = in_s[4] * in_a[4] + in_s[5] * in_a[5], in_s[5] * in_a[4] - in_s[4] * in_a[5]
        far = np.sqrt(in_s[0] * in_s[0] + in_s[1] * in_s[1])
        with_room, same_s = s.room[i] >= 0 and s.room[j] >= 0, s.room[i] == s.room[j]
        same_a = a.room[p] == a.room[q] and a.room[p] >= 0
        rest[count, 0] = _10 * abs(sin) / np.sqrt(_2 + _2 * cos)  # ten times the sine of half the angle
        rest[count, 1], rest[count, 2] = abs(in_s[4]), in_s[4] < -_COS
        rest[count, 3], rest[count, 4] = exp(-far * _HALF), far / _8
        rest[count, 5], rest[count, 6] = same_s and with_room, same_s == same_a and with_room
        rest[count, 7], rest[count, 8] = p == q, one + two
        pair[count], other[count] = pair[n], other[n]
        count += 1
    return count


@compiled
def _columns(offset: Array32, rest: Array32) -> Array32:
    """(E, COMPARED_SIZE) the offsets (E, OFFSETS) at all scales, and the other columns."""
    scales, near = len(SCALES_M), np.empty(offset.size, dtype=np.float32)
    found, flat = np.empty((len(offset), COMPARED_SIZE), dtype=np.float32), offset.reshape(offset.size)
    for k in range(scales):
        for n in range(len(flat)):
            share = flat[n] * _SHARES[k]
            near[n] = exp(-share * share)
        for e in range(len(offset)):
            for d in range(OFFSETS):
                found[e, d * scales + k] = near[e * OFFSETS + d]
    for e in range(len(offset)):
        for d in range(REST):
            found[e, OFFSETS * scales + d] = rest[e, d]
    return found


@compiled
def _related(
    x: np.float32, y: np.float32, c: np.float32, s: np.float32, u: np.float32, v: np.float32
) -> tuple[np.float32, np.float32, np.float32, np.float32, np.float32, np.float32]:
    """As `relations.Relation`, for walls with headings (c, s) and (u, v), the second at (x, y) from the first."""
    return x * c + y * s, y * c - x * s, -(x * u + y * v), x * v - y * u, c * u + s * v, c * v - s * u


@compiled
def _left(
    of_s: tuple[np.float32, ...], of_a: tuple[np.float32, ...], one: np.float32, other: np.float32
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """The difference of two relations' offsets, less what wall ends may slide; walls i and j differ in length by `one`
    and `other`.
    """
    cos, sin = abs(of_s[4]), abs(of_s[5])
    return (
        max(abs(of_s[0] - of_a[0]) - other * sin, _0), max(abs(of_s[1] - of_a[1]) - one - other * cos, _0),
        max(abs(of_s[2] - of_a[2]) - one * sin, _0), max(abs(of_s[3] - of_a[3]) - other - one * cos, _0),
    )  # fmt: skip


@compiled
def alike(own: Array32, their: Array32) -> np.float32:
    """The similarity in [0, 1] of two walls of S and two of A, as `relations.close`; (2, 5) poses and half lengths."""
    in_s = _related(own[1, 0] - own[0, 0], own[1, 1] - own[0, 1], own[0, 2], own[0, 3], own[1, 2], own[1, 3])
    in_a = _related(
        their[1, 0] - their[0, 0], their[1, 1] - their[0, 1], their[0, 2], their[0, 3], their[1, 2], their[1, 3]
    )
    if in_s[4] * in_a[4] + in_s[5] * in_a[5] <= _COS:
        return _0
    left = _left(in_s, in_a, abs(own[0, 4] - their[0, 4]), abs(own[1, 4] - their[1, 4]))
    off = left[0] * left[0] + left[1] * left[1] + left[2] * left[2] + left[3] * left[3]
    return exp(-_HALF * off / (_CLOSE * _CLOSE))
