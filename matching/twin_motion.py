"""A part of a building laid over another place of it: which walls lie on which, and what tells the two apart."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import se2
from data.s_graph_noise import SIGMA_ACROSS, SIGMA_END
from data.s_graph_regimes import DRIFT_XY, DRIFT_YAW
from data.se2 import Array
from matching.hypotheses import groups_of
from matching.walls import Index, Walls

SIGMA_TURN, TURNED = float(np.radians(1)), float(np.radians(3))
NO_WALL = 4.0  # nats
SHORT, NO_WALL_SHORT = 0.8, 2.0  # m, nats: niches and pillars are often drawn otherwise
LOOSENED = (3.0, 2.0, 1.0, 1.0)  # by how much the gates are wider, step by step
HOLD = 1e-6  # of what the walls leave open


@dataclass(frozen=True, eq=False)
class Part:
    """Walls that move together where the map is rigid, room by room where it is bent."""

    walls: Walls
    goes_on: NDArray[np.bool_]  # (N, 2) the wall goes on beyond its end, against and along its tangent
    group: Index  # (N,)
    centre: Array  # (G, 2)
    links: Index  # (L, 2) groups between which the map may bend


@dataclass(frozen=True, eq=False)
class Laid:
    """Of each wall the `partner` (N,), -1 for none, its part in the evidence (N,) nats, and what bending costs."""

    state: Array  # (G, 3) yaw, and the place of each group's centre
    partner: Index
    cost: Array
    bending: float

    @property
    def nats(self) -> float:
        """All that the walls and the bending cost."""
        return float(self.cost.sum()) + self.bending

    def motion(self, part: Part) -> Array:
        """(3,) the motion between own frames that is nearest to those of the groups, whatever their sizes."""
        yaw = float(np.angle(np.exp(1j * self.state[:, 0]).sum()))
        return np.array([yaw, *(self.state[:, 1:].mean(axis=0) - se2.rotate(yaw, part.centre.mean(axis=0)))])


def part_of(walls: Walls, goes_on: NDArray[np.bool_], bent: bool) -> Part:
    """The rooms are linked as a tree, the nearest first, if the map is bent; else all is one group."""
    group = groups_of(walls) if bent else np.zeros(len(walls), dtype=np.int64)
    size = np.bincount(group)
    centre = np.stack([np.bincount(group, walls.centre[:, k]) / size for k in (0, 1)], axis=-1)
    return Part(walls, goes_on, group, centre, _tree(centre))


def lay(part: Part, storey: Walls, motion: Array) -> Laid:
    """Lays the part by a motion (3,) between own frames, which is near, and then as well as it can be.

    Gauss-Newton on what walls are off across and at their ends, each to the wall that costs least.
    """
    groups = len(part.centre)
    state = np.column_stack((np.full(groups, motion[0]), se2.apply(motion, part.centre)))
    for loosened in LOOSENED:
        state = _step(part, storey, state, loosened)
    cost, partner, *_ = _pairs(part, storey, state, 1.0)
    residual, _ = _bent(part, state)
    return Laid(state, partner, cost, 0.5 * float(residual @ residual))


def _pairs(part: Part, storey: Walls, state: Array, loosened: float) -> tuple[Array, Index, Array, Array]:
    """(N,) cost and partner, (N, 4) off across, at both ends and in direction, in sigmas, (N, 2) the middles."""
    walls = part.walls
    yaw = state[part.group, 0]
    placed = se2.rotate(yaw, walls.centre - part.centre[part.group]) + state[part.group, 1:]
    apart = placed[:, None] - storey.centre[None]
    across = np.einsum("ijk,jk->ij", apart, storey.normal)
    along = np.einsum("ijk,jk->ij", apart, storey.tangent)
    slack = walls.half[:, None] - storey.half[None]
    known = walls.known[:, None] & storey.known[None]
    beyond = along + slack, along - slack  # of the ends along the tangent and against it; a wall that goes on may be
    beyond = np.maximum(beyond[0], np.where(part.goes_on[:, 1:], 0.0, -np.inf)), np.minimum(  # longer there
        beyond[1], np.where(part.goes_on[:, :1], 0.0, np.inf)
    )
    ends = [np.where(known, end, 0.0) / SIGMA_END for end in beyond]
    turned = se2.wrap(walls.heading[:, None] + yaw[:, None] - storey.heading[None])
    off = np.stack((across / SIGMA_ACROSS, *ends, turned / SIGMA_TURN), axis=-1)
    cost = 0.5 * np.einsum("ijk,ijk->ij", off, off) / loosened**2
    beside = np.abs(along) < walls.half[:, None] + storey.half[None]
    cost = np.where((np.abs(turned) < TURNED * loosened) & beside, cost, np.inf)
    n, best = np.arange(len(walls)), cost.argmin(axis=1)
    most = np.where(2 * walls.half < SHORT, NO_WALL_SHORT, NO_WALL)
    least = cost[n, best]
    return np.minimum(least, most), np.where(least < most, best, -1), off[n, best], placed


def _step(part: Part, storey: Walls, state: Array, loosened: float) -> Array:
    """One step of least squares; the motions are of the groups' centres."""
    groups = len(state)
    _, partner, off, placed = _pairs(part, storey, state, loosened)
    on = np.flatnonzero(partner >= 0)
    group, j = part.group[on], partner[on]
    lever = placed[on] - state[group, 1:]
    both = []
    for d in (storey.normal[j] / SIGMA_ACROSS, storey.tangent[j] / SIGMA_END):
        rows = np.zeros((len(on), groups, 3))
        turn = d[:, 1] * lever[:, 0] - d[:, 0] * lever[:, 1]
        rows[np.arange(len(on)), group] = np.column_stack((turn, d))
        both.append(rows.reshape(len(on), 3 * groups))
    across, along = both
    ends = [np.where((off[on, k] == 0)[:, None], 0.0, along) for k in (1, 2)]  # nothing holds a wall that may go on
    turned = np.zeros((len(on), groups, 3))
    turned[np.arange(len(on)), group, 0] = 1 / SIGMA_TURN
    residual, bent = _bent(part, state)
    J = np.concatenate((across, *ends, turned.reshape(len(on), 3 * groups), bent))
    r = np.concatenate((off[on].T.ravel(), residual))
    step = np.linalg.solve(J.T @ J + HOLD * np.eye(3 * groups), -J.T @ r)
    return np.asarray(state + step.reshape(groups, 3))


def _bent(part: Part, state: Array) -> tuple[Array, Array]:
    """(3 L,) how far linked groups moved otherwise, in sigmas of the drift of one step, and (3 L, 3 G) by the state."""
    g, h = part.links.T
    arm = se2.rotate(state[g, 0], part.centre[h] - part.centre[g])
    sigma = np.array([DRIFT_YAW, DRIFT_XY, DRIFT_XY])
    off = np.column_stack((se2.wrap(state[h, 0] - state[g, 0]), state[h, 1:] - state[g, 1:] - arm)) / sigma
    J = np.zeros((len(g), 3, len(state), 3))
    n = np.arange(len(g))
    for k in range(3):
        J[n, k, h, k], J[n, k, g, k] = 1 / sigma[k], -1 / sigma[k]
    J[n, 1, g, 0], J[n, 2, g, 0] = arm[:, 1] / DRIFT_XY, -arm[:, 0] / DRIFT_XY
    return off.ravel(), J.reshape(3 * len(g), 3 * len(state))


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
