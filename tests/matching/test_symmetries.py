"""Which maps of which buildings are ambiguous by themselves, and what the true motions leave to be assigned."""

import dataclasses

import numpy as np
import pytest
from plans import a_graph, box, flat, merged, moved, offices

from data import Door, SceneGraph
from data.geometry import se2
from data.synthetic_maps.noise_models import DrawnGraph, draw
from evaluation.matching_benchmark.oracle import oracle_match
from evaluation.metrics.matches import matching_scores, unique_is_wrong
from evaluation.metrics.true_matches import TrueMatches
from matching import MatchResult
from matching.ambiguity.symmetries import symmetries

PLAN = a_graph(flat(np.random.default_rng(3)), "ground")


def seen(a: SceneGraph, rooms: list[str], deformed: bool = False) -> DrawnGraph:
    """A perfect map of these rooms, in the A-graph's own frame."""
    part = SceneGraph(
        "map", tuple(r for r in a.rooms if r.id in rooms), tuple(w for w in a.wall_surfaces if w.room in rooms)
    )
    own = {r.id: r.id for r in part.rooms}
    floor = part.rooms[0].floor
    still = (0.0, 0.0, 0.0)
    walls = {w.id: w.id for w in part.wall_surfaces}
    return DrawnGraph(part, own, walls, still, dict.fromkeys(own, still), floor, deformed)


def test_a_rectangular_room_alone_has_a_half_turn_as_symmetry() -> None:
    plan = a_graph([box(0, 0, 5, 3), box(5.1, 0, 4.2, 3.9)])
    (symmetry,) = symmetries(seen(plan, ["room0"]), plan)
    assert abs(abs(symmetry.T_a_s[0]) - np.pi) < 1e-6 and np.allclose(symmetry.T_a_s[1:], (5, 3), atol=1e-6)
    assert abs(symmetry.nats) < 1e-6
    assert not symmetries(seen(plan, ["room0", "room1"]), plan)


def test_a_mirrored_flat_is_a_symmetry_only_if_a_motion_reaches_it() -> None:
    rooms = [box(0, 0, 5, 3), box(5.1, 0, 3, 5), box(0, 3.1, 2, 4)]
    left, right = a_graph(rooms, "f"), a_graph(rooms, "f", "right")
    mirrored = merged(left, moved(right, 0, 30, 0, mirror=True))
    turned = merged(left, moved(right, np.pi, 30, 0))
    drawn = seen(left, ["room0", "room1", "room2"])
    assert not symmetries(drawn, mirrored)
    (symmetry,) = symmetries(drawn, turned)
    assert np.allclose(np.abs(symmetry.T_a_s), (np.pi, 30, 0), atol=1e-6)


@pytest.mark.parametrize(("deeper", "expected"), [(0.0, True), (0.15, True), (0.6, False)])
def test_equal_offices_are_symmetries_as_far_as_noise_hides_their_difference(deeper: float, expected: bool) -> None:
    plan = a_graph([box(0, 0, 5, 3), box(20, 0, 5, 3 + deeper), box(40, 0, 8, 7)])
    elsewhere = [t for t in symmetries(seen(plan, ["room0"]), plan) if 15 < np.hypot(*t.T_a_s[1:]) < 30]
    assert bool(elsewhere) == expected


def test_a_row_of_offices_hides_where_one_is_until_its_end_is_seen() -> None:
    row = a_graph([*offices([3.0] * 6, [3.0] * 6), box(19, -4, 6, 5.5)])
    assert symmetries(seen(row, ["room1", "room2"]), row)
    assert not symmetries(seen(row, [r.id for r in row.rooms]), row)  # the odd room breaks the symmetry


def test_equal_storeys_are_symmetries_and_others_are_not() -> None:
    equal = merged(PLAN, a_graph(flat(np.random.default_rng(3)), "upper", "upper"))
    other = merged(PLAN, a_graph(flat(np.random.default_rng(4)), "upper", "upper"))
    for seed in range(3):
        drawn = draw(PLAN, "drift", np.random.default_rng(seed), 6)
        assert not symmetries(drawn, other)
        (symmetry,) = symmetries(drawn, equal)
        assert symmetry.floor == "upper" and symmetry.nats < 0.1
        assert np.allclose(symmetry.T_a_s, drawn.T_a_s, atol=0.05)


def test_what_the_map_did_not_see_decides_too() -> None:
    """Three walls of an office fit into a corner of a hall; that the hall's others are missing speaks against it."""
    plan = a_graph([box(0, 0, 5, 3), [(20, 0), (25, 0), (25, 3), (31, 3), (31, 9), (29, 9), (29, 6), (20, 6)]])
    drawn = seen(plan, ["room0"])
    assert all(abs(abs(t.T_a_s[0]) - np.pi) < 0.1 and np.hypot(*t.T_a_s[1:]) < 10 for t in symmetries(drawn, plan))


def test_a_wall_seen_short_of_its_end_fits_where_one_ends_elsewhere() -> None:
    """The rooms differ in their depth only; the back wall was not seen, nor the ends of the side walls."""
    plan = a_graph([box(0, 0, 3, 9), box(20, 0, 3, 12)])
    whole = seen(plan, ["room0"])
    assert not any(np.hypot(*t.T_a_s[1:]) > 15 for t in symmetries(whole, plan))
    front = [w for w in plan.surfaces_of_room["room0"] if w.normal[1] > -0.5]
    half = [
        dataclasses.replace(w, length=4.0, centroid=(w.centroid[0], 2.0)) if w.length == 9 else w for w in front
    ]  # fmt: skip
    short = dataclasses.replace(
        whole, s_graph=dataclasses.replace(whole.s_graph, wall_surfaces=tuple(half)),
        wall_surfaces={w.id: w.id for w in half},
    )  # fmt: skip
    assert sorted(np.round(t.T_a_s[1:], 3).tolist() for t in symmetries(short, plan)) == [[3, 9], [20, 0], [23, 12]]


def test_a_deformed_map_may_lie_where_a_rigid_one_cannot() -> None:
    """The two rows differ by 0.3 m in how far their rooms are shifted against each other."""
    rooms = [box(0, 0, 5, 3), box(5.1, 1.0, 4, 6), box(40, 0, 5, 3), box(45.1, 1.3, 4, 6)]
    plan = a_graph(rooms)
    assert not symmetries(seen(plan, ["room0", "room1"]), plan)
    assert symmetries(seen(plan, ["room0", "room1"], deformed=True), plan)


def test_the_frames_do_not_matter() -> None:
    row = a_graph(offices([3.0] * 5, [3.0, 3.0, 3.6, 3.0, 3.0]))
    T = np.array([1.1, 5000.0, -80.0])
    away = moved(row, *T)
    for seed in range(4):
        drawn = draw(row, "real", np.random.default_rng(seed), 2)
        motions = {r: tuple(se2.compose(T, np.array(m)).tolist()) for r, m in drawn.T_a_s_by_room.items()}
        there = dataclasses.replace(drawn, T_a_s=next(iter(motions.values())), T_a_s_by_room=motions)
        here, far = symmetries(drawn, row), symmetries(there, away)
        assert [t.nats for t in far] == pytest.approx([t.nats for t in here], abs=1e-3)


def judged(result: MatchResult, drawn: DrawnGraph) -> tuple[float, float, bool]:
    x, y = drawn.s_graph.centroid().tolist()
    truth = TrueMatches(drawn.rooms, drawn.wall_surfaces, drawn.T_a_s, drawn.floor, (x, y))
    scores = matching_scores(result, truth, drawn.s_graph)
    return scores.rooms.f1 or 0.0, scores.wall_surfaces.f1 or 0.0, unique_is_wrong(result, truth, drawn.deformed)


@pytest.mark.parametrize("noise", ["real", "drift", "mis_segmented"])
def test_the_oracle_is_nearly_right_also_where_the_building_repeats_itself(noise: str) -> None:
    row = a_graph(offices([3.0] * 6, [3.0] * 6), "f")
    walls = []
    for plan in (PLAN, row):
        for seed in range(6):
            drawn = draw(plan, noise, np.random.default_rng(seed), 6)
            rooms, found, wrong = judged(oracle_match(drawn, plan), drawn)
            assert rooms > 0.8 and not (wrong and rooms == 1.0)
            walls.append(found)
    assert np.mean(walls) > 0.94


def test_doors_that_stand_otherwise_make_equal_offices_no_symmetry() -> None:
    row = a_graph(offices([3.0] * 6, [3.0] * 6))
    corridor = row.rooms[12]

    def doors(offsets: list[float]) -> tuple[Door, ...]:
        return tuple(
            Door(f"d{n}", (r.id, corridor.id), (r.centroid[0] + off, 5.06 if n < 6 else 7.18))
            for n, (r, off) in enumerate(zip(row.rooms[:12], offsets, strict=True))
        )

    def of_two(plan: SceneGraph) -> DrawnGraph:
        """Two offices and what of the corridor lies before them."""
        names = ("room1", "room2")
        whole = seen(plan, [*names, corridor.id])
        walls = tuple(w for w in whole.s_graph.wall_surfaces if w.room in names)
        own = {w.id: w.id for w in walls}
        shown = tuple(d for d in plan.doors if d.rooms[0] in names)
        s_graph = dataclasses.replace(whole.s_graph, wall_surfaces=walls, doors=shown)
        return dataclasses.replace(whole, s_graph=s_graph, wall_surfaces=own)

    alike = dataclasses.replace(row, doors=doors([-1.0] * 12))
    otherwise = dataclasses.replace(row, doors=doors([-1.0, 1.0, -0.6, -1.0, -1.0, -1.0, *[1.2, 0.0] * 3]))
    assert symmetries(of_two(row), row) and symmetries(of_two(alike), alike)
    assert not symmetries(of_two(otherwise), otherwise)


def test_no_clutter_is_as_long_as_a_corridor() -> None:
    """Two equal offices, and one wall of the corridor from end to end: that tells which two, but for half a turn."""
    row = a_graph(offices([3.0] * 6, [3.0] * 6))
    corridor = max((w for w in row.surfaces_of_room["room12"]), key=lambda w: w.length or 0.0)

    def moved_along(length: float) -> list[float]:
        """Evidence over the places along the row, of a map of the two and of so much of the corridor's wall."""
        two = seen(row, ["room1", "room2"])
        part = dataclasses.replace(corridor, length=length, room=None)
        graph = dataclasses.replace(two.s_graph, wall_surfaces=(*two.s_graph.wall_surfaces, part))
        drawn = dataclasses.replace(two, s_graph=graph, wall_surfaces={**two.wall_surfaces, corridor.id: corridor.id})
        return [t.nats for t in symmetries(drawn, row) if abs(t.T_a_s[0]) < 1]

    assert corridor.length is not None
    assert moved_along(corridor.length / 2) == pytest.approx([0.0, 0.0]) and not moved_along(corridor.length)


def test_doors_within_a_room_that_was_merged_are_not_missed() -> None:
    """Half a turn lays the corridor and two offices on each other; only at home do the offices have doors."""
    row = a_graph(offices([3.0] * 6, [3.0] * 6))
    doors = tuple(Door(f"d{n}", (f"room{n}", "room12"), (row.rooms[n].centroid[0], 5.06)) for n in (1, 2))
    plan = dataclasses.replace(row, doors=doors)
    apart = seen(plan, ["room1", "room2", "room12"])
    merged_ = dataclasses.replace(apart, rooms={"room12": "room12"})
    without = seen(row, ["room1", "room2", "room12"])
    least = [min(t.nats for t in symmetries(d, p)) for d, p in ((apart, plan), (merged_, plan), (without, row))]
    assert least[0] < least[1] - 4 and least[1] == pytest.approx(least[2], abs=1e-6)
