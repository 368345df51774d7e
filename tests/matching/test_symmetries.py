"""Which maps of which buildings are ambiguous by themselves: where else a perfect map would fit."""

import dataclasses

import numpy as np
import pytest
from plans import a_graph, box, flat, merged, moved, offices

from data import Door, SceneGraph
from data.synthetic_maps.noise_models import perfect_map
from matching.ambiguity.symmetries import Symmetry, symmetries
from matching.engine.plan_walls import PlanWalls

PLAN = a_graph(flat(np.random.default_rng(3)), "ground")
ROW = a_graph(offices([3.0] * 6, [3.0] * 6))
FLAT = [box(0, 0, 5, 3), box(5.1, 0, 3, 5), box(0, 3.1, 2, 4)]
LEFT, RIGHT = a_graph(FLAT, "f"), a_graph(FLAT, "f", "right")


def found(a: SceneGraph, rooms: list[str]) -> list[Symmetry]:
    """The symmetries of a perfect map of these rooms."""
    plan = PlanWalls.of(a)
    assert plan is not None
    return symmetries(perfect_map(a, rooms).s_graph, plan)


def test_a_rectangular_room_alone_has_a_half_turn_as_symmetry() -> None:
    plan = a_graph([box(0, 0, 5, 3), box(5.1, 0, 4.2, 3.9)])
    (symmetry,) = found(plan, ["room0"])
    assert abs(abs(symmetry.T_a_s[0]) - np.pi) < 1e-6 and np.allclose(symmetry.T_a_s[1:], (5, 3), atol=1e-6)
    assert abs(symmetry.nats) < 1e-6 and not found(plan, ["room0", "room1"])


SHIFTED = a_graph([*FLAT[:2], box(40, 0, 5, 3), box(45.1, 0.3, 3, 5)])


@pytest.mark.parametrize(
    ("rooms", "plan", "symmetric"),
    [
        ([0, 1, 2], merged(LEFT, moved(RIGHT, 0, 30, 0, mirror=True)), False),
        ([0, 1, 2], merged(LEFT, moved(RIGHT, np.pi, 30, 0)), True),
        ([1, 2], ROW, True),
        ([*range(14)], a_graph([*offices([3.0] * 6, [3.0] * 6), box(19, -4, 6, 5.5)]), False),
        ([0, 1], SHIFTED, False),
    ],
    ids=["mirrored", "turned", "a row of offices", "with its odd end", "shifted"],
)
def test_what_a_motion_lays_elsewhere_is_a_symmetry(rooms: list[int], plan: SceneGraph, symmetric: bool) -> None:
    assert bool(found(plan, [f"room{n}" for n in rooms])) == symmetric


@pytest.mark.parametrize(("deeper", "expected"), [(0.0, True), (0.15, True), (0.6, False)])
def test_equal_offices_are_symmetries_as_far_as_noise_hides_their_difference(deeper: float, expected: bool) -> None:
    plan = a_graph([box(0, 0, 5, 3), box(20, 0, 5, 3 + deeper), box(40, 0, 8, 7)])
    elsewhere = [t for t in found(plan, ["room0"]) if 15 < np.hypot(*t.T_a_s[1:]) < 30]
    assert bool(elsewhere) == expected


def test_equal_storeys_are_symmetries_and_others_are_not() -> None:
    equal, other = (merged(PLAN, a_graph(flat(np.random.default_rng(k)), "upper", "upper")) for k in (3, 4))
    rooms = [r.id for r in PLAN.rooms[:6]]
    assert not found(other, rooms)
    (symmetry,) = found(equal, rooms)
    assert symmetry.floor == "upper" and symmetry.nats < 0.1 and np.allclose(symmetry.T_a_s, 0, atol=0.05)


@pytest.mark.parametrize("equal", [True, False])
def test_doors_that_stand_otherwise_make_equal_offices_no_symmetry(equal: bool) -> None:
    offsets = [-1.0] * 12 if equal else [-1.0, 1.0, -0.6, -1.0, -1.0, -1.0, *[1.2, 0.0] * 3]
    doors = tuple(
        Door(f"d{n}", (r.id, ROW.rooms[12].id), (r.centroid[0] + off, 5.06 if n < 6 else 7.18))
        for n, (r, off) in enumerate(zip(ROW.rooms[:12], offsets, strict=True))
    )
    plan, names = dataclasses.replace(ROW, doors=doors), ("room1", "room2")
    whole = perfect_map(plan, [*names, "room12"]).s_graph
    walls = tuple(w for w in whole.wall_surfaces if w.room in names)  # of the corridor no wall was seen
    seen = dataclasses.replace(whole, wall_surfaces=walls, doors=doors[1:3])
    arrays = PlanWalls.of(plan)
    assert arrays is not None and bool(symmetries(seen, arrays)) == equal
