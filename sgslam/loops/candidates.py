"""Loop candidates: earlier passes that a keyframe may have come back to, within the possible drift of the map."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.config.loop_settings import LoopSettings

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
_VIEW = 2.5  # m between two places from which much the same is seen
_HELD = 0.5  # common walls that two keyframes need across each direction
_NEAR = 8.0  # m between keyframes that common walls tie together


@dataclass(frozen=True)
class Pass:
    """Consecutive keyframes that passed a place; `by` is what proposes them.

    `drift` (m) and `turn` (rad) bound their error relative to the keyframe that came back.
    """

    keyframes: Index
    drift: float
    turn: float
    by: str = "position"


@dataclass(frozen=True)
class Ties:
    """Pairs (T, 2) of keyframes, the newer first, that the graph ties together by common walls or a closure."""

    pairs: Index

    def way_between(self, way: Floats, i: int) -> Floats:
        """(K,) metres that drift accumulates over from keyframe i to each other: along the way (K,) and over ties."""
        direct = np.abs(way - way[i])
        if not len(self.pairs):
            return direct
        ends = np.concatenate([self.pairs, self.pairs[:, ::-1]])
        over = np.abs(way[i] - way[ends[:, 0]])[:, None] + np.abs(way[ends[:, 1]][:, None] - way[None])
        return np.minimum(direct, over.min(axis=0))


def way_driven(places: Floats) -> Floats:
    """(K,) metres driven up to each of the places (K, 2)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])


def tied_by_walls(
    new: Index, places: Floats, way: Floats, incidence: NDArray[np.float32], normals: Floats, gap: float
) -> Index:
    """(T, 2) keyframes of `new` (N,), each with an older one that saw common walls in all horizontal directions.

    The older one is more than `gap` metres of way before. `incidence` (K, W) is 1 where a keyframe saw a wall;
    `normals` (W, 2) are the walls'.
    """
    if not len(new) or not len(normals):
        return np.empty((0, 2), dtype=np.int64)
    mine, n = incidence[new], normals.astype(np.float32)
    xx, xy, yy = ((mine * (n[:, a] * n[:, b])) @ incidence.T for a, b in ((0, 0), (0, 1), (1, 1)))
    worst = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
    near = np.linalg.norm(places[new][:, None] - places[None], axis=2) < _NEAR
    older = way[new][:, None] - way[None] > gap
    worst = np.where(near & older, worst, 0.0)
    best = worst.argmax(axis=1)
    tied = worst[np.arange(len(new)), best] > _HELD
    return np.column_stack([new[tied], best[tied]])


def passes_near(
    i: int, places: Floats, way: Floats, chosen: NDArray[np.bool_], ties: Ties, settings: LoopSettings,
    similar: Mapping[str, Index] | None = None,
) -> list[Pass]:  # fmt: skip
    """The passes that keyframe i may have come back to, the nearest first.

    `places` (K, 2) and `way` (K,) are those of all keyframes. Candidates are `chosen` (K,) keyframes more than `gap`
    metres of way before, no farther off than the drift since then allows; those that are `similar` by their walls or
    rooms may be twice as far.
    """
    between = ties.way_between(way, i)
    allowed, turn = settings.drift_base + settings.drift * between, settings.turn_base + settings.turn * between
    older = chosen & (way[i] - way > settings.gap)
    off = np.linalg.norm(places - places[i], axis=1)
    found: list[Pass] = []
    proposed = [("position", np.arange(len(way)), 1.0), *((by, own, 2.0) for by, own in (similar or {}).items())]
    for by, candidates, times in proposed:
        drift = np.minimum(times * allowed, settings.most_drift)
        near = candidates[older[candidates] & (off[candidates] < drift[candidates] + _VIEW)]
        if not len(near):
            continue
        new: list[tuple[float, Pass]] = []
        for own in np.split(near, np.flatnonzero(np.diff(way[near]) > settings.submap) + 1):
            nearest = int(own[np.argmin(off[own])])
            if any(nearest in p.keyframes for p in found):
                continue
            around = np.flatnonzero(older & (np.abs(way - way[nearest]) < settings.submap))
            turned = min(times * float(turn[nearest]), settings.most_turn)
            new.append((float(off[nearest]), Pass(around, float(drift[nearest]), turned, by)))
        found += [p for _, p in sorted(new, key=lambda one: one[0])]
    return found
