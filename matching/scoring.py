"""How well a motion lays S walls on A walls, wall by wall, and its refinement by point-to-line least squares.

K motions are worked on at once. The S walls fall into G groups (one: the map is rigid; one for each room: it
may bend), each with a motion of its own, kept as (yaw, x, y) of the group's centre after the motion.
"""

from dataclasses import dataclass

import numpy as np

from matching import se2
from matching.se2 import Array
from matching.walls import Index, Walls

SAME_DIRECTION = np.radians(15)
SIGMA_HEADING = np.radians(5)
SIGMA_ALONG = 0.4  # metres; the ends of walls are seen badly
BEND = np.array([np.radians(2.5), 0.25, 0.25])  # how a room's motion may differ from its neighbours'
BEND_REACH = 4.0  # metres


@dataclass(frozen=True)
class Pairing:
    """The M pairs of like oriented surfaces (i of S, j of A, ordered by i) near one yaw; groups of the S walls."""

    s: Walls
    a: Walls
    i: Index
    j: Index
    group: Index  # (Ns,)
    centre: Array  # (G, 2) in S

    @staticmethod
    def near(s: Walls, a: Walls, yaw: float, group: Index | None = None) -> "Pairing":
        """The pairs for motions whose yaw is near this one; all S walls in one group unless told."""
        group = np.zeros(len(s), dtype=np.int64) if group is None else group
        turned = se2.wrap(s.heading[:, None] + yaw - a.heading[None, :])
        i, j = np.nonzero(np.abs(turned) < SAME_DIRECTION)
        size = np.bincount(group)
        centre = np.stack([np.bincount(group, s.centre[:, k]) / size for k in (0, 1)], axis=-1)
        return Pairing(s, a, i, j, group, centre)

    def state(self, motions: Array) -> Array:
        """(K, G, 3) state of the groups under rigid (K, 3) motions."""
        at = se2.apply(motions[:, None, :], self.centre[None])
        return np.concatenate((np.broadcast_to(motions[:, None, :1], (*at.shape[:2], 1)), at), axis=-1)

    def motions(self, state: Array) -> Array:
        """(K, G, 3) motions T_a_s of the groups."""
        moved = state[..., 1:] - se2.rotate(state[..., 0], np.broadcast_to(self.centre, state[..., 1:].shape))
        return np.concatenate((state[..., :1], moved), axis=-1)


@dataclass(frozen=True)
class Fit:
    """(K, M) per pair: quality in [0, 1], residual across (from A's line, metres), along, and S centres in A."""

    quality: Array
    across: Array
    along: Array
    placed: Array  # (K, M, 2)


def fit(pairing: Pairing, state: Array, sigma: float) -> Fit:
    """Judges every pair: near A's line (sigma, metres), of its direction, and beside its extent."""
    s, a, i, j = pairing.s, pairing.a, pairing.i, pairing.j
    placed = se2.apply(pairing.motions(state)[:, pairing.group], s.centre[None])[:, i]
    from_a = placed - a.centre[j]
    across = np.einsum("kmd,md->km", from_a, a.normal[j])
    along = np.einsum("kmd,md->km", from_a, a.tangent[j])
    turned = se2.wrap(state[:, pairing.group[i], 0] + s.heading[i] - a.heading[j])
    hs, ha = s.half[i], a.half[j]
    common = np.minimum(along + hs, ha) - np.maximum(along - hs, -ha)
    # A fifth of a wall may stand out: its ends slide.
    beside = np.clip(common / (1.6 * np.minimum(hs, 4.0)), 0.0, 1.0)
    quality = beside * np.exp(-0.5 * ((across / sigma) ** 2 + (turned / SIGMA_HEADING) ** 2))
    return Fit(quality, across, along, placed)


def best_of_surface(pairing: Pairing, quality: Array) -> Array:
    """(K, Ns) the best quality of each S surface."""
    best = np.zeros((len(quality), len(pairing.s)))
    rows, starts = np.unique(pairing.i, return_index=True)
    if len(rows):
        best[:, rows] = np.maximum.reduceat(quality, starts, axis=1)
    return best


def refine(pairing: Pairing, state: Array, sigma: float, prior: Array, prior_sigma: Array) -> Array:
    """One step of least squares: the ends of each S wall to the line of its best A wall.

    `prior` (K, G, 3) is where the state is held, loosely, by `prior_sigma` (3,).
    """
    now = fit(pairing, state, sigma)
    best = best_of_surface(pairing, now.quality)[:, pairing.i]
    weight = np.where(now.quality >= best, now.quality, 0.0) * pairing.s.weight[pairing.i] / sigma**2
    s, a, i, j = pairing.s, pairing.a, pairing.i, pairing.j
    centre = state[:, pairing.group[i], 1:]
    tangent = se2.rotate(state[:, pairing.group[i], 0], s.tangent[i])
    normal, along_a = a.normal[j], a.tangent[j]
    excess = np.sign(now.along) * np.maximum(np.abs(now.along) - np.abs(a.half[j] - s.half[i]), 0.0)
    one_hot = np.zeros((len(i), state.shape[1]))
    one_hot[np.arange(len(i)), pairing.group[i]] = 1.0
    H = np.zeros((*state.shape, 3)) + np.diag(1 / prior_sigma**2)
    difference = prior - state
    difference[..., 0] = se2.wrap(difference[..., 0])
    g = difference / prior_sigma**2
    arm = 0.8 * s.half[i, None] * tangent
    ends = (now.placed + arm, now.placed - arm)
    rows = [(end, normal, np.einsum("kmd,md->km", end - a.centre[j], normal), 0.5 * weight) for end in ends]
    rows.append((now.placed, along_a, excess, weight * (sigma / SIGMA_ALONG) ** 2 * 0.25))
    for point, direction, residual, w in rows:
        from_centre = point - centre
        lever = direction[:, 1] * from_centre[..., 0] - direction[:, 0] * from_centre[..., 1]
        J = (lever, np.broadcast_to(direction[:, 0], lever.shape), np.broadcast_to(direction[:, 1], lever.shape))
        for p in range(3):
            g[..., p] -= (w * J[p] * residual) @ one_hot
            for q in range(p, 3):
                h = (w * J[p] * J[q]) @ one_hot
                H[..., p, q] += h
                if q != p:
                    H[..., q, p] += h
    return np.asarray(state + np.linalg.solve(H, g[..., None])[..., 0])


def refine_rigid(pairing: Pairing, motions: Array, sigmas: tuple[float, ...]) -> Array:
    """(K, 3) motions refined, for a pairing of one group, with ever tighter sigmas."""
    state = pairing.state(motions)
    for sigma in sigmas:
        state = refine(pairing, state, sigma, state, np.array([np.radians(5), 0.5, 0.5]))
    return pairing.motions(state)[:, 0]


def bend(pairing: Pairing, motions: Array, sigmas: tuple[float, ...]) -> tuple[Array, Array]:
    """Lets every group follow its own walls, held by its neighbours.

    Returns the (K, G, 3) state and the (K, G, 3) place that the neighbours expected of it.
    """
    state = pairing.state(motions)
    rigid = state
    distance = np.linalg.norm(pairing.centre[:, None] - pairing.centre[None], axis=-1)
    size = np.bincount(pairing.group, pairing.s.weight)
    near = np.exp(-0.5 * (distance / BEND_REACH) ** 2) * size[None, :]
    np.fill_diagonal(near, 0.0)
    share = near / (near.sum(axis=1, keepdims=True) + 0.2 * size.mean())
    expected = rigid
    for sigma in sigmas:
        state = refine(pairing, state, sigma, expected, BEND)
        expected = _expected(pairing, state, rigid, share)
    return state, expected


def _expected(pairing: Pairing, state: Array, rigid: Array, share: Array) -> Array:
    """(K, G, 3) where the neighbours' motions would put each group; where none is near, the rigid motion."""
    motions = pairing.motions(state)
    turn = np.einsum("gh,kh->kg", share, se2.wrap(state[..., 0] - rigid[..., 0]))
    placed = se2.apply(motions[:, None, :, :], pairing.centre[None, :, None, :])  # (K, G, H, 2)
    shift = np.einsum("gh,kghd->kgd", share, placed - rigid[:, :, None, 1:])
    return rigid + np.concatenate((turn[..., None], shift), axis=-1)
