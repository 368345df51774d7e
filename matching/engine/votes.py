"""Votes for the motions that align walls with those of a storey (generalised Hough transform).

A pair of similar corners determines a proper SE(2) motion. Votes are gathered in yaw first, then in the plane, after
D. H. Ballard, "Generalizing the Hough transform to detect arbitrary shapes", Pattern Recognition 13 (1981).
"""

from typing import NamedTuple

import numpy as np

from data.common.compiled import compiled
from data.geometry import se2
from data.geometry.se2 import Array
from matching.arrays import Index, Walls
from matching.engine.corners import Marks
from matching.engine.field_loops import FAR, SAME_DIRECTION, SIGMA_HEADING, of_direction, off_lines, wrapped
from matching.engine.plan_walls import PlanWalls

OPENING = float(np.radians(12))  # like corners differ by less
YAW_BIN = float(np.radians(2))
YAW_MODES = 16
PLACE_BIN = 0.3  # metres


class Votes(NamedTuple):
    """V votes: a point of the map (V, 2) that should come to lie on one of the plan (V, 2), and the yaw (V,) of the
    motion."""

    point: Array
    a_point: Array
    yaw: Array


def corner_votes(s: Marks, a: Marks) -> Votes:
    """The votes of all pairs of similar corners."""
    i, j, yaw = _alike(s.kind, s.opening, s.heading, a.kind, a.opening, a.heading)
    return Votes(s.point[i], a.point[j], yaw)


def candidates(votes: Votes, most: int) -> Array:
    """Returns (K, 3) the motions (yaw, x, y) with most votes, at most `most` for each yaw mode."""
    if not len(votes.yaw):
        return np.zeros((0, 3))
    return np.concatenate([_motions(mode, votes, most) for mode in _yaw_modes(votes.yaw)])


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


def _yaw_modes(yaw: Array) -> Array:
    """(M,) modes of the yaws, each the mean of those nearby."""
    bins = round(2 * np.pi / YAW_BIN)
    count = np.bincount(np.floor((yaw + np.pi) / YAW_BIN).astype(np.int64) % bins, minlength=bins)
    smooth = np.sum([(3 - abs(k)) * np.roll(count, -k) for k in range(-2, 3)], axis=0)
    angle = np.arange(0.5 - bins / 2, bins / 2) * YAW_BIN
    modes: list[float] = []
    least = 0.1 * smooth.max()
    while len(modes) < YAW_MODES and smooth.max() >= least:
        peak = float(angle[smooth.argmax()])
        off = se2.wrap(yaw - peak)
        near = np.abs(off) <= 2.5 * YAW_BIN + 1e-9  # rounding must not lose votes at the edge of a bin
        modes.append(peak + off[near].mean())
        smooth[(angle == peak) | (np.abs(se2.wrap(angle - modes[-1])) <= 4 * YAW_BIN)] = -1.0
    return np.array(modes)


def _motions(mode: float, votes: Votes, most: int) -> Array:
    """(K, 3) motions with the mode's yaw to the places that votes with a similar yaw are for."""
    near = np.abs(se2.wrap(votes.yaw - mode)) < 3 * YAW_BIN
    places = _places(votes.a_point[near] - se2.rotate(mode, votes.point[near]))[:most]
    return np.column_stack((np.full(len(places), mode), places))


def _places(place: Array) -> Array:
    """(K, 2) peaks of votes for places (V, 2), most votes first: means over 3 x 3 bins around local maxima.

    The bins are sparse, since plans may be kilometres apart.
    """
    cell = np.floor(place / PLACE_BIN).astype(np.int64)
    cell -= cell.min(axis=0) - 1
    stride = cell[:, 1].max() + 2
    keys, bin_of = np.unique(cell[:, 0] * stride + cell[:, 1], return_inverse=True)
    own = np.column_stack([np.bincount(bin_of, each) for each in (None, *place.T)])
    total, most = own.copy(), np.zeros(len(keys))
    neighbours = []
    for shift in (-stride - 1, -stride, 1 - stride, -1, 1, stride - 1, stride, stride + 1):
        there = np.minimum(np.searchsorted(keys, keys + shift), len(keys) - 1)
        here = np.flatnonzero(keys[there] == keys + shift)
        total[here] += own[there[here]]
        neighbours.append((here, there[here]))
    for here, there in neighbours:
        most[here] = np.maximum(most[here], total[there, 0])
    peak = total[total[:, 0] >= most]
    peak = peak[np.argsort(-peak[:, 0], kind="stable")]
    return peak[:, 1:] / peak[:, :1]
