"""A field of motions over walls one by one, for compiled loops."""

from typing import NamedTuple

import numpy as np

from data.compiled import compiled
from data.se2_loops import wrapped
from matching.blocks import Elimination
from matching.scoring import SIGMA_HEADING, SIGMA_SCORE
from matching.se2 import Array
from matching.walls import Index


class Loops(NamedTuple):
    """What compiled loops ask of a scene."""

    heading: Array  # (Ns,)
    half: Array
    weight: Array
    group: Index
    arm: Array  # (Ns, 2)
    centre: Array  # (G, 2)
    edges: Index  # (E, 2)
    slack: Array  # (E, 3) deviations
    elimination: Elimination  # of the groups, joined by the edges
    lines: Array  # (Na, 6) as those of `Walls`
    order: Index  # (Na,) as `PlanWalls.by_heading`
    ordered: Array
    first: Index  # (storeys + 1,)


@compiled
def laid(m: Loops, state: Array) -> Array:
    """(Ns, 5) where a field (G, 3) lays the walls: heading, mid point, and this from its group's centre."""
    turn, pose = np.empty((len(state), 2)), np.empty((len(m.heading), 5))
    for g in range(len(state)):
        turn[g, 0], turn[g, 1] = np.cos(state[g, 0]), np.sin(state[g, 0])
    for i in range(len(pose)):
        g = m.group[i]
        cos, sin = turn[g]
        pose[i, 3] = cos * m.arm[i, 0] - sin * m.arm[i, 1]
        pose[i, 4] = sin * m.arm[i, 0] + cos * m.arm[i, 1]
        pose[i, 0], pose[i, 1] = m.heading[i] + state[g, 0], state[g, 1] + pose[i, 3]
        pose[i, 2] = state[g, 2] + pose[i, 4]
    return pose


@compiled
def judged(line: Array, half: float, pose: Array, sigma: float) -> tuple[float, float, float, float, float]:
    """The fields of `Judged` for a wall of the map that is laid so, and a line of the plan."""
    across, along, turned, beside = compared(line, half, pose)
    quality = beside * np.exp(-strangeness(across, turned, sigma)) if beside > 0 else 0.0
    return quality, beside, across, along, turned


@compiled
def compared(line: Array, half: float, pose: Array) -> tuple[float, float, float, float]:
    """Off across, along and in direction, and the share that lies beside."""
    across = line[2] * pose[1] + line[3] * pose[2] - line[4]
    along = line[2] * pose[2] - line[3] * pose[1] - line[5]
    turned = wrapped(pose[0] - line[1])
    span = 1.6 * min(half, 4.0)  # a fifth of a wall may stand out: its ends slide
    common = min(half + line[0] - abs(along), 2 * min(half, line[0]))
    return across, along, turned, min(max(common / span, 0.0), 1.0)


@compiled
def strangeness(across: float, turned: float, sigma: float) -> float:
    """Half the squares of what a wall is off, in deviations."""
    sigma_turned = SIGMA_HEADING * min(max(sigma / SIGMA_SCORE, 1.0), 2.0)
    return (0.5 / sigma**2) * across**2 + (0.5 / sigma_turned**2) * turned**2


@compiled
def best_pair(lines: Array, half: float, pose: Array, partners: Index, sigma: float) -> tuple[float, int]:
    """The quality of a wall's best pair with its partners (P,), and which of them that is, -1 for none."""
    best, at = 0.0, -1
    for p in range(len(partners)):
        if partners[p] < 0:
            continue
        across, _, turned, beside = compared(lines[partners[p]], half, pose)
        strange = strangeness(across, turned, sigma)
        if beside > best * (1 + strange):  # the others cannot be better: exp(-x) is at most 1 / (1 + x)
            quality = beside * np.exp(-strange)
            if quality > best:
                best, at = quality, p
    return best, at


@compiled
def strained(
    m: Loops, e: int, state: Array
) -> tuple[float, tuple[float, float, float], tuple[float, float], tuple[float, float]]:
    """How a field (G, 3) moves the neighbours of an edge otherwise, at the point between them: the squares in their
    deviations; radians, metres, metres; and from either end's centre to that point."""
    g, h = m.edges[e, 0], m.edges[e, 1]
    one, other = state[g], state[h]
    half_x, half_y = (m.centre[h, 0] - m.centre[g, 0]) / 2, (m.centre[h, 1] - m.centre[g, 1]) / 2
    cos, sin = np.cos(one[0]), np.sin(one[0])
    x, y = cos * half_x - sin * half_y, sin * half_x + cos * half_y
    cos, sin = -np.cos(other[0]), -np.sin(other[0])
    u, v = cos * half_x - sin * half_y, sin * half_x + cos * half_y
    turn, off_x, off_y = wrapped(other[0] - one[0]), other[1] - one[1] + u - x, other[2] - one[2] + v - y
    square = (turn / m.slack[e, 0]) ** 2 + (off_x / m.slack[e, 1]) ** 2 + (off_y / m.slack[e, 2]) ** 2
    return square, (turn, off_x, off_y), (x, y), (u, v)
