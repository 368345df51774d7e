"""S-graphs drawn from A-graphs: what is seen, how badly, and that the truth is true."""

import dataclasses

import numpy as np
import pytest
import shapely
from plans import a_graph, box, flat, merged, moved, offices

from data import Door, SceneGraph, UserError, WallSurface
from data.geometry import se2
from data.synthetic_maps.noise_models import NOISE_MODELS, DrawnGraph, draw

PLAN = a_graph(flat(np.random.default_rng(3)), "ground")
BIG = a_graph(flat(np.random.default_rng(5), 80.0, 60.0))
MAPPED = ("real", "drift", "mis_segmented")


def rng(*seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def placed(drawn: DrawnGraph, wall: WallSurface) -> tuple[np.ndarray, float]:
    """Ends (2, 2) and heading of an S surface in the A-graph's frame, under its room's true motion."""
    T = np.array(drawn.T_a_s if wall.room is None else drawn.T_a_s_by_room[wall.room])
    n = se2.rotate(T[0], np.array(wall.normal))
    return se2.apply(T, np.array(wall.ends())), float(np.arctan2(n[1], n[0]))


def residuals(drawn: DrawnGraph, a: SceneGraph) -> dict[str, np.ndarray]:
    """By A surface, of each S surface that is it: (across, low end, high end, turn) from the A surface's own."""
    found: dict[str, list[list[float]]] = {}
    for s_id, a_id in drawn.wall_surfaces.items():
        ends, heading = placed(drawn, drawn.s_graph.surface_by_id[s_id])
        wall = a.surface_by_id[a_id]
        n, half = np.array(wall.normal), (wall.length or 0.0) / 2
        along = (ends - wall.centroid) @ [-n[1], n[0]]
        across = float((ends.mean(axis=0) - wall.centroid) @ n)
        turn = float(se2.wrap(np.array(heading - np.arctan2(n[1], n[0]))))
        found.setdefault(a_id, []).append([across, along.min() + half, along.max() - half, turn])
    return {key: np.array(rows) for key, rows in found.items()}


@pytest.fixture(scope="module")
def real() -> list[DrawnGraph]:
    return [draw(BIG, "real", rng(k), 60) for k in range(12)]


def test_walls_have_the_noise_that_is_stated(real: list[DrawnGraph]) -> None:
    rows, long_walls = [], [w for w in BIG.wall_surfaces if (w.length or 0.0) > 2.5]
    seen = pieces = walls = clutter = 0
    for drawn in real:
        found = residuals(drawn, BIG)
        rooms = set(drawn.rooms.values())
        own = [w.id for w in long_walls if w.room in rooms]
        walls += len(own)
        seen += sum(key in found for key in own)
        pieces += sum(len(found.get(key, ())) == 2 for key in own)
        rows += [found[key][0] for key in own if len(found.get(key, ())) == 1]
        clutter += len(drawn.s_graph.wall_surfaces) - len(drawn.wall_surfaces)
    across, low, high, turn = np.array(rows).T
    assert np.std(across) == pytest.approx(0.061, rel=0.06)
    assert np.std(turn) == pytest.approx(np.radians(0.15), rel=0.06)
    for end in (low, high):
        assert abs(np.mean(end)) < 0.04 and np.std(end) == pytest.approx(0.346, rel=0.06)
    assert abs(np.corrcoef(low, high)[0, 1]) < 0.1
    assert seen / walls == pytest.approx(0.9, abs=0.02)
    assert pieces / walls == pytest.approx(0.09, abs=0.02)
    everything = sum(len(BIG.surfaces_of_room[r]) for d in real for r in d.rooms.values())
    assert 0.07 < clutter / everything < 0.11


@pytest.mark.parametrize("noise", NOISE_MODELS)
def test_the_truth_lays_surfaces_on_their_walls_and_rooms_into_their_rooms(noise: str) -> None:
    for k in range(5):
        drawn = draw(PLAN, noise, rng(k), 6)
        assert drawn.floor == "ground" and drawn.deformed == (noise in ("drift", "mis_segmented", "heavy_drift"))
        assert set(drawn.rooms) == set(drawn.s_graph.room_by_id) == set(drawn.T_a_s_by_room)
        if noise != "mis_segmented":  # there the walls of two rooms may be in one, which moves as the larger
            assert all(len(rows) < 3 and np.abs(rows[:, 0]).max() < 0.35 for rows in residuals(drawn, PLAN).values())
        for s_id, a_id in drawn.rooms.items():
            at = se2.apply(np.array(drawn.T_a_s_by_room[s_id]), np.array(drawn.s_graph.room_by_id[s_id].centroid))
            room = PLAN.room_by_id[a_id]
            limit = 3.0 if noise == "mis_segmented" else 1e-9
            assert shapely.Polygon(room.polygon).distance(shapely.Point(at)) < limit


def doors(*pairs: tuple[int, int]) -> tuple[Door, ...]:
    return tuple(Door(f"d{i}{j}", (f"room{i}", f"room{j}"), (0.0, 0.0)) for i, j in pairs)


def test_explored_rooms_hang_together_by_doors() -> None:
    row = a_graph([box(4.1 * k, 0, 4, 4) for k in range(8)])
    row = dataclasses.replace(row, doors=doors((0, 5), (5, 2), (2, 7), (3, 4)))
    for seed in range(30):
        seen = set(draw(row, "real", rng(seed), 3).rooms.values())
        assert seen in ({"room0", "room5", "room2"}, {"room5", "room2", "room7"})
    apart = a_graph([box(0, 0, 4, 4), box(4.1, 0, 4, 4), box(0, 4.2, 4, 4), box(40, 0, 4, 4), box(4.5, 4.9, 4, 4)])
    assert len(draw(apart, "real", rng(0), 5).rooms) == 3  # where no door is known, across walls
    assert len(draw(apart, "real", rng(0)).rooms) == 5  # the whole floor


@pytest.mark.parametrize("noise", MAPPED)
def test_nothing_of_the_plan_is_in_the_map(noise: str) -> None:
    drawn = draw(PLAN, noise, rng(1), 6)
    far = moved(PLAN, 0.0, 3000.0, -500.0)
    also = draw(far, noise, rng(1), 6)
    for s, t in zip(drawn.s_graph.wall_surfaces, also.s_graph.wall_surfaces, strict=True):
        assert (s.id, s.room) == (t.id, t.room)
        assert np.allclose((*s.centroid, *s.normal, s.length), (*t.centroid, *t.normal, t.length), atol=1e-6)
        assert not s.source and s.height is None and s.plane is None
    assert all(r.polygon is None and not r.name for r in drawn.s_graph.rooms)
    assert np.allclose(np.subtract(also.T_a_s, drawn.T_a_s), (0, 3000, -500), atol=1e-4)
    assert drawn.rooms == also.rooms and drawn.wall_surfaces == also.wall_surfaces


@pytest.mark.parametrize("noise", NOISE_MODELS)
def test_maps_are_those_of_their_seed_and_plans_may_lack_lengths(noise: str) -> None:
    assert draw(PLAN, noise, rng(7), 5) == draw(PLAN, noise, rng(7), 5) != draw(PLAN, noise, rng(8), 5)
    plan = a_graph(offices([3.0] * 4, [3.0] * 4))
    walls = tuple(dataclasses.replace(w, length=None) for w in plan.wall_surfaces)
    rooms = tuple(dataclasses.replace(r, polygon=None) for r in plan.rooms)
    drawn = draw(dataclasses.replace(plan, wall_surfaces=walls, rooms=rooms), noise, rng(3), 5)
    lengths = {w.length for w in drawn.s_graph.wall_surfaces if w.id in drawn.wall_surfaces}
    assert len(drawn.wall_surfaces) > 8 and lengths == {None}


def test_one_floor_of_several_is_seen_and_impossible_requests_are_refused() -> None:
    tower = merged(PLAN, a_graph(flat(np.random.default_rng(4)), "upper", "upper"))
    assert {draw(tower, "real", rng(k), 3).floor for k in range(20)} == {"ground", "upper"}
    drawn = draw(tower, "drift", rng(0), 4, "upper")
    assert drawn.floor == "upper" and all(a.startswith("upper") for a in drawn.wall_surfaces.values())
    roomless = tuple(dataclasses.replace(w, room=None) for w in PLAN.wall_surfaces)
    bare = dataclasses.replace(PLAN, rooms=(), wall_surfaces=roomless)
    for graph, noise, count, floor, message in (
        (tower, "real", 4, "cellar", r"cellar.*ground, upper"),
        (PLAN, "real", 0, None, "one at least"),
        (PLAN, "reel", 3, None, "no noise model 'reel'.*paper, real"),
        (bare, "real", 3, None, "no room"),
    ):
        with pytest.raises(UserError, match=message):
            draw(graph, noise, rng(0), count, floor)
