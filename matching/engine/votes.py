"""Votes for the motions that align walls with those of a storey (generalised Hough transform).

A pair of similar corners, or of proposed matches of walls that cross, determines a proper SE(2) motion. Votes are
gathered in yaw first, then in the plane, after
D. H. Ballard, "Generalizing the Hough transform to detect arbitrary shapes", Pattern Recognition 13 (1981).
"""

from typing import NamedTuple

import numpy as np

from data.common.compiled import compiled, compiled_within
from data.geometry.se2 import Array
from data.geometry.se2_compiled import wrapped
from matching.arrays import Index, Walls
from matching.engine.corners import Marks
from matching.engine.field_loops import FAR, SAME_DIRECTION, SIGMA_HEADING, of_direction, off_lines
from matching.engine.plan_walls import PlanWalls

OPENING = float(np.radians(12))  # like corners differ by less
YAW_BIN = float(np.radians(2))
YAW_MODES = 16
PLACE_BIN = 0.3  # metres


class Votes(NamedTuple):
    """V votes: a point of the map (V, 2) that should come to lie on one of the plan (V, 2), the yaw (V,) of the motion,
    and the vote's weight (V,)."""

    point: Array
    a_point: Array
    yaw: Array
    weight: Array

    def with_those(self, other: "Votes") -> "Votes":
        """These votes and others."""
        return Votes(*(np.concatenate(each) for each in zip(self, other, strict=True)))


def corner_votes(s: Marks, a: Marks) -> Votes:
    """The votes of all pairs of similar corners, with weight 1."""
    i, j, yaw = _alike(s.kind, s.opening, s.heading, a.kind, a.opening, a.heading)
    return Votes(s.point[i], a.point[j], yaw, np.ones(len(i)))


def candidates(votes: Votes, most: int) -> Array:
    """Returns (K, 3) the motions (yaw, x, y) with most votes, at most `most` for each yaw mode."""
    if not len(votes.yaw):
        return np.zeros((0, 3))
    return np.concatenate([_motions(mode, *votes, most) for mode in _yaw_modes(votes.yaw, votes.weight)])


def aligned(walls: Walls, plan: PlanWalls, storey: int, motions: Array, sigma: float, least: float = 0.0) -> Array:
    """(K,) the share of the walls' weight that motions (K, 3) between own frames align with a storey's; `sigma` in
    metres across. 0 where it is below `least`.
    """
    _, headings, lines = plan.by_heading
    stretch = int(plan.first[storey]), int(plan.first[storey + 1])
    weight = walls.weight / walls.weight.sum()
    own = np.column_stack((walls.half, walls.heading))
    return np.asarray(_aligned(own, walls.centre, weight, headings, lines, stretch, motions, sigma, least))


@compiled
def _aligned(
    own: Array,
    centre: Array,
    weight: Array,
    headings: Array,
    lines: Array,
    storey: tuple[int, int],
    motions: Array,
    sigma: float,
    least: float,
) -> Array:
    """See `aligned`; lines (6, N) are sorted by heading within each storey."""
    total, off = np.zeros(len(motions)), np.empty(storey[1] - storey[0])
    for k in range(len(motions)):
        yaw, shift_x, shift_y = motions[k]
        cos, sin, left = np.cos(yaw), np.sin(yaw), 1.0
        for i in range(len(own)):
            if total[k] + left < least:
                total[k] = 0.0
                break
            half, heading, best, span = own[i, 0], wrapped(own[i, 1] + yaw), 0.0, 1.6 * min(own[i, 0], 4.0)
            x, y = cos * centre[i, 0] - sin * centre[i, 1] + shift_x, sin * centre[i, 0] + cos * centre[i, 1] + shift_y
            stretch = of_direction(headings, storey[0], storey[1], heading, SAME_DIRECTION)
            for first, last in (stretch[:2], stretch[2:]):
                off_lines(lines, first, last, x, y, off)
                for n in range(first, last):
                    across = off[n - first]
                    if across >= FAR * sigma:
                        continue
                    along = abs(lines[2, n] * y - lines[3, n] * x - lines[5, n])
                    common = min(half + lines[0, n] - along, 2 * min(half, lines[0, n]))
                    beside = min(common / span, 1.0)
                    if beside > best:
                        turned = wrapped(heading - lines[1, n])
                        strange = (0.5 / sigma**2) * across**2 + (0.5 / SIGMA_HEADING**2) * turned**2
                        best = max(best, beside * np.exp(-strange))
            total[k] += weight[i] * best
            left -= weight[i]
    return total


@compiled
def _alike(
    kind: Index, opening: Array, heading: Array, a_kind: Index, a_opening: Array, a_heading: Array
) -> tuple[Index, Index, Array]:
    """Pairs of similar marks, and the yaw that aligns each."""
    most = len(kind) * len(a_kind)
    i, j, yaw, count = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64), np.empty(most), 0
    for m in range(len(kind)):
        for n in range(len(a_kind)):
            if kind[m] == a_kind[n] and abs(opening[m] - a_opening[n]) < OPENING:
                i[count], j[count], yaw[count] = m, n, wrapped(a_heading[n] - heading[m])
                count += 1
    return i[:count].copy(), j[:count].copy(), yaw[:count].copy()


@compiled
def _yaw_modes(yaw: Array, weight: Array) -> Array:
    """(M,) modes of the yaws, each the mean of those nearby."""
    bins = round(2 * np.pi / YAW_BIN)
    count, smooth = np.zeros(bins), np.zeros(bins)
    for v in range(len(yaw)):
        count[int(np.floor((yaw[v] + np.pi) / YAW_BIN)) % bins] += weight[v]
    for n in range(bins):
        for k in range(-2, 3):
            smooth[n] += (3 - abs(k)) * count[(n + k) % bins]
    angle = -np.pi + (np.arange(bins) + 0.5) * YAW_BIN
    least, modes, found = 0.1 * smooth.max(), np.empty(YAW_MODES), 0
    while found < YAW_MODES and smooth.max() >= least:
        peak, total, near = angle[smooth.argmax()], 0.0, 0.0
        for v in range(len(yaw)):
            off = wrapped(yaw[v] - peak)
            if abs(off) < 2.5 * YAW_BIN:
                total += weight[v] * off
                near += weight[v]
        modes[found] = peak + total / near
        for n in range(bins):
            if angle[n] == peak or abs(wrapped(angle[n] - modes[found])) <= 4 * YAW_BIN:
                smooth[n] = -1.0
        found += 1
    return modes[:found]


@compiled
def _motions(mode: float, point: Array, a_point: Array, yaw: Array, weight: Array, most: int) -> Array:
    """(K, 3) motions with the mode's yaw to the places that votes with a similar yaw are for."""
    votes, count, cos, sin = np.empty((len(yaw), 3)), 0, np.cos(mode), np.sin(mode)
    for n in range(len(yaw)):
        if abs(wrapped(yaw[n] - mode)) < 3 * YAW_BIN:
            x, y = point[n, 0], point[n, 1]
            votes[count, 0] = weight[n]
            votes[count, 1] = a_point[n, 0] - (cos * x - sin * y)
            votes[count, 2] = a_point[n, 1] - (sin * x + cos * y)
            count += 1
    places = _places(votes[:count], most)
    motions = np.empty((len(places), 3))
    motions[:, 0], motions[:, 1:] = mode, places
    return motions


@compiled_within
def _places(votes: Array, most: int) -> Array:
    """(K, 2) peaks of votes (V, 3) of weight, x and y, heaviest first: means over 3 x 3 bins around local maxima.

    The bins are sparse, since plans may be kilometres apart.
    """
    cell = np.floor(votes[:, 1:] / PLACE_BIN).astype(np.int64)
    low_x, low_y, stride = cell[:, 0].min() - 1, cell[:, 1].min() - 1, cell[:, 1].max() - cell[:, 1].min() + 3
    key = (cell[:, 0] - low_x) * stride + cell[:, 1] - low_y
    order = np.sort(key * len(key) + np.arange(len(key))) % len(key)  # twice as fast as `argsort`
    total, peak = _around(votes, key, order, stride)
    best = peak[np.argsort(-total[peak, 0], kind="mergesort")][:most]
    return total[best, 1:] / total[best, :1]


@compiled_within
def _around(votes: Array, key: Index, order: Index, stride: int) -> tuple[Array, Index]:
    """(bins, 3) weight and weighted sum of the votes in the 3 x 3 bins around each non-empty bin, and which bins are
    local maxima.

    `key` (V,) are the votes' bins, `order` sorts them.
    """
    bin_of, keys, bins = np.empty(len(key), dtype=np.int64), np.empty(len(key), dtype=np.int64), 0
    for n in order:
        if bins == 0 or key[n] != keys[bins - 1]:
            keys[bins] = key[n]
            bins += 1
        bin_of[n] = bins - 1
    own = np.zeros((bins, 3))
    for n in range(len(key)):
        own[bin_of[n], 0] += votes[n, 0]
        own[bin_of[n], 1] += votes[n, 0] * votes[n, 1]
        own[bin_of[n], 2] += votes[n, 0] * votes[n, 2]
    total, ahead = own.copy(), np.full((bins, 4), -1)  # of the bins around each, those that come later
    shifts, at, peak = (1, stride - 1, stride, stride + 1), np.zeros(4, dtype=np.int64), np.ones(bins, dtype=np.bool_)
    for n in range(bins):
        for side in range(4):
            while at[side] < bins and keys[at[side]] < keys[n] + shifts[side]:
                at[side] += 1
            m = at[side]
            if m < bins and keys[m] == keys[n] + shifts[side]:
                ahead[n, side] = m
                for d in range(3):
                    total[n, d] += own[m, d]
                    total[m, d] += own[n, d]
    for n in range(bins):
        for side in range(4):
            m = ahead[n, side]
            if m >= 0 and total[m, 0] != total[n, 0]:
                peak[n if total[m, 0] > total[n, 0] else m] = False
    return total, np.flatnonzero(peak)
