"""Wall association: which planned wall each mapped one stands at, given the place of the map in the plan."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import WallSurface
from sgslam.config.sensor import BUILDING

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
GATE_ANGLE = 0.07  # rad between a mapped wall and the planned one it may be
_OTHER_ROOM = 0.1  # m, penalty of a planned wall of another room
_BESIDE = 0.2  # m, penalty of a planned wall that does not overlap the mapped one at all
_LEAST_SHARE = 0.3  # of the shorter wall that must overlap the other
_EXPLAINED = 0.35  # of a mapped wall's length that planned walls of one plane must overlap


@dataclass(frozen=True)
class WallArrays:
    """N wall surfaces in plan view: centres and normals (N, 2), half lengths (N,), room numbers (N,) or -1."""

    centre: Floats
    normal: Floats
    half: Floats
    room: Index

    @staticmethod
    def of(surfaces: list[WallSurface], rooms: dict[str, int], origin: Floats) -> "WallArrays":
        """Arrays of surfaces, moved by -`origin` (2,); `rooms` numbers the rooms."""
        centre = np.array([w.centroid for w in surfaces], dtype=float).reshape(-1, 2) - origin
        normal = np.array([w.normal for w in surfaces], dtype=float).reshape(-1, 2)
        half = np.array([0.5 * (w.length or 1.0) for w in surfaces])
        return WallArrays(centre, normal, half, np.array([rooms.get(w.room or "", -1) for w in surfaces], np.int64))

    def moved(self, T_plan_map: Floats) -> "WallArrays":
        """The surfaces under a motion (3,), yaw x y."""
        c, s = np.cos(T_plan_map[0]), np.sin(T_plan_map[0])
        R = np.array([[c, -s], [s, c]])
        return WallArrays(self.centre @ R.T + T_plan_map[1:], self.normal @ R.T, self.half, self.room)


def associate_walls(seen: WallArrays, planned: WallArrays, reach: float, max_turn: float) -> Index:
    """(N,) the planned wall that each mapped one, already placed in the plan, stands at; -1 for none.

    Candidates face the same way (`max_turn`, rad), lie within `reach` metres across, and overlap a good part of the
    mapped wall. The nearest is taken; one of the room that the mapped wall's room mostly corresponds to is preferred. A
    mapped wall off the plane is not associated with a short stub of the plan.
    """
    if not len(seen.half) or not len(planned.half):
        return np.full(len(seen.half), -1, dtype=np.int64)
    away = seen.centre[:, None] - planned.centre[None]
    signed = np.einsum("ijk,jk->ij", away, planned.normal)
    off = np.abs(signed)
    along = np.abs(away[..., 1] * planned.normal[:, 0] - away[..., 0] * planned.normal[:, 1])
    shorter = np.minimum(seen.half[:, None], planned.half[None])
    beside = np.clip((seen.half[:, None] + planned.half[None] - along) / (2 * shorter), 0.0, 1.0)
    facing = seen.normal @ planned.normal.T > np.cos(max_turn)
    cost = np.where(facing & (off < reach) & (beside > _LEAST_SHARE), off + _BESIDE * (1 - beside), np.inf)
    overlap = np.where(facing, np.clip(seen.half[:, None] + planned.half[None] - along, 0.0, 2 * shorter), 0.0)
    cost = np.where(_stubs(signed, overlap / (2 * seen.half[:, None]), np.isfinite(cost)), np.inf, cost)
    home = _homes(seen, planned, cost)
    elsewhere = (home[:, None] >= 0) & (planned.room[None] != home[:, None])
    cost = cost + np.where(elsewhere, _OTHER_ROOM, 0.0)
    best = cost.argmin(axis=1)
    return np.where(np.isfinite(cost[np.arange(len(best)), best]), best, -1)


def _stubs(off: Floats, share: Floats, possible: Flags) -> Flags:
    """(N, M) flags of candidates that, with all planned walls in their plane, overlap too little of the mapped one.

    `off` (N, M) are signed distances across (m), `share` (N, M) the overlaps as shares of the mapped wall's length.
    """
    stubs = np.zeros_like(possible)
    for i in np.flatnonzero((possible & (np.abs(off) > BUILDING.thinnest_wall)).any(axis=1)).tolist():
        own = np.flatnonzero(possible[i] & (np.abs(off[i]) > BUILDING.thinnest_wall))
        in_plane = np.abs(off[i, own][:, None] - off[i][None]) < BUILDING.thinnest_wall
        stubs[i, own] = (in_plane * share[i]).sum(axis=1) < _EXPLAINED
    return stubs


def _homes(seen: WallArrays, planned: WallArrays, cost: Floats) -> Index:
    """(N,) the planned room that each mapped wall's room mostly corresponds to; -1 where that is not known."""
    best = cost.argmin(axis=1)
    known = np.isfinite(cost[np.arange(len(best)), best]) & (seen.room >= 0) & (planned.room[best] >= 0)
    if not known.any():
        return np.full(len(best), -1, dtype=np.int64)
    votes = np.zeros((int(seen.room.max()) + 1, int(planned.room.max()) + 1))
    np.add.at(votes, (seen.room[known], planned.room[best[known]]), seen.half[known])
    home = np.where(votes.max(axis=1) > 0, votes.argmax(axis=1), -1)
    return np.where(seen.room >= 0, home[seen.room], -1)
