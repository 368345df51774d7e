"""Placements of an S-graph in the storeys of an A-graph: found by voting, scored, reduced to distinct ones."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from matching.arrays import Index, Walls
from matching.search.evidence import evidence
from matching.search.scoring import SIGMA_SCORE, Fit, Pairing, bend, explained, fit, refine_rigid, rigid_of
from matching.engine.votes import candidates

SIGMAS_RIGID = (0.35, 0.25, 0.2)  # metres
SIGMAS_DEFORMED = (0.3, 0.2, 0.15, 0.15)
REFINED = 24  # candidates of each storey
HOPEFUL = 0.6  # share of the best one's weight; others are dropped,
ALTERNATIVES = 4  # but this many always stay
KEPT = 12  # placements that are refined
PER_STOREY = 3  # of them at least, from every storey
CELL = 6.0  # metres
DISTINCT_M, DISTINCT_RAD = 0.5, np.radians(5)  # in a compiled function too, of `field_rigid`


@dataclass(frozen=True)
class Placement:
    """S placed in one storey: rigid `motion` (3,) (yaw, x, y) between the graphs' own frames, and its deformation."""

    storey: Walls
    motion: Array
    T_a_s: Array  # (3,) between the frames of the graphs
    pairing: Pairing
    state: Array  # (1, G, 3)
    fit: Fit  # of the one state
    score: float  # nats of evidence

    @property
    def explained(self) -> Array:
        """(Ns,) how well each S wall is explained, in [0, 1]."""
        return np.asarray(self.fit.quality.max(axis=2)[:, 0])

    @property
    def fraction(self) -> float:
        """The share of the S walls, by length, that the storey explains."""
        half = self.pairing.s.half
        return float(half @ self.explained / half.sum())


def between_graphs(s: Walls, a: Walls, motion: Array) -> Array:
    """(3,) T_a_s between the graphs' frames, from a motion between their own frames."""
    return se2.compose(se2.compose(a.T_graph_own, motion), se2.inverse(s.T_graph_own))


def search(s: Walls, storeys: list[Walls], allowed: Callable[[Array], bool] | None = None) -> list[Placement]:
    """Returns distinct placements, best first; none if no corner of S matches one of A.

    `allowed` says for T_a_s (3,), between the graphs' frames, whether a placement is allowed; it is applied before
    placements compete.
    """
    rough = [found for a in storeys for found in _voted(s, a)]
    if allowed is not None:
        rough = [r for r in rough if allowed(between_graphs(s, r.pairing.a, r.motion))]
    refined = _refined(_hopeful(rough, REFINED, REFINED))
    apart = [refined[n] for n in _distinct([(r.pairing.a, r.motion) for r in refined])]
    placed = [_placement(s, r.pairing.a, r.motion) for r in _hopeful(apart, KEPT, PER_STOREY)]
    if allowed is not None:
        placed = [p for p in placed if allowed(p.T_a_s)]
    placed.sort(key=lambda p: -p.score)
    return [placed[n] for n in _distinct([(p.storey, p.motion) for p in placed])]


@dataclass(frozen=True)
class _Rigid:
    worth: float  # weight of the S walls that it explains
    pairing: Pairing
    motion: Array  # (3,) between own frames


def _voted(s: Walls, a: Walls) -> list[_Rigid]:
    found = []
    for voted in candidates(s, a):
        pairing = Pairing.near(s, a, voted.yaw)
        worth = explained(s, a, voted.yaw, voted.motions, SIGMAS_RIGID[0])
        found += [_Rigid(float(w), pairing, m) for w, m in zip(worth, voted.motions, strict=True)]
    return found


def _hopeful(found: list[_Rigid], most: int, per_storey: int) -> list[_Rigid]:
    """The best placements, `most` or up to `per_storey` of a storey, without those far behind; a few alternatives
    always stay.
    """
    found = sorted(found, key=lambda r: -r.worth)
    rank: dict[str | None, int] = {}
    kept: list[_Rigid] = []
    for r in found:
        rank[r.pairing.a.floor] = rank.get(r.pairing.a.floor, 0) + 1
        near = r.worth > HOPEFUL * found[0].worth or len(kept) < ALTERNATIVES
        if near and (len(kept) < most or rank[r.pairing.a.floor] <= per_storey):
            kept.append(r)
    return kept


def _refined(rough: list[_Rigid]) -> list[_Rigid]:
    found = []
    for pairing in {id(r.pairing): r.pairing for r in rough}.values():
        motions = np.array([r.motion for r in rough if r.pairing is pairing])
        motions = refine_rigid(pairing, motions, SIGMAS_RIGID)
        worth = explained(pairing.s, pairing.a, pairing.yaw, motions, SIGMAS_RIGID[-1])
        found += [_Rigid(float(w), pairing, m) for w, m in zip(worth, motions, strict=True)]
    return sorted(found, key=lambda r: -r.worth)


def _placement(s: Walls, a: Walls, motion: Array) -> Placement:
    pairing = Pairing.near(s, a, float(motion[0]), groups_of(s))
    state, expected = bend(pairing, motion[None], SIGMAS_DEFORMED)
    fitted = fit(pairing, state, SIGMA_SCORE)
    score = evidence(pairing, state, expected, fitted)
    rigid = rigid_of(pairing, state)
    return Placement(a, rigid, between_graphs(s, a, rigid), pairing, state, fitted, score)


def groups_of(s: Walls) -> Index:
    """(Ns,) the group of S walls that moves together: those of a room.

    A stray wall joins the nearest wall that has a room; if none has one, walls are grouped by grid cells.
    """
    if (s.room < 0).all():
        cell = np.floor(s.centre / CELL)
        return np.asarray(np.unique(cell, axis=0, return_inverse=True)[1].reshape(-1))
    with_room = np.nonzero(s.room >= 0)[0]
    distance = np.linalg.norm(s.centre[:, None] - s.centre[None, with_room], axis=-1)
    nearest = s.room[with_room[np.argmin(distance, axis=1)]]
    return np.asarray(np.unique(np.where(s.room >= 0, s.room, nearest), return_inverse=True)[1])


def _distinct(motions: list[tuple[Walls, Array]]) -> list[int]:
    """Indices of placements that differ from all earlier ones: in storey, at S's centre (the origin) or in yaw."""
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
