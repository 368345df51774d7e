"""Free space of a map as evidence: planned walls do not stand where rays passed, unless they were not built."""

from dataclasses import replace

import numpy as np
import pytest
from methods import SMALL, as_map, matcher

from data import SceneGraph
from data.geometry import se2
from data.scene_graph import WallSurface
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching.arrays import storeys
from matching.engine.hypotheses import scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.verdict import NOT_BUILT, Signs
from matching.result import MatchResult
from matching.training.truth import RIGHT_M, generated, seeds_of


def outlined(drawn: DrawnGraph, plan: SceneGraph) -> SceneGraph:
    """The map with the outlines of its rooms, as rays see them."""
    polygon = {room.id: room.polygon for room in plan.rooms}
    rooms = []
    for room in drawn.s_graph.rooms:
        own = polygon.get(drawn.rooms.get(room.id, ""))
        if own is not None:
            seen = se2.apply(se2.inverse(np.array(drawn.T_a_s_by_room[room.id])), np.array(own))
            room = replace(room, polygon=tuple((float(x), float(y)) for x, y in seen))
        rooms.append(room)
    return replace(drawn.s_graph, rooms=tuple(rooms))


def is_right(answer: MatchResult, drawn: DrawnGraph) -> bool:
    middle = np.array([*drawn.s_graph.centroid(), 0.0, 1.0])
    true = replace(answer, T_a_s=drawn.T_a_s).matrix
    assert true is not None and answer.matrix is not None
    return bool(np.linalg.norm((answer.matrix - true) @ middle) < RIGHT_M)


def sure(answer: MatchResult) -> bool:
    return bool(answer.hypotheses) and (answer.hypotheses[0].probability or 0.0) >= 0.99


def test_equal_rooms_are_told_apart_by_where_the_map_ends() -> None:
    decided = np.zeros(2, dtype=int)
    for n in range(60):
        kind = ("office", "corridor")[n % 2]
        seeds = seeds_of("test")[kind]
        plan = generated(kind, seeds[n % len(seeds)]).graph
        drawn = draw(plan, "real", np.random.default_rng(n), 4)
        for k, s in enumerate((drawn.s_graph, outlined(drawn, plan))):
            answer = matcher("voting").match(s, plan)
            if sure(answer):
                decided[k] += 1
                assert is_right(answer, drawn), (kind, n, k)
    assert decided[1] > decided[0], decided


def wall_through(room: str, plan: SceneGraph, length: float) -> tuple[WallSurface, ...]:
    """Both sides of a wall in the middle of a room."""
    x, y = next(r.centroid for r in plan.rooms if r.id == room)
    return tuple(WallSurface(f"more{side}", room, (x + 0.05 * side, y), (float(side), 0.0), length) for side in (-1, 1))


@pytest.mark.parametrize(("length", "nats"), [(0.3, 0.0), (2.0, np.log(NOT_BUILT))])
def test_a_wall_that_was_not_built_costs_what_that_is_unlikely(length: float, nats: float) -> None:
    room = max(SMALL.rooms, key=lambda r: 0.0 if r.polygon is None else np.ptp(np.array(r.polygon), axis=0).min())
    more = wall_through(room.id, SMALL, length)
    plan = replace(SMALL, wall_surfaces=(*SMALL.wall_surfaces, *more))
    walls = PlanWalls.of(plan)
    assert walls is not None
    signs = Signs.of(search(scene_of(as_map(SMALL), walls)))
    assert signs.of_free_space[0] == pytest.approx(nats, abs=0.05)


def test_cells_away_from_the_outline_are_inside_and_rooms_without_one_are_unknown() -> None:
    own = storeys(SMALL)[0]
    places = np.array([se2.apply(se2.inverse(own.T_graph_own), np.array(room.centroid)) for room in own.rooms])
    assert own.free_space.is_inside(places).all()
    assert (own.free_space.room_at(places) == np.arange(len(own.rooms))).all()
    assert not own.free_space.is_inside(places + 1e3).any()
    bare = replace(SMALL, rooms=tuple(replace(room, polygon=None) for room in SMALL.rooms))
    assert not storeys(bare)[0].free_space.is_inside(places).any()
