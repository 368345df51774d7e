"""Gives the points of a map back to the poses that saw them."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_BIN = np.deg2rad(2.0)  # of direction, in which near points hide those behind them
_BEHIND = 0.1  # m, by which a point that is seen may lie behind the nearest one of its direction: less than a wall


def viewpoints(poses: Floats, distance: float, angle: float) -> NDArray[np.intp]:
    """(V,) the indices of poses (N, 4, 4), each `distance` (m) or `angle` (rad) from the one before; the first is
    one."""
    chosen = [0] if len(poses) else []
    for k in range(1, len(poses)):
        last, pose = poses[chosen[-1]], poses[k]
        cosine = (np.sum(last[:3, :3] * pose[:3, :3]) - 1) / 2
        if np.linalg.norm(pose[:3, 3] - last[:3, 3]) >= distance or np.arccos(np.clip(cosine, -1, 1)) >= angle:
            chosen.append(k)
    return np.array(chosen, np.intp)


def owners(points: Floats, places: Floats, reach: float) -> NDArray[np.intp]:
    """(N,) for each point (N, 3) of a map the index of one of the places (V, 3) that could see it; -1 for none.

    A place could see a point within `reach` (m) that nothing hides: of all points in its direction, to two degrees, it
    is among the nearest, to a tenth of a metre. Among several places chance decides, the same way each time. So each
    point counts once, and yet every place sees what is far; given to the nearest places, points would show each of them
    only the walls beside it.
    """
    owner, seers = np.full(len(points), -1, np.intp), np.zeros(len(points), np.intp)
    rng = np.random.default_rng(0)
    for k, place in enumerate(places):
        away = points - place
        squared = np.einsum("ij,ij->i", away, away)
        near = np.flatnonzero((squared < reach**2) & (squared > 0))
        seen = near[_visible(away[near], np.sqrt(squared[near]))]
        seers[seen] += 1
        taken = rng.random(len(seen)) * seers[seen] < 1  # each of the places so far with equal chance
        owner[seen[taken]] = k
    return owner


def _visible(away: Floats, ranges: Floats) -> NDArray[np.bool_]:
    """(M,) whether points in directions `away` (M, 3) at `ranges` (M,) are hidden by no other."""
    rows, columns = int(np.ceil(np.pi / _BIN)) + 1, int(np.ceil(2 * np.pi / _BIN)) + 1
    row = ((np.arcsin(np.clip(away[:, 2] / ranges, -1, 1)) + np.pi / 2) / _BIN).astype(np.intp)
    column = ((np.arctan2(away[:, 1], away[:, 0]) + np.pi) / _BIN).astype(np.intp)
    cell = row * columns + column
    first = np.full(rows * columns, np.inf)
    np.minimum.at(first, cell, ranges)
    return np.asarray(ranges <= first[cell] + _BEHIND)
