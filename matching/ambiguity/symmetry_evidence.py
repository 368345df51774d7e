"""Places a part of a building at another place of it, and measures what distinguishes the two."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry import se2
from data.geometry.se2 import Array
from data.synthetic_maps.noise_models import DRIFT_XY, DRIFT_YAW
from data.synthetic_maps.wall_noise import LONGEST_CLUTTER, SIGMA_ACROSS, SIGMA_END
from matching.arrays import Index, Walls
from matching.search.hypotheses import groups_of

SIGMA_TURN, TURNED = float(np.radians(1)), float(np.radians(3))
# Nats of a wall of the map where the plan has none. Of 0.9 walls for each of the plan's, off across and at both ends by
# the map's noise and turned by SIGMA_TURN, the log density is 3 in the mean (m, m, m, rad); that of clutter, 0.1 for
# each wall of the room, somewhere before it, of any length up to the longest, -4. Longer than that no clutter is: one
# wall in a million may be missing in the plan. Niches and pillars are often drawn otherwise.
NO_WALL, NO_WALL_SHORT, NO_WALL_LONG = 7.0, 2.0, 14.0
SHORT = 0.8  # m
LOOSENED = (3.0, 2.0, 1.0, 1.0)  # by how much the gates are wider, step by step
AT_ONCE = 200_000  # pairs of walls, of several motions
HOLD = 1e-6  # of what the walls leave open


@dataclass(frozen=True, eq=False)
class Part:
    """Walls that move together if the map is rigid, room by room if it is deformed."""

    walls: Walls
    goes_on: NDArray[np.bool_]  # (N, 2) the wall goes on beyond its end, against and along its tangent
    group: Index  # (N,)
    centre: Array  # (G, 2)
    links: Index  # (L, 2) groups between which the map may deform


@dataclass(frozen=True, eq=False)
class PlacedPart:
    """A part at a place: the `partner` (N,) of each wall, -1 for none, its `cost` (N,) in nats, and the cost of
    bending.
    """

    state: Array  # (G, 3) yaw, and the place of each group's centre
    partner: Index
    cost: Array
    bending: float

    @property
    def nats(self) -> float:
        """The total cost of walls and bending."""
        return float(self.cost.sum() + self.bending)

    def motion(self, part: Part) -> Array:
        """(3,) the motion between own frames nearest to those of the groups, all weighted alike."""
        yaw = float(np.angle(np.exp(1j * self.state[:, 0]).sum()))
        return np.array([yaw, *(self.state[:, 1:].mean(axis=0) - se2.rotate(yaw, part.centre.mean(axis=0)))])


def part_of(walls: Walls, goes_on: NDArray[np.bool_], deformed: bool) -> Part:
    """Returns walls as a part. If the map is deformed, its rooms are linked by a shortest tree; otherwise all is one
    group.
    """
    group = groups_of(walls) if deformed else np.zeros(len(walls), dtype=np.int64)
    size = np.bincount(group)
    centre = np.stack([np.bincount(group, walls.centre[:, k]) / size for k in (0, 1)], axis=-1)
    return Part(walls, goes_on, group, centre, _tree(centre))


def place_part(part: Part, storey: Walls, motions: Array) -> Iterator[PlacedPart]:
    """Places a part by each of the motions (M, 3) between own frames, and refines each placement.

    Gauss-Newton on the walls' offsets across and at their ends, each to the wall with the lowest cost.
    """
    most = max(1, AT_ONCE // (len(part.walls) * max(1, len(storey))))
    for first in range(0, len(motions), most):
        moved = motions[first : first + most, None]  # (M, 1, 3)
        turned = np.broadcast_to(moved[..., :1], (len(moved), len(part.centre), 1))
        state = np.concatenate((turned, se2.apply(moved, part.centre)), axis=-1)
        for loosened in LOOSENED:
            state = _step(part, storey, state, loosened)
        cost, partner, *_ = _pairs(part, storey, state, 1.0)
        residual, _ = _drift_residual(part, state)
        yield from map(PlacedPart, state, partner, cost, 0.5 * np.einsum("mi,mi->m", residual, residual))


def _pairs(part: Part, storey: Walls, state: Array, loosened: float) -> tuple[Array, Index, Array, Array]:
    """Associates walls for M states (M, G, 3).

    Returns (M, N) cost and partner, (M, N, 4) offsets across, at both ends and in direction in sigmas, and (M, N, 2)
    the mid points.
    """
    walls = part.walls
    yaw = state[:, part.group, 0]
    placed = se2.rotate(yaw, walls.centre - part.centre[part.group]) + state[:, part.group, 1:]
    apart = placed[:, :, None] - storey.centre
    across = np.einsum("mijk,jk->mij", apart, storey.normal)
    along = np.einsum("mijk,jk->mij", apart, storey.tangent)
    slack = walls.half[:, None] - storey.half[None]
    known = walls.known[:, None] & storey.known[None]
    beyond = along + slack, along - slack  # of the ends along the tangent and against it; a wall that goes on may be
    beyond = (
        np.maximum(beyond[0], np.where(part.goes_on[:, 1:], 0.0, -np.inf)),
        np.minimum(  # longer there
            beyond[1], np.where(part.goes_on[:, :1], 0.0, np.inf)
        ),
    )
    ends = [np.where(known, end, 0.0) / SIGMA_END for end in beyond]
    turned = se2.wrap((walls.heading + yaw)[:, :, None] - storey.heading)
    off = np.stack((across / SIGMA_ACROSS, *ends, turned / SIGMA_TURN), axis=-1)
    cost = 0.5 * np.einsum("mijk,mijk->mij", off, off) / loosened**2
    beside = np.abs(along) < walls.half[:, None] + storey.half[None]
    cost = np.where((np.abs(turned) < TURNED * loosened) & beside, cost, np.inf)
    best = cost.argmin(axis=2)
    m, n = np.ogrid[: len(state), : len(walls)]
    length = 2 * walls.half
    most = np.select([length < SHORT, length > LONGEST_CLUTTER], [NO_WALL_SHORT, NO_WALL_LONG], NO_WALL)
    least = cost[m, n, best]
    return np.minimum(least, most), np.where(least < most, best, -1), off[m, n, best], placed


def _step(part: Part, storey: Walls, state: Array, loosened: float) -> Array:
    """One step of least squares on the motions of the groups' centres."""
    count, groups, walls = *state.shape[:2], np.arange(len(part.walls))
    _, partner, off, placed = _pairs(part, storey, state, loosened)
    on = (partner >= 0)[..., None]  # the others' rows are empty
    off = np.where(on, off, 0.0)
    lever = placed - state[:, part.group, 1:]

    def rows(turn: Array, d: Array) -> Array:
        found = np.zeros((count, len(walls), groups, 3))
        found[:, walls, part.group] = np.where(on, np.concatenate((turn[..., None], d), axis=-1), 0.0)
        return found.reshape(count, len(walls), 3 * groups)

    both = []
    for d in (storey.normal[partner] / SIGMA_ACROSS, storey.tangent[partner] / SIGMA_END):
        both.append(rows(d[..., 1] * lever[..., 0] - d[..., 0] * lever[..., 1], d))
    across, along = both
    ends = [np.where(off[..., k, None] == 0, 0.0, along) for k in (1, 2)]  # nothing holds a wall that may go on
    turned = rows(np.full(placed.shape[:2], 1 / SIGMA_TURN), np.zeros_like(placed))
    residual, J_drift = _drift_residual(part, state)
    J = np.concatenate((across, *ends, turned, J_drift), axis=1)
    r = np.concatenate((np.moveaxis(off, 2, 1).reshape(count, -1), residual), axis=1)[..., None]
    J_T = np.swapaxes(J, 1, 2)
    step = np.linalg.solve(J_T @ J + HOLD * np.eye(3 * groups), -J_T @ r)
    return np.asarray(state + step.reshape(state.shape))


def _drift_residual(part: Part, state: Array) -> tuple[Array, Array]:
    """(M, 3 L) how far linked groups moved differently, in sigmas of one step of drift, and its Jacobian (M, 3 L, 3
    G).
    """
    g, h = part.links.T
    count, groups = state.shape[:2]
    arm = se2.rotate(state[:, g, 0], part.centre[h] - part.centre[g])
    sigma = np.array([DRIFT_YAW, DRIFT_XY, DRIFT_XY])
    moved = state[:, h] - state[:, g]
    off = np.concatenate((se2.wrap(moved[..., :1]), moved[..., 1:] - arm), axis=-1) / sigma
    J = np.zeros((count, len(g), 3, groups, 3))
    n = np.arange(len(g))
    for k in range(3):
        J[:, n, k, h, k], J[:, n, k, g, k] = 1 / sigma[k], -1 / sigma[k]
    J[:, n, 1, g, 0], J[:, n, 2, g, 0] = arm[..., 1] / DRIFT_XY, -arm[..., 0] / DRIFT_XY
    return off.reshape(count, -1), J.reshape(count, 3 * len(g), 3 * groups)


def _tree(points: NDArray[np.float64]) -> Index:
    """(G - 1, 2) the shortest tree that links the points."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    reach, parent = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    left, new, links = set(range(1, len(points))), 0, []
    while left:
        nearer = distance[new] < reach
        reach, parent = np.where(nearer, distance[new], reach), np.where(nearer, new, parent)
        new = min(left, key=lambda k: reach[k])
        links.append((int(parent[new]), new))
        left.remove(new)
    return np.array(links, dtype=np.int64).reshape(-1, 2)
