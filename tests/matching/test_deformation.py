"""Maps that bend: which pairs are found, and which places are told apart."""

import dataclasses

import numpy as np
import pytest
from methods import matcher
from plans import a_graph, flat, moved, offices

from data import Door, SceneGraph, WallSurface
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching import MatchResult

MATCHER = matcher("voting")
PLAN = a_graph(flat(np.random.default_rng(3)), "ground")


def drawn_from(plan: SceneGraph, noise: str, seed: int, rooms: int | None = None) -> DrawnGraph:
    return draw(plan, noise, np.random.default_rng(seed), rooms)


@pytest.fixture(scope="module")
def drifted() -> DrawnGraph:
    return drawn_from(PLAN, "drift", 1, 9)


def pairs(result: MatchResult) -> set[tuple[str, str]]:
    return {(s, a) for s, a, _ in (*result.rooms, *result.wall_surfaces)}


def share_right(result: MatchResult, truth: DrawnGraph) -> float:
    return sum(truth.wall_surfaces.get(s) == a for s, a, _ in result.wall_surfaces) / len(truth.wall_surfaces)


def test_a_drifting_map_is_matched_and_decided(drifted: DrawnGraph) -> None:
    result = MATCHER.match(drifted.s_graph, PLAN)
    assert result.status == "unique", result.reason
    assert {(s, a) for s, a, _ in result.rooms} <= set(drifted.rooms.items())
    assert len(result.rooms) >= 0.9 * len(drifted.rooms)
    assert share_right(result, drifted) > 0.9


def test_rooms_merged_and_cut_are_not_matched_wrongly() -> None:
    for seed in range(6):
        truth = drawn_from(PLAN, "mis_segmented", seed, 8)
        result = MATCHER.match(truth.s_graph, PLAN)
        assert {(s, a) for s, a, _ in result.rooms} <= set(truth.rooms.items()), seed
        assert share_right(result, truth) > 0.85


def test_doors_tell_equal_offices_apart() -> None:
    """Ten equal offices on both sides of a corridor; those below have their doors left or right."""
    row = a_graph(offices([3.0] * 5, [3.0] * 5))
    below, above, corridor = row.rooms[:5], row.rooms[5:10], row.rooms[10]
    places = [*zip(below, (-1.0, 1.0, -1.0, -1.0, 1.0), strict=True), *((r, -0.6) for r in above)]
    doors = tuple(
        Door(f"d{n}", (r.id, corridor.id), (r.centroid[0] + off, 5.06 if r in below else 7.18))
        for n, (r, off) in enumerate(places)
    )
    plan = dataclasses.replace(row, doors=doors)
    seen = {corridor.id, *(r.id for r in below[1:4])}
    part = SceneGraph(
        "map", tuple(r for r in plan.rooms if r.id in seen),
        tuple(
            dataclasses.replace(w, length=min(w.length or 0.0, 9.5), centroid=(7.7, w.centroid[1]))
            if w.room == corridor.id and abs(w.normal[1]) > 0.5 else w
            for w in plan.wall_surfaces if w.room in seen and (w.room != corridor.id or abs(w.normal[1]) > 0.5)
        ),
        tuple(d for d in plan.doors if set(d.rooms) <= seen),
    )  # fmt: skip
    bare = dataclasses.replace(part, doors=())
    without, told = (MATCHER.match(moved(s, 2.0, 5.0, -3.0), plan) for s in (bare, part))
    (first, second), (best, other) = ([h.probability or 0.0 for h in m.hypotheses[:2]] for m in (without, told))
    assert without.status == "ambiguous" and first == pytest.approx(second) and best > 2 * max(first, other)
    assert {(s, a) for s, a, _ in told.rooms} == {(r, r) for r in seen}


def test_a_large_map_of_lone_walls_has_no_place() -> None:
    walls = tuple(WallSurface(f"w{n}", None, (40.0 * n, 0.0), (1.0, 0.0), 2.0) for n in range(210))
    assert MATCHER.match(SceneGraph("map", (), walls), PLAN).status == "none"
