"""SE(2) consensus: the place of the map in the plan that most walls agree on, and which walls agree.

Walls that were built elsewhere, and wrong matches, each suggest another place; correct ones agree. So the place is the
mode of what the walls suggest, not their mean: a third or even half of them may be off.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.geometry import se2
from sgslam.geometry.compiled import add_row, solved

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_LISTED = 60  # walls whose pairs propose places, the longest first
_SCALES = (0.05, 0.035, 0.025)  # m, of the Geman-McClure loss, decreasing; the last is the narrowest gate, too
_WIDEST_GATE = 0.06  # m; the gate follows the scatter of the walls
_REFINED = 3  # places that are refined
_ACROSS = 0.5  # sine of the angle between walls that fix a place together


@dataclass(frozen=True)
class Pairs:
    """N mapped walls and their planned ones in plan view: centres and inward normals (N, 2), mapped lengths (N,).

    Pairs of one `unit` (N,) belong to one wall of the building and share one vote.
    """

    seen: Floats
    seen_normal: Floats
    planned: Floats
    planned_normal: Floats
    length: Floats
    unit: NDArray[np.int64]

    def offsets(self, T_plan_map: Floats) -> Floats:
        """(N,) or (K, N) offsets (m) of the mapped walls before their planned ones, under motions (..., 3), yaw x y."""
        away = se2.apply(T_plan_map[..., None, :], self.seen) - self.planned
        return np.asarray(np.sum(away * self.planned_normal, axis=-1))

    def turns(self, T_plan_map: Floats) -> Floats:
        """(N,) angles (rad) from the planned normals to the mapped ones, under a motion (3,)."""
        heading = np.arctan2(self.seen_normal[:, 1], self.seen_normal[:, 0]) + T_plan_map[0]
        turn = heading - np.arctan2(self.planned_normal[:, 1], self.planned_normal[:, 0])
        return np.asarray((turn + np.pi) % (2 * np.pi) - np.pi)

    def votes(self) -> Floats:
        """(N,) votes: a unit's vote grows with the root of its length and is divided among its pieces."""
        total = np.bincount(self.unit, self.length)
        return np.asarray(np.sqrt(np.minimum(total, 6.0) / np.maximum(total, 1e-9) ** 2)[self.unit] * self.length)


class Consensus(NamedTuple):
    """The place `T_plan_map` (3,), yaw x y; `agree` (N,) flags walls within `gate` (m), with `share` of the votes."""

    T_plan_map: Floats
    agree: Flags
    gate: float
    share: float


def find_consensus(pairs: Pairs, T_plan_map: Floats) -> Consensus | None:
    """The place that most walls agree on, near a rough `T_plan_map` (3,).

    Each pair of walls that are not parallel proposes a place. The places are scored by the votes of all walls under a
    Geman-McClure loss; the best are refined by reweighted least squares. None where fewer than three units agree, or
    their normals leave a direction free.
    """
    votes, start = pairs.votes(), T_plan_map.copy()
    if not len(votes):
        return None
    start[0] -= _weighted_median(pairs.turns(T_plan_map), votes)
    middle, scales = np.average(pairs.seen, axis=0, weights=votes), np.repeat(_SCALES, 4)
    walls = pairs.seen, pairs.planned, pairs.planned_normal
    found = [_refined(*walls, votes, middle, place, scales) for place in _places(pairs, votes, start)]
    if not found:
        return None
    best = max(found, key=lambda T: _support(pairs, votes, T[None], _SCALES[-1])[0])
    off = np.abs(pairs.offsets(best))
    near = off < _WIDEST_GATE
    if not near.any():
        return None
    scatter = 1.48 * _weighted_median(off[near], votes[near])
    gate = float(np.clip(3.5 * scatter, _SCALES[-1], _WIDEST_GATE))
    agree = off < gate
    if not determined(pairs.planned_normal[agree]) or len(np.unique(pairs.unit[agree])) < 3:
        return None
    return Consensus(best, agree, gate, float(votes[agree].sum() / votes.sum()))


def determined(normals: Floats) -> bool:
    """Whether walls with these normals (N, 2) constrain all directions, so that their offsets determine a place."""
    return len(normals) >= 2 and bool(np.linalg.svd(normals, compute_uv=False)[1] >= _ACROSS)


def _places(pairs: Pairs, votes: Floats, start: Floats) -> list[Floats]:
    """The best-supported of the places (3,) that pairs of walls propose, with the heading of `start`."""
    listed = np.argsort(-votes, kind="stable")[:_LISTED]
    i, j = (listed[part] for part in np.triu_indices(len(listed), 1))
    n, m = pairs.planned_normal[i], pairs.planned_normal[j]
    sine = n[:, 0] * m[:, 1] - n[:, 1] * m[:, 0]
    apart = np.abs(sine) > _ACROSS
    if not apart.any():
        return []
    i, j, n, m, sine = i[apart], j[apart], n[apart], m[apart], sine[apart]
    off = pairs.offsets(start)
    # n.t = -off_i and m.t = -off_j
    step = np.column_stack([off[j] * n[:, 1] - off[i] * m[:, 1], off[i] * m[:, 0] - off[j] * n[:, 0]]) / sine[:, None]
    places = start + np.column_stack([np.zeros(len(step)), step])
    places = np.concatenate([start[None], places])
    order = np.argsort(-_support(pairs, votes, places, _SCALES[0]), kind="stable")
    kept: list[Floats] = []
    for k in order.tolist():
        if all(np.hypot(*(places[k] - other)[1:]) > _SCALES[-1] for other in kept):
            kept.append(places[k])
        if len(kept) == _REFINED:
            break
    return kept


def _support(pairs: Pairs, votes: Floats, places: Floats, scale: float) -> Floats:
    """(K,) votes for the places (K, 3), weighted by the walls' offsets (Geman and McClure 1987)."""
    return np.asarray((votes * scale**2 / (scale**2 + pairs.offsets(places) ** 2)).sum(axis=1))


@compiled
def _refined(
    seen: Floats, planned: Floats, planned_normal: Floats, votes: Floats, middle: Floats, place: Floats, scales: Floats
) -> Floats:
    """A place after a step of reweighted least squares for each scale; rotations are about the `middle` (2,)."""
    yaw, x, y = place
    J = np.empty(3)
    for scale in scales:
        H, g = np.zeros((3, 3)), np.zeros(3)
        H[0, 0], H[1, 1], H[2, 2] = 1e-2, 1e-3, 1e-3  # keeps a place with hardly any support from diverging
        c, s = math.cos(yaw), math.sin(yaw)
        at_x, at_y = c * middle[0] - s * middle[1] + x, s * middle[0] + c * middle[1] + y
        for i in range(len(seen)):
            arm_x, arm_y = seen[i, 0] - middle[0], seen[i, 1] - middle[1]
            turned_x, turned_y = c * arm_x - s * arm_y, s * arm_x + c * arm_y
            nx, ny = planned_normal[i]
            off = nx * (turned_x + at_x - planned[i, 0]) + ny * (turned_y + at_y - planned[i, 1])
            weight = votes[i] * (scale**2 / (scale**2 + off**2)) ** 2
            J[0], J[1], J[2] = ny * turned_x - nx * turned_y, nx, ny
            add_row(H, g, J, off, weight)
        step = solved(H, g)
        yaw -= step[0]
        c, s = math.cos(yaw), math.sin(yaw)
        x, y = at_x - step[1] - (c * middle[0] - s * middle[1]), at_y - step[2] - (s * middle[0] + c * middle[1])
    return np.array([yaw, x, y])


def _weighted_median(values: Floats, weights: Floats) -> float:
    return float(np.quantile(values, 0.5, weights=weights, method="inverted_cdf"))
