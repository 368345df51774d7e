"""Proposals without learning: corners vote for placements, and each gives its walls a score."""

from dataclasses import replace

import numpy as np

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.arrays import Index, Walls, arrays, storeys
from matching.arrays.doors import doors
from matching.engine.corners import corners
from matching.arrays.groups import Groups, groups
from matching.search.proposals import Proposals, TopK
from matching.search.scoring import Pairing, fit, refine_rigid
from matching.engine.votes import Marks, candidates, vote

MOST_PARTS = 8
MOST_WALLS = 200  # of a map that votes as a whole
MOST_PLACES = 40  # of each yaw mode, in a part
KEPT = 10  # placements of a part that are used
SIGMA = 0.25  # metres across
SHARPNESS = 1.0  # of a placement's odds for each unit of weight that it explains
SMALL_PART = 4  # walls; smaller ones have too few corners to vote


def voting_proposals(
    s: SceneGraph, a: SceneGraph, known: Walls | None = None, by_parts: bool = True
) -> Proposals:
    """Returns wall and room pairs from placements of the whole map by voting.

    With `by_parts`, parts of the map (each a room and its neighbours) vote as well. `known` are the map's surfaces as
    arrays, if already computed.
    """
    plan = storeys(a)
    if not s.wall_surfaces or not plan:
        return Proposals(*(TopK(np.zeros((n, 0), dtype=np.int64), np.zeros((n, 0)))
                           for n in (len(s.wall_surfaces), len(s.rooms))))  # fmt: skip
    walls = known or arrays(s, None, list(s.wall_surfaces))
    score = np.zeros((len(walls), len(a.wall_surfaces)))
    place = {w.id: n for n, w in enumerate(a.wall_surfaces)}
    column = [np.array([place[i] for i in storey.ids]) for storey in plan]
    plan_corners = [corners(storey) for storey in plan]
    for part in _parts(groups(walls, doors(s, walls))) if by_parts else [np.arange(len(walls))]:
        _speak(_part(walls, part), part, plan, plan_corners, column, score)
    proposals = TopK.of_dense(score)
    return Proposals(proposals, _rooms(s, a, score))


def _parts(of: Groups) -> list[Index]:
    """The walls of the map, and of rooms with their neighbours, that cover it."""
    size = np.bincount(of.of_wall, minlength=len(of))
    near = of.hops <= 1
    free = np.ones(len(of), dtype=bool)
    parts = [np.arange(len(of.of_wall))] if len(of.of_wall) <= MOST_WALLS or len(of) < 3 else []
    while free.any() and len(parts) <= MOST_PARTS and len(of) > 2:
        best = int(np.argmax(np.where(free, near @ size, -1)))
        free &= ~near[best]
        parts.append(np.nonzero(near[best][of.of_wall])[0])
    return [p for p in parts if len(p) >= SMALL_PART or len(p) == len(of.of_wall)]


def _part(s: Walls, chosen: Index) -> Walls:
    return replace(
        s, ids=tuple(s.ids[i] for i in chosen), centre=s.centre[chosen], heading=s.heading[chosen],
        half=s.half[chosen], known=s.known[chosen], room=s.room[chosen],
    )  # fmt: skip


def _speak(
    part: Walls, rows: Index, plan: list[Walls], plan_corners: list[Marks], column: list[Index], score: Array
) -> None:
    """Raises the scores of the part's walls to those of its placements."""
    own = corners(part)
    found: list[tuple[float, int, Pairing, Array]] = []
    for st, a in enumerate(plan):
        few = len(own.point) < SMALL_PART
        for voted in candidates(part, a) if few else vote(own, plan_corners[st], MOST_PLACES):
            pairing = Pairing.near(part, a, voted.yaw)
            motions = refine_rigid(pairing, voted.motions, (0.4,))
            quality = fit(pairing, pairing.state(motions), SIGMA).quality
            worth = part.weight @ quality.max(axis=2)
            best = np.argsort(-worth, kind="stable")[:KEPT]
            found += [(float(worth[k]), st, pairing, quality[:, k : k + 1]) for k in best]
    found = sorted(found, key=lambda f: -f[0])[: KEPT * len(plan)]
    if not found:
        return
    odds = np.exp(SHARPNESS * (np.array([f[0] for f in found]) - found[0][0]))
    mixed = [np.zeros((len(part), len(a))) for a in plan]
    for share, (_, st, pairing, quality) in zip(odds / odds.sum(), found, strict=True):
        mixed[st] += share * pairing.table(quality)
    for st, values in enumerate(mixed):
        at = np.ix_(rows, column[st])
        score[at] = np.maximum(score[at], np.clip(values, 0.0, 1.0))


def _rooms(s: SceneGraph, a: SceneGraph, score: Array) -> TopK:
    """A room pair's score: the mean over the S room's walls, by length, of their best score in the A room."""
    s_place = {r.id: n for n, r in enumerate(s.rooms)}
    a_place = {r.id: n for n, r in enumerate(a.rooms)}
    s_room = np.array([-1 if w.room is None else s_place[w.room] for w in s.wall_surfaces])
    a_room = np.array([-1 if w.room is None else a_place[w.room] for w in a.wall_surfaces])
    length = np.array([w.length or 1.0 for w in s.wall_surfaces])
    best = np.zeros((len(s_room), len(a.rooms)))
    i, j = np.nonzero(score)
    with_room = a_room[j] >= 0
    np.maximum.at(best, (i[with_room], a_room[j[with_room]]), score[i[with_room], j[with_room]])
    table = np.zeros((len(s.rooms), len(a.rooms)))
    inside = s_room >= 0
    np.add.at(table, s_room[inside], length[inside, None] * best[inside])
    total = np.bincount(s_room[inside], length[inside], len(s.rooms)) if inside.any() else np.ones(len(s.rooms))
    return TopK.of_dense(table / np.maximum(total, 1e-9)[:, None])
