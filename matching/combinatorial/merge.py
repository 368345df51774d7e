"""Combines wall sets of several rooms, keeps ties, and adds the remaining walls."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.geometry.se2 import Array
from matching.arrays import Index
from matching.combinatorial.affinity import Compared, Datums, wall_affinity
from matching.combinatorial.sets import AgreeingSet, Clock, Pairs
from matching.combinatorial.settings import CombinatorialSettings, Planes

CHUNK = 1 << 17  # combinations judged at once
LEAST_COS, MOST_SIN = 0.8, 0.2  # of the plan's turn, where it must be upright


@dataclass(frozen=True)
class Merged:
    """A solution: pairs of rooms and of walls as (S, A) rows; `frame` is the room pair about whose centres it was
    compared.

    `consistency` is the mean affinity of its wall pairs with each other.
    """

    rooms: Pairs
    walls: Pairs
    consistency: float
    frame: tuple[int, int]


def merged(
    s: Datums, a: Datums, settings: CombinatorialSettings, rooms: Pairs, sets: Sequence[list[AgreeingSet]], clock: Clock
) -> list[Merged]:
    """Returns all consistent combinations of one wall set of each room pair. Raises TimeIsUpError.

    The mean of a combination's affinities is computed as a sum of blocks, one for each pair of wall sets.
    """
    frame = rooms[_reference(sets) if settings.about_best else 0]
    walls = list(dict.fromkeys(pair for options in sets for x in options for pair in x.pairs))
    row = {pair: k for k, pair in enumerate(walls)}
    member = np.zeros((sum(len(options) for options in sets), len(walls)))
    for k, x in enumerate(x for options in sets for x in options):
        member[k, [row[pair] for pair in x.pairs]] = 1.0
    affinity = pair_affinity(s, a, settings.planes, frame, walls)
    np.fill_diagonal(affinity, 0.0)
    block = member @ affinity @ member.T
    sizes = [len(options) for options in sets]
    first = np.cumsum([0, *sizes[:-1]])
    number = sum(len(options[0].pairs) for options in sets)
    found = []
    for begin in range(0, math.prod(sizes) if number > 1 else 0, CHUNK):
        clock.check()
        index = np.arange(begin, min(begin + CHUNK, math.prod(sizes)))
        choice = np.stack(np.unravel_index(index, sizes), axis=-1) + first
        total = sum(block[choice[:, i], choice[:, j]] for i in range(len(sets)) for j in range(len(sets)))
        consistency = np.asarray(total) / (number * (number - 1))
        for at in np.nonzero(consistency >= settings.least_global)[0]:
            pairs = tuple(walls[w] for w in np.nonzero(member[choice[at]].sum(axis=0))[0])
            found.append(Merged(rooms, pairs, float(consistency[at]), frame))
    return [m for m in found if upright(s, a, m)] if settings.upright_only else found


def _reference(sets: Sequence[list[AgreeingSet]]) -> int:
    """The room pair with the longest wall set, the best of those."""
    return max(range(len(sets)), key=lambda k: max((len(x.pairs), x.score) for x in sets[k]))


def pair_affinity(
    s: Datums, a: Datums, planes: Planes, frame: tuple[int, int], pairs: Sequence[tuple[int, int]]
) -> Array:
    """(n, n) of wall pairs, about the centres of a pair of rooms."""
    of_s, of_a = (np.array([p[k] for p in pairs], dtype=np.int64) for k in (0, 1))
    every = np.arange(len(pairs))
    in_s, in_a = Compared.of_walls(s, of_s, frame[0]), Compared.of_walls(a, of_a, frame[1])
    return wall_affinity(planes, in_s, in_a, every, every)


def upright(s: Datums, a: Datums, solution: Merged) -> bool:
    """Whether the motion between the walls' points is proper and turns the plan by little (Kabsch)."""
    of_s, of_a = _rows(solution.walls)
    p, q = s.feet(of_s, solution.frame[0]), a.feet(of_a, solution.frame[1])
    U, _, Vt = np.linalg.svd((p - p.mean(axis=0)).T @ (q - q.mean(axis=0)))
    R = Vt.T @ U.T
    return bool(np.linalg.det(R) > 0 and R[0, 0] > LEAST_COS and R[1, 1] > LEAST_COS and abs(R[0, 1]) < MOST_SIN)


def tied(found: list[Merged], apart: float) -> list[Merged]:
    """Returns the solutions linked to the best by a chain of consistencies at most `apart` from each other.

    This equals DBSCAN with one sample in one dimension.
    """
    value = np.sort([m.consistency for m in found])[::-1]
    gaps = np.nonzero(-np.diff(value) > apart)[0]
    least = value[gaps[0]] if len(gaps) else -np.inf
    return [m for m in found if m.consistency >= least]


def with_roomless(s: Datums, a: Datums, settings: CombinatorialSettings, solution: Merged) -> Merged:
    """Adds walls without a room where their pose relative to the first pair is as in the plan."""
    like = _to(s, a, settings.planes, solution, s.roomless, a.roomless, solution.walls[:1])
    added = _one_to_one(like, settings.least_interlevel, s.roomless, a.roomless)
    walls = (*solution.walls, *added)
    affinity = pair_affinity(s, a, settings.planes, solution.frame, walls)
    n = len(walls)
    return replace(solution, walls=walls, consistency=float((affinity.sum() - n) / (n * (n - 1))))


def with_left_over(s: Datums, a: Datums, settings: CombinatorialSettings, solution: Merged) -> Merged:
    """Pairs the remaining walls of matched rooms, as deviated ones, if all other matches agree."""
    if settings.deviated is None:
        return solution
    walls = solution.walls
    for r, q in solution.rooms:
        of_s = np.setdiff1d(s.of_room[r], [w for w, _ in solution.walls])
        of_a = np.setdiff1d(a.of_room[q], [w for _, w in solution.walls])
        like = _to(s, a, settings.deviated, solution, of_s, of_a, solution.walls)
        walls += _one_to_one(like, settings.least_deviated, of_s, of_a)
    return replace(solution, walls=walls)


def _to(
    s: Datums, a: Datums, planes: Planes, solution: Merged, of_s: Index, of_a: Index, pairs: Pairs
) -> NDArray[np.float64]:
    """(S walls, A walls) the mean affinity of each possible pair with the given pairs."""
    likes = np.zeros((len(of_s), len(of_a)))
    for i, w in enumerate(of_s.tolist()):
        for j, v in enumerate(of_a.tolist()):
            likes[i, j] = pair_affinity(s, a, planes, solution.frame, [(w, v), *pairs])[0, 1:].mean()
    return likes


def _one_to_one(like: Array, least: float, of_s: Index, of_a: Index) -> Pairs:
    """Pairs one to one, best first."""
    found: list[tuple[int, int]] = []
    for at in np.argsort(-like, axis=None, kind="stable").tolist():
        i, j = divmod(at, like.shape[1])
        if like[i, j] >= least and all(i != k and j != m for k, m in found):
            found.append((i, j))
    return tuple((int(of_s[i]), int(of_a[j])) for i, j in found)


def _rows(pairs: Pairs) -> tuple[Index, Index]:
    table = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return table[:, 0], table[:, 1]
