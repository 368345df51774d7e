"""Scores how well a motion aligns S walls with A walls, and refines it by point-to-line least squares.

K motions are processed at once. The S walls form G groups (one if the map is rigid, one per room if it may deform),
each with its own motion, stored as (yaw, x, y) of the group's centre after the motion.
"""

from dataclasses import dataclass

import numpy as np

from data.common.compiled import compiled
from data.geometry import se2
from data.geometry.se2 import Array
from data.geometry.se2_compiled import wrapped
from matching.arrays import Index, Walls

SAME_DIRECTION = float(np.radians(15))
SIGMA_SCORE = 0.15  # metres across, of the final judgement
SIGMA_HEADING = float(np.radians(5))
SIGMA_ALONG = 0.4  # metres; the ends of walls are seen badly
FAR = 9.0  # deviations: what is further off is as good as none
BEND = np.array([np.radians(2.5), 0.25, 0.25])  # how a room's motion may differ from its neighbours'
BEND_REACH = 4.0  # metres


@dataclass(frozen=True)
class Pairing:
    """The A surfaces (at most P) that each S surface may be near for one yaw, and the groups of the S walls.

    The (Ns, P) tables are padded with A walls of zero length.
    """

    s: Walls
    a: Walls
    yaw: float
    partner: Index  # (Ns, P) into A
    turned: Array  # (Ns, P) heading of S, turned by `yaw`, less that of A
    half: Array  # (Ns, P) of A, -inf where padded
    normal: Array  # (Ns, 2, P) of A
    tangent: Array  # (Ns, 2, P)
    offset: Array  # (Ns, 2, P) A's centre along its own normal and tangent
    group: Index  # (Ns,)
    centre: Array  # (G, 2) of the groups, in S

    @staticmethod
    def near(s: Walls, a: Walls, yaw: float, group: Index | None = None) -> "Pairing":
        """The pairs for motions whose yaw is near this one; all S walls in one group unless groups are given."""
        group = np.zeros(len(s), dtype=np.int64) if group is None else group
        turned = se2.wrap(s.heading[:, None] + yaw - a.heading[None, :])
        like = np.abs(turned) < SAME_DIRECTION
        most = max(1, int(like.sum(axis=1).max()))
        partner = np.argsort(~like, axis=1, kind="stable")[:, :most]
        real = np.take_along_axis(like, partner, axis=1)
        size = np.bincount(group)
        centre = np.stack([np.bincount(group, s.centre[:, k]) / size for k in (0, 1)], axis=-1)
        offset = np.stack([np.sum(a.centre * axis, axis=-1) for axis in (a.normal, a.tangent)])
        return Pairing(
            s, a, yaw, partner, np.take_along_axis(turned, partner, axis=1),
            np.where(real, a.half[partner], -np.inf), a.normal.T[:, partner].transpose(1, 0, 2),
            a.tangent.T[:, partner].transpose(1, 0, 2), offset[:, partner].transpose(1, 0, 2), group, centre,
        )  # fmt: skip

    def state(self, motions: Array) -> Array:
        """(K, G, 3) state of the groups under rigid motions (K, 3)."""
        at = se2.apply(motions[:, None, :], self.centre[None])
        return np.concatenate((np.broadcast_to(motions[:, None, :1], (*at.shape[:2], 1)), at), axis=-1)

    def table(self, values: Array) -> Array:
        """(Ns, Na) from the values (Ns, 1, P) of the pairs under one motion; zero elsewhere."""
        table = np.zeros((len(self.s), len(self.a)))
        n, p = np.nonzero(np.isfinite(self.half))
        table[n, self.partner[n, p]] = values[n, 0, p]
        return table

    def motions(self, state: Array) -> Array:
        """(K, G, 3) motions T_a_s of the groups."""
        moved = state[..., 1:] - se2.rotate(state[..., 0], np.broadcast_to(self.centre, state[..., 1:].shape))
        return np.concatenate((state[..., :1], moved), axis=-1)


@dataclass(frozen=True)
class Fit:
    """For each S surface, motion and pair: quality in [0, 1], and S's mid point relative to A's, along A's wall."""

    quality: Array  # (Ns, K, P)
    beside: Array  # (Ns, K, P) share of S's length that lies beside A's, in [0, 1]
    along: Array  # (Ns, K, P)
    placed: Array  # (Ns, K, 2) S's mid points in A


def fit(pairing: Pairing, state: Array, sigma: float) -> Fit:
    """Scores every pair: its distance from A's line (sigma, metres), its direction and its overlap."""
    motions = pairing.motions(state)[:, pairing.group].transpose(1, 0, 2)
    placed = se2.apply(motions, pairing.s.centre[:, None])
    across = placed @ pairing.normal - pairing.offset[:, None, 0]
    along = placed @ pairing.tangent - pairing.offset[:, None, 1]
    turned = pairing.turned[:, None] + se2.wrap(motions[..., :1] - pairing.yaw)
    hs, ha = pairing.s.half[:, None, None], pairing.half[:, None]
    common = np.minimum(hs + ha - np.abs(along), 2 * np.minimum(hs, ha))
    # A fifth of a wall may stand out: its ends slide.
    beside = np.clip(common / (1.6 * np.minimum(hs, 4.0)), 0.0, 1.0)
    quality = beside * np.exp((-0.5 / sigma**2) * across**2 - (0.5 / SIGMA_HEADING**2) * turned**2)
    return Fit(quality, beside, along, placed)


def explained(s: Walls, a: Walls, yaw: float, motions: Array, sigma: float) -> Array:
    """(K,) weight of the S walls that rigid motions (K, 3) with yaws near `yaw` explain, scored as in `fit`."""
    return np.asarray(_explained(s.heading, s.half, s.centre, s.weight, a.lines, yaw, motions, sigma))


@compiled
def _explained(
    heading: Array, half: Array, centre: Array, weight: Array, lines: Array, yaw: float, motions: Array, sigma: float
) -> Array:
    """See `explained`."""
    total = np.zeros(len(motions))
    alike = np.empty(len(lines), dtype=np.int64)
    for i in range(len(heading)):
        count, span = 0, 1.6 * min(half[i], 4.0)
        for j in range(len(lines)):
            if abs(wrapped(heading[i] + yaw - lines[j, 1])) < SAME_DIRECTION:
                alike[count] = j
                count += 1
        for k in range(len(motions)):
            cos, sin, best = np.cos(motions[k, 0]), np.sin(motions[k, 0]), 0.0
            x = cos * centre[i, 0] - sin * centre[i, 1] + motions[k, 1]
            y = sin * centre[i, 0] + cos * centre[i, 1] + motions[k, 2]
            off_yaw = yaw + wrapped(motions[k, 0] - yaw)
            for n in range(count):
                line = lines[alike[n]]
                along = abs(line[2] * y - line[3] * x - line[5])
                common = min(half[i] + line[0] - along, 2 * min(half[i], line[0]))
                beside = min(max(common / span, 0.0), 1.0)
                across = line[2] * x + line[3] * y - line[4]
                if beside > best and abs(across) < FAR * sigma:
                    turned = wrapped(heading[i] + off_yaw - line[1])
                    likely = np.exp((-0.5 / sigma**2) * across**2 - (0.5 / SIGMA_HEADING**2) * turned**2)
                    best = max(best, beside * likely)
            total[k] += weight[i] * best
    return total


def refine(pairing: Pairing, state: Array, sigma: float, prior: Array, prior_sigma: Array) -> Array:
    """One step of least squares: the ends of each S wall to the line of its best A wall.

    `prior` (K, G, 3) is a weak prior on the state, with `prior_sigma` (3,).
    """
    now = fit(pairing, state, sigma)
    winner = now.quality.argmax(axis=2)[..., None]  # (Ns, K, 1)
    s, a = pairing.s, pairing.a
    weight = np.take_along_axis(now.quality, winner, axis=2)[..., 0] * s.weight[:, None] / sigma**2
    along = np.take_along_axis(now.along, winner, axis=2)[..., 0]
    j = np.take_along_axis(pairing.partner, winner[..., 0], axis=1)  # (Ns, K)
    per_wall = state[:, pairing.group].transpose(1, 0, 2)
    arm = 0.8 * s.half[:, None, None] * se2.rotate(per_wall[..., 0], s.tangent[:, None])
    excess = np.sign(along) * np.maximum(np.abs(along) - np.abs(a.half[j] - s.half[:, None]), 0.0)
    ends = [now.placed + arm, now.placed - arm]
    normal = a.normal[j]
    rows = [(end, normal, np.sum((end - a.centre[j]) * normal, axis=-1), 0.5 * weight) for end in ends]
    rows.append((now.placed, a.tangent[j], excess, 0.25 * weight * (sigma / SIGMA_ALONG) ** 2))
    H = np.zeros((*state.shape, 3)) + np.diag(1 / prior_sigma**2)
    difference = prior - state
    difference[..., 0] = se2.wrap(difference[..., 0])
    g = difference / prior_sigma**2
    members = np.eye(state.shape[1])[pairing.group].T  # (G, Ns)
    for point, direction, residual, w in rows:
        lever = point - per_wall[..., 1:]
        turn = direction[..., 1] * lever[..., 0] - direction[..., 0] * lever[..., 1]
        J = np.stack((turn, direction[..., 0], direction[..., 1]))  # (3, Ns, K)
        g -= (members @ (w * residual * J)).transpose(2, 1, 0)
        H += (members @ (w * J[:, None] * J[None])).transpose(3, 2, 0, 1)
    return np.asarray(state + np.linalg.solve(H, g[..., None])[..., 0])


def refine_rigid(pairing: Pairing, motions: Array, sigmas: tuple[float, ...]) -> Array:
    """(K, 3) refined motions for a pairing with one group, with decreasing sigmas."""
    state = pairing.state(motions)
    for sigma in sigmas:
        state = refine(pairing, state, sigma, state, np.array([np.radians(5), 0.5, 0.5]))
    return pairing.motions(state)[:, 0]


def rigid_of(pairing: Pairing, state: Array) -> Array:
    """(3,) the rigid motion nearest to a deformed state (1, G, 3), from the ends of explained walls."""
    now = fit(pairing, state, SIGMA_SCORE)
    weight = np.tile(pairing.s.weight * now.quality.max(axis=2)[:, 0] + 1e-6, 2)
    arm = pairing.s.half[:, None] * pairing.s.tangent
    turned = se2.rotate(state[0, pairing.group, 0], arm)
    p = np.concatenate((pairing.s.centre + arm, pairing.s.centre - arm))
    q = np.concatenate((now.placed[:, 0] + turned, now.placed[:, 0] - turned))
    p_mean, q_mean = (np.average(x, axis=0, weights=weight) for x in (p, q))
    dp, dq = p - p_mean, q - q_mean
    cross, dot = dp[:, 0] * dq[:, 1] - dp[:, 1] * dq[:, 0], np.sum(dp * dq, axis=-1)
    yaw = np.arctan2(weight @ cross, weight @ dot)
    return np.array([yaw, *(q_mean - se2.rotate(yaw, p_mean))])


def bend(pairing: Pairing, motions: Array, sigmas: tuple[float, ...]) -> tuple[Array, Array]:
    """Lets every group follow its own walls, constrained by its neighbours.

    Returns the state (K, G, 3) and what the neighbours predicted (K, G, 3).
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
    """(K, G, 3) each group as predicted by its neighbours' motions, or by the rigid motion if none is near."""
    motions = pairing.motions(state)
    turn = np.einsum("gh,kh->kg", share, se2.wrap(state[..., 0] - rigid[..., 0]))
    placed = se2.apply(motions[:, None, :, :], pairing.centre[None, :, None, :])  # (K, G, H, 2)
    shift = np.einsum("gh,kghd->kgd", share, placed - rigid[:, :, None, 1:])
    return rigid + np.concatenate((turn[..., None], shift), axis=-1)
