"""Rival placements as sets of tokens, the input of the judge; nothing depends on a frame, or on the placements' order.

A token is a wall of the map with its best partner, a planned wall that the map should have but lacks, or a door of the
map or of the plan. Beside the tokens each placement has a few features of its own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry import se2
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.arrays.free_space import STEP_M
from matching.engine.door_evidence import placed_doors
from matching.engine.evidence import SHOWN, Chance, Terms, evidence, seen_walls
from matching.engine.field import motions
from matching.engine.free_space import shares_in_map
from matching.engine.hypotheses import Hypotheses
from matching.engine.verdict import MOST_LOG_ODDS, Signs, shipped

RIVALS = 10  # placements that are judged, at most
NEAR_DOOR_M = 1.0  # from a planned door to one of the map that is it
TOKEN = (
    "map's wall", "planned wall", "door", "of the plan alone", "log length", "has partner", "quality", "nats", "lead",
    "across 5 cm", "across 20 cm", "first end", "second end", "turn", "beside", "partner's log length",
    "of its room", "shared", "has room", "in free space", "room", "at home", "elsewhere", "of home",
)  # fmt: skip
PLACEMENT = (
    "log share", "log odds", "nats", "of walls", "of planned walls", "of doors", "of bending", "a wall", "behind",
    "explained", "supported", "log walls", "rooms", "rivals", "free space",
)  # fmt: skip
SKIPPED = 2  # the first features of a placement, whose sum are its log odds by evidence alone
OF = {name: n for n, name in enumerate(TOKEN)}


@dataclass(frozen=True)
class Placements:
    """K rivals: `tokens` (T, len(TOKEN)) of all of them, `of` (T,) which one each token describes, and `features` (K,
    len(PLACEMENT)); `unlisted` is the share that the evidence leaves to hypotheses beyond these."""

    tokens: NDArray[np.float32]
    of: Index
    features: NDArray[np.float32]
    unlisted: float = 0.0

    def __len__(self) -> int:
        return len(self.features)


def placements_of(found: Hypotheses, signs: Signs) -> Placements:
    """The first `RIVALS` of at least one hypothesis, the likeliest first; `signs` are those of all."""
    share, odds = shipped().among(signs)[:RIVALS], shipped().in_plan(signs)
    found = found[np.arange(len(share))]
    scene, best = found.scene, np.array([found.score.argmax()])
    chance = Chance.of(scene, found.fields[best], found.table[best])
    terms = evidence(scene, found.fields, found.table, chance)
    tokens, of = zip(*(_of_plan(found, terms, k) for k in range(len(found))), strict=True)
    walls = _of_walls(found, terms)
    walls_of = np.repeat(np.arange(len(found)), walls.shape[1])
    rooms, rooms_of = _of_rooms(found, terms)
    every = np.concatenate((walls.reshape(-1, len(TOKEN)), *tokens, rooms))
    each = np.concatenate((walls_of, *of, rooms_of))
    features = _features(found, terms, signs, share, odds)
    return Placements(
        every.astype(np.float32),
        each,
        features.astype(np.float32),
        max(0.0, 1.0 - float(share.sum())),
    )


def _features(found: Hypotheses, terms: Terms, signs: Signs, share: Array, in_plan: float) -> Array:
    """(K, len(PLACEMENT)), each of order one."""
    s, score = found.scene.s, found.score
    explained = terms.now.quality.max(axis=2, initial=0.0) @ s.half / s.half.sum()
    odds = np.clip(np.log(max(in_plan, 1e-9) / max(1 - in_plan, 1e-9)), -8.0, 8.0)
    of_map = [odds, signs.walls, len(s.rooms) / 5, len(found) / 5]  # the plan's size is in the odds alone
    of_all = np.tile(of_map, (len(found), 1))
    columns = (
        np.log(np.maximum(share, np.exp(-MOST_LOG_ODDS / 4))), of_all[:, 0], score / 20, terms.walls / 20,
        terms.seen / 5, terms.doors / 5, terms.bending / 5, score / len(s), (score - score.max()) / 5, explained,
        (terms.each > 0.5).mean(axis=1), *of_all[:, 1:].T, signs.of_free_space[: len(score)],
    )  # fmt: skip
    return np.stack(columns, axis=1)


def _of_walls(found: Hypotheses, terms: Terms) -> Array:
    """(K, Ns, len(TOKEN)) the map's walls, with the residuals to their best partners."""
    s, plan, now, table = found.scene.s, found.scene.plan, terms.now, found.table
    best = now.quality.argmax(axis=2)[..., None]
    at = [np.take_along_axis(each, best, axis=2)[..., 0] for each in (table, now.quality, now.across, now.along)]
    j, quality, across, along = at
    turned, beside = (np.take_along_axis(each, best, axis=2)[..., 0] for each in (now.turned, now.beside))
    has = (j >= 0) & (quality > 1e-4)
    j = np.where(has, j, 0)
    a_half, home = plan.half[j], np.where(s.room >= 0, terms.homes[:, s.room], -1) if len(s.rooms) else -1
    shared = np.stack([np.bincount(row[on], minlength=len(plan))[row] for row, on in zip(j, has, strict=True)])
    tokens = np.zeros((*j.shape, len(TOKEN)))
    tokens[..., OF["map's wall"]] = 1.0
    tokens[..., OF["log length"]] = np.log(2 * s.half)
    tokens[..., OF["nats"]] = terms.each / 4
    tokens[..., OF["lead"]] = np.tanh((terms.each - _best_rival(terms.each)) / 4)
    tokens[..., OF["has room"]] = s.room >= 0
    tokens[..., OF["has partner"] : OF["nats"]] = np.stack((has, has * quality), axis=-1)
    residuals = (
        np.tanh(np.abs(across) / 0.05), np.tanh(np.abs(across) / 0.2), np.tanh((along + s.half - a_half) / 0.3),
        np.tanh((s.half - along - a_half) / 0.3), np.tanh(np.abs(turned) / 0.05), beside, np.log(2 * a_half + 0.1),
        (home >= 0) & (plan.room[j] == home), np.minimum(shared, 4) / 4,
    )  # fmt: skip
    tokens[..., OF["across 5 cm"] : OF["has room"]] = has[..., None] * np.stack(residuals, axis=-1)
    return tokens


def _best_rival(each: Array) -> Array:
    """(K, Ns) the most nats of each wall in any other placement, at least those of chance."""
    order = np.sort(np.concatenate((each, np.full((2, each.shape[1]), min(0.0, each.min())))), axis=0)
    return np.maximum(np.where(each == order[-1], order[-2], order[-1]), 0.0)


def _of_rooms(found: Hypotheses, terms: Terms) -> tuple[Array, Index]:
    """Tokens of the map's rooms whose outlines are known."""
    s, plan = found.scene.s, found.scene.plan
    places, room = s.free_space.centres
    rooms, own = np.unique(room, return_inverse=True)
    tokens = np.zeros((len(found), len(rooms), len(TOKEN)))
    if not len(rooms):
        return tokens.reshape(0, len(TOKEN)), np.zeros(0, dtype=np.int64)
    size = np.bincount(own)
    moved = motions(found.scene, found.fields.state)[:, found.scene.group_of_room[room]]
    for k, storey in enumerate(found.fields.storey.tolist()):
        space, home = plan.storeys[storey].free_space, terms.homes[k][rooms]
        at = space.room_at(se2.apply(moved[k], places))
        here, none = np.bincount(own, at == home[own]) / size, np.bincount(own, at < 0) / size
        area = np.bincount(space.room[space.room >= 0], minlength=max(len(plan.storeys[storey].rooms), 1))
        tokens[k, :, OF["has partner"]] = has = home >= 0
        tokens[k, :, OF["at home"]] = here * has
        tokens[k, :, OF["elsewhere"]] = 1 - none - here * has
        tokens[k, :, OF["of home"]] = has * np.tanh(here * size / np.maximum(area[home], 1))
    tokens[..., OF["room"]] = 1.0
    tokens[..., OF["log length"]] = np.log(size * STEP_M**2) / 2
    return tokens.reshape(-1, len(TOKEN)), np.repeat(np.arange(len(found)), len(rooms))


def _of_plan(found: Hypotheses, terms: Terms, k: int) -> tuple[Array, Index]:
    """Tokens of one placement: of planned walls that the map lacks, of its doors and of planned doors it lacks."""
    scene, home, storey = found.scene, terms.homes[k], int(found.fields.storey[k])
    a, doors, own = scene.plan.storeys[storey], scene.plan.doors[storey], scene.doors
    rooms = home[home >= 0]
    seen = seen_walls(scene, storey, found.table[k], terms.now.quality[k])
    unseen_walls = np.flatnonzero(~seen & (4 * a.half > SHOWN))
    inside = shares_in_map(found, k, unseen_walls)
    expected = np.isin(a.room[unseen_walls], rooms) | (inside > 0)
    missing, inside = unseen_walls[expected], inside[expected]
    walls = np.zeros((len(missing), len(TOKEN)))
    walls[:, OF["in free space"]] = inside
    walls[:, OF["of its room"]] = np.isin(a.room[missing], rooms)
    walls[:, [OF["planned wall"], OF["of the plan alone"]]] = 1.0
    walls[:, OF["log length"]] = np.log(2 * a.half[missing])

    off = np.linalg.norm(placed_doors(scene, found.fields.state[k])[:, None] - doors.place, axis=-1)
    mapped = np.zeros((len(own), len(TOKEN)))
    mapped[:, OF["door"]] = 1.0
    if off.size:
        nearest, least = off.argmin(axis=1), off.min(axis=1)
        joined = np.where(own.rooms >= 0, home[own.rooms], -1)
        same = (np.sort(joined, axis=1) == np.sort(doors.rooms[nearest], axis=1)).all(axis=1)
        mapped[:, OF["has partner"]] = least < 2 * NEAR_DOOR_M
        mapped[:, OF["quality"]] = np.exp(-0.5 * (least / 0.45) ** 2)
        mapped[:, OF["across 5 cm"]], mapped[:, OF["across 20 cm"]] = np.tanh(least / 0.3), np.tanh(least / 1.5)
        mapped[:, OF["of its room"]] = same
    unseen = (off.min(axis=0, initial=np.inf) >= NEAR_DOOR_M) & np.isin(doors.rooms, rooms).all(axis=1)
    planned = np.zeros((int(unseen.sum()), len(TOKEN)))
    planned[:, [OF["door"], OF["of the plan alone"]]] = 1.0
    tokens = np.concatenate((walls, mapped, planned))
    return tokens, np.full(len(tokens), k)
