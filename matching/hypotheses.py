"""Placements of an S-graph in the storeys of an A-graph: found by voting, scored, told apart."""

from dataclasses import dataclass

import numpy as np

from matching import se2
from matching.evidence import evidence
from matching.scoring import Fit, Pairing, bend, explained, fit, refine_rigid, rigid_of
from matching.se2 import Array
from matching.voting import FEW_CORNERS, marks, vote
from matching.walls import Walls

SIGMAS_RIGID = (0.35, 0.25, 0.2)
SIGMAS_BENT = (0.3, 0.2, 0.15, 0.15)
SIGMA_SCORE = 0.15  # metres across
KEPT = 12  # hypotheses that are worked out
PER_STOREY = 3  # of them at least, from every storey
DISTINCT_M, DISTINCT_RAD = 0.5, np.radians(5)


@dataclass(frozen=True)
class Placement:
    """S laid into one storey: rigid `motion` (3,) T_a_s of the graphs' own frames, and how it bends."""

    storey: Walls
    motion: Array
    pairing: Pairing
    state: Array  # (1, G, 3)
    expected: Array  # (1, G, 3) of each group by its neighbours
    fit: Fit  # of the one state
    explained: Array  # (Ns,) in [0, 1]
    score: float  # nats of evidence

    def T_a_s(self) -> Array:
        """(3,) between the frames of the graphs."""
        s = self.pairing.s
        return se2.compose(se2.compose(self.storey.T_graph_own, self.motion), se2.inverse(s.T_graph_own))

    @property
    def fraction(self) -> float:
        """How much of the S walls (by weight) the storey explains."""
        weight = self.pairing.s.weight
        return float(weight @ self.explained / weight.sum())


def search(s: Walls, storeys: list[Walls]) -> list[Placement]:
    """Distinct placements, best first; empty where no corner of S has its like."""
    found: list[tuple[float, Walls, Array]] = []
    for a in storeys:
        found += _rigid(s, a)
    found.sort(key=lambda x: -x[0])
    distinct = _distinct([(a, motion) for _, a, motion in found])
    rank: dict[str | None, int] = {}
    chosen = []
    for n in distinct:
        a = found[n][1]
        rank[a.floor] = rank.get(a.floor, 0) + 1
        if len(chosen) < KEPT or rank[a.floor] <= PER_STOREY:
            chosen.append((a, found[n][2]))
    placed = sorted((_placement(s, a, motion) for a, motion in chosen), key=lambda p: -p.score)
    kept = _distinct([(p.storey, p.motion) for p in placed])
    return [placed[n] for n in kept]


def _rigid(s: Walls, a: Walls) -> list[tuple[float, Walls, Array]]:
    s_marks, a_marks = marks(s), marks(a)
    if len(s_marks.point) < FEW_CORNERS or not len(a_marks.point):
        s_marks, a_marks = marks(s, scarce=True), marks(a, scarce=True)
    most = int(np.clip(1600 / len(s), 15, 150))
    rough = []
    for candidates in vote(s_marks, a_marks, most):
        pairing = Pairing.near(s, a, candidates.yaw)
        worth = explained(pairing, candidates.motions, 0.3)
        rough += [(float(w), pairing, motion) for w, motion in zip(worth, candidates.motions, strict=True)]
    rough.sort(key=lambda r: -r[0])
    by_mode: dict[float, tuple[Pairing, list[Array]]] = {}
    for _, pairing, motion in rough[: 2 * KEPT]:
        by_mode.setdefault(pairing.yaw, (pairing, []))[1].append(motion)
    found = []
    for pairing, motions in by_mode.values():
        refined = refine_rigid(pairing, np.array(motions), SIGMAS_RIGID)
        found += list(zip(explained(pairing, refined, 0.2).tolist(), [a] * len(motions), refined, strict=True))
    return found


def _placement(s: Walls, a: Walls, motion: Array) -> Placement:
    group = groups_of(s)
    pairing = Pairing.near(s, a, float(motion[0]), group)
    state, expected = bend(pairing, motion[None], SIGMAS_BENT)
    judged = fit(pairing, state, SIGMA_SCORE)
    seen = judged.quality.max(axis=2)[:, 0]
    score = evidence(pairing, state, expected, judged)
    return Placement(a, rigid_of(pairing, state), pairing, state, expected, judged, seen, score)


def groups_of(s: Walls) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """(Ns,) which S walls move together when the map bends: those of a room; a stray wall goes with the nearest
    wall that has a room."""
    if (s.room < 0).all():
        return np.zeros(len(s), dtype=np.int64)
    housed = np.nonzero(s.room >= 0)[0]
    distance = np.linalg.norm(s.centre[:, None] - s.centre[None, housed], axis=-1)
    room = s.room[housed[np.argmin(distance, axis=1)]]
    return np.unique(np.where(s.room >= 0, s.room, room), return_inverse=True)[1].astype(np.int64)


def _distinct(motions: list[tuple[Walls, Array]]) -> list[int]:
    """Indices of those that differ from all earlier ones: in storey, at S's centre (the origin), or in yaw."""
    kept: list[int] = []
    for n, (a, motion) in enumerate(motions):
        if all(
            motions[k][0] is not a
            or np.hypot(*(motion - motions[k][1])[1:]) > DISTINCT_M
            or abs(se2.wrap(motion[:1] - motions[k][1][:1])[0]) > DISTINCT_RAD
            for k in kept
        ):
            kept.append(n)
    return kept
