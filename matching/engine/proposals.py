"""Proposed matches of wall surfaces: how likely one of the map is one of the plan."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.geometry.se2 import Array
from data.geometry.se2_compiled import wrapped
from matching.arrays import Index
from matching.engine.field import Scene
from matching.engine.votes import Votes

MOST = 8  # proposals that are kept of one S surface or room
OPENING = float(np.radians(10))  # the angles between two S walls and their A walls differ by less
LEAST_ANGLE = float(np.radians(35))
REACH = 1.5  # metres beyond the ends of walls, half as long again, within which they cross
LEAST_SCORE = 1e-3  # of a proposal that votes


@dataclass(frozen=True)
class TopK:
    """The K likeliest A nodes of each of N S nodes, best first; small whatever the size of the plan.

    `partner` (N, K) are indices into A, -1 where there are fewer than K; `score` (N, K) are probabilities in [0, 1], 0
    where there is none. Rows may sum to less than 1: the rest is "not in the plan".
    """

    partner: Index
    score: Array


@dataclass(frozen=True)
class ProposalVotes:
    """The votes of proposed matches, with the group of the map (V,) and the storey (V,) that each is of."""

    votes: Votes
    group: Index
    storey: Index

    def of(self, member: NDArray[np.bool_], storey: int) -> Votes:
        """Those of the member groups (G,) for a storey."""
        chosen = member[self.group] & (self.storey == storey)
        return Votes(*(each[chosen] for each in self.votes))


def proposal_votes(scene: Scene, proposals: TopK) -> ProposalVotes:
    """The votes of all pairs of walls of one group that cross, for the crossings of their proposed partners."""
    s, plan, group = scene.s, scene.plan, scene.groups.of_wall
    most = int((np.bincount(group) ** 2).sum()) // 2 * proposals.partner.shape[1] ** 2
    wall, partner, number = _crossings(
        s.heading, s.half, s.centre, s.normal, group, plan.lines, plan.centre, plan.storey, proposals.partner,
        proposals.score, most,
    )  # fmt: skip
    return ProposalVotes(
        Votes(number[:, :2], number[:, 2:4], number[:, 4], number[:, 5]), group[wall], plan.storey[partner]
    )


@compiled
def _crossings(
    heading: Array, half: Array, centre: Array, normal: Array, group: Index, lines: Array, a_centre: Array,
    a_storey: Index, partner: Index, score: Array, most: int,
) -> tuple[Index, Index, Array]:  # fmt: skip
    """(V,) one of the walls of each vote, (V,) its partner, and (V, 6) the crossings in map and plan, yaw, weight;
    V is at most `most`.
    """
    wall, of, found, count = np.empty(most, np.int64), np.empty(most, np.int64), np.empty((most, 6)), 0
    for i in range(len(heading)):
        for k in range(i + 1, len(heading)):
            turn = wrapped(heading[k] - heading[i])
            if group[i] != group[k] or abs(abs(turn) - np.pi / 2) >= np.pi / 2 - LEAST_ANGLE:
                continue
            x, y = centre[k, 0] - centre[i, 0], centre[k, 1] - centre[i, 1]
            along = (x * normal[k, 0] + y * normal[k, 1]) / np.sin(turn)  # the crossing's place on each wall
            back = (x * normal[i, 0] + y * normal[i, 1]) / np.sin(turn)
            if abs(along) >= 1.5 * half[i] + REACH or abs(back) >= 1.5 * half[k] + REACH:
                continue
            for u in range(partner.shape[1]):
                for v in range(partner.shape[1]):
                    j, m = partner[i, u], partner[k, v]
                    if j < 0 or m < 0 or a_storey[j] != a_storey[m] or min(score[i, u], score[k, v]) < LEAST_SCORE:
                        continue
                    opening = wrapped(lines[m, 1] - lines[j, 1])
                    off = wrapped(opening - turn)
                    if abs(off) >= OPENING:
                        continue
                    away_x, away_y = a_centre[m, 0] - a_centre[j, 0], a_centre[m, 1] - a_centre[j, 1]
                    run = (away_x * lines[m, 2] + away_y * lines[m, 3]) / np.sin(opening)
                    wall[count], of[count] = i, j
                    found[count, 0], found[count, 1] = (
                        centre[i, 0] - along * normal[i, 1],
                        centre[i, 1] + along * normal[i, 0],
                    )
                    found[count, 2], found[count, 3] = (
                        a_centre[j, 0] - run * lines[j, 3],
                        a_centre[j, 1] + run * lines[j, 2],
                    )
                    found[count, 4], found[count, 5] = (
                        wrapped(lines[j, 1] - heading[i] + off / 2),
                        score[i, u] * score[k, v],
                    )
                    count += 1
    return wall[:count].copy(), of[:count].copy(), found[:count].copy()
