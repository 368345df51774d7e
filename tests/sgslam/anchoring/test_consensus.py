"""The place that most walls agree on, while many of them disagree."""

from dataclasses import fields, replace

import numpy as np
import pytest
from boxes import Array
from numpy.typing import NDArray

from data import WallSurface
from data.scene_graph.segments import Segments, straight_walls
from sgslam.anchoring.se2_consensus import Pairs, determined, find_consensus
from sgslam.anchoring.wall_alignment import associate_walls


def rotation(yaw: float) -> Array:
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


def storey(seed: int, rooms: int = 5, moved: float = 0.0, noise: float = 0.005) -> tuple[Pairs, Array, Array]:
    """Rooms in a row: seen walls placed by `true` (3,), planned ones in the plan; and each wall's shift.

    The two sides of a partition are one unit and move together, as the long walls of all rooms do.
    """
    rng, true = np.random.default_rng(seed), np.array([0.4, 12.0, -7.0])
    sides = [
        [0.0, 2.5, 1.0, 0.0, 5.0],
        [3.8, 2.5, -1.0, 0.0, 5.0],
        [1.9, 0.0, 0.0, 1.0, 3.8],
        [1.9, 5.0, 0.0, -1.0, 3.8],
    ]
    walls = np.tile(sides, (rooms, 1))  # centre, normal, length
    walls[:, 0] += np.repeat(4.0 * np.arange(rooms), 4)
    unit = np.array([number for k in range(rooms) for number in (k, k + 1, 20 + k, 40 + k)])
    planned, normal, units = walls[:, :2], walls[:, 2:4], np.unique(unit)
    chosen = rng.permutation(units)[: round(moved * len(units))]
    step = {u: rng.uniform(0.1, 0.3) * rng.choice([-1, 1]) for u in chosen.tolist()}
    shift = np.array([step.get(u, 0.0) * n.sum() for u, n in zip(unit.tolist(), normal, strict=True)])
    built = planned + (shift + rng.normal(0, noise, len(walls)))[:, None] * normal
    # planned walls stay in the frame in which they are rows of rooms, so the map is the one that is turned
    R = rotation(true[0])
    return Pairs((built - true[1:]) @ R, normal @ R, planned, normal, walls[:, 4], unit), true, shift


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("moved", [0.0, 0.35])
def test_a_third_of_the_walls_moved_does_not_move_the_place(seed: int, moved: float) -> None:
    """And a plan and a rough place that are moved alike give a place that is moved alike."""
    pairs, true, shift = storey(seed, moved=moved)
    start = true + np.array([0.01, 0.25, -0.2])
    found = find_consensus(pairs, start)
    assert found is not None
    np.testing.assert_allclose(pairs.offsets(found.T_plan_map), shift, atol=0.03)
    np.testing.assert_array_equal(found.agree, np.abs(shift) < 0.05)
    assert found.share == pytest.approx(1.0) if not moved else 0.4 < found.share < 0.9
    yaw, t = -2.1, np.array([300.0, -40.0])
    R = rotation(yaw)
    turned = replace(pairs, planned=pairs.planned @ R.T + t, planned_normal=pairs.planned_normal @ R.T)
    other = find_consensus(turned, np.array([start[0] + yaw, *(R @ start[1:] + t)]))
    assert other is not None
    expected = [found.T_plan_map[0] + yaw, *(R @ found.T_plan_map[1:] + t)]
    np.testing.assert_allclose(other.T_plan_map, expected, atol=1e-6)
    np.testing.assert_array_equal(found.agree, other.agree)


@pytest.mark.parametrize(
    ("noise", "off", "agrees"), [(0.0, 0.024, True), (0.0, 0.027, False), (0.04, 0.045, True), (0.04, 0.095, False)]
)
def test_the_gate_follows_the_scatter_of_the_walls(noise: float, off: float, agrees: bool) -> None:
    pairs, true, _ = storey(6, rooms=8, noise=0.0)
    scatter = np.random.default_rng(0).normal(0.0, noise, len(pairs.seen))
    scatter[2] = off
    found = find_consensus(replace(pairs, seen=pairs.seen + scatter[:, None] * pairs.seen_normal), true)
    assert found is not None and found.agree[2] == agrees


def only(pairs: Pairs, which: NDArray[np.int64]) -> Pairs:
    return Pairs(*(getattr(pairs, field.name)[which] for field in fields(Pairs)))


def test_many_pieces_of_one_moved_wall_have_one_vote() -> None:
    pairs, true, _ = storey(3)
    own = only(pairs, np.full(30, 2))
    pieces = replace(own, planned=own.planned + np.array([0.0, 0.2]), length=np.ones(30), unit=np.full(30, 99))
    both = Pairs(*(np.concatenate([getattr(p, f.name) for p in (pairs, pieces)]) for f in fields(Pairs)))
    found = find_consensus(both, true)
    assert found is not None
    np.testing.assert_allclose(found.T_plan_map, true, atol=0.01)
    assert not found.agree[-30:].any()


def test_a_vote_grows_with_the_root_of_a_walls_length_up_to_six_metres() -> None:
    four = only(storey(0, rooms=1)[0], np.arange(4))
    votes = replace(four, length=np.array([1.5, 1.5, 12.0, 4.0]), unit=np.array([0, 0, 1, 2])).votes()
    np.testing.assert_allclose(votes, [np.sqrt(3) / 2, np.sqrt(3) / 2, np.sqrt(6), 2.0])


@pytest.mark.parametrize(
    ("walls", "is_found"),
    [
        ([1, 2], False),  # three walls of the building must agree
        ([1, 2, 3], True),
        ([0, 1, 4, 5, 8, 9], False),  # of one direction
    ],
)
def test_walls_fix_a_place_that_are_three_and_of_two_directions(walls: list[int], is_found: bool) -> None:
    pairs, true, _ = storey(0)
    assert (find_consensus(only(pairs, np.array(walls)), true) is not None) == is_found


@pytest.mark.parametrize(("degrees", "is_determined"), [(None, False), (41.0, False), (42.0, True), (90.0, True)])
def test_a_place_is_determined_by_walls_that_are_not_nearly_parallel(
    degrees: float | None, is_determined: bool
) -> None:
    normals = [[1.0, 0.0]] if degrees is None else [[1.0, 0.0], rotation(np.radians(degrees))[:, 0]]
    assert determined(np.array(normals)) == is_determined


def test_the_legs_of_a_wall_that_goes_round_corners_are_units_of_their_own() -> None:
    sides = [((0.0, 2.0), (1.0, 0.0)), ((2.0, 0.0), (0.0, 1.0)), ((4.0, 2.0), (-1.0, 0.0)), ((4.2, 2.0), (1.0, 0.0))]
    planned = [WallSurface(str(k), None, c, n, 4.0, source="wall") for k, (c, n) in enumerate(sides)]
    numbers, senses = straight_walls(planned)
    assert numbers.tolist() == [0, 1, 2, 2] and senses.tolist() == [1, 1, 1, -1]


def test_walls_that_agree_on_nothing_give_no_place() -> None:
    pairs, true, _ = storey(0)
    off = np.random.default_rng(0).uniform(-0.5, 0.5, len(pairs.seen))[:, None] * pairs.seen_normal
    found = find_consensus(replace(pairs, seen=pairs.seen + off, unit=np.arange(len(off))), true)
    assert found is None or found.share < 0.5


def associated(seen: WallSurface, *planned: WallSurface) -> list[int]:
    walls, sides = (Segments.of(surfaces) for surfaces in ([seen], planned))
    return associate_walls(walls, sides, 0.4).tolist()


def test_a_long_wall_is_not_the_stub_that_it_has_come_near_to() -> None:
    stub, long = (WallSurface(f"{y}", None, (x, y), (0.0, 1.0), n) for x, y, n in ((0.0, 0.0, 0.3), (0.5, -0.25, 3.0)))
    places = (-0.9, 0.001), (0.0, 0.0)  # the first is nearer
    short, pieces = ([replace(stub, centroid=place, length=n) for place in places] for n in (0.3, 0.5))
    for y, planned, expected in (
        (0.04, [stub, long], 1), (0.04, [stub], -1), (0.01, [stub], 0), (0.04, [*short, long], 2),
        (0.04, [*pieces, long], 0),  # both pieces together explain it
    ):  # fmt: skip
        assert associated(WallSurface("seen", None, (0.0, y), (0.0, 1.0), 2.5), *planned) == [expected]


@pytest.mark.parametrize(("degrees", "off", "along", "is_found"), [
    (5.5, 0.0, 0.0, True), (6.0, 0.0, 0.0, False), (180.0, 0.0, 0.0, False), (0.0, 0.39, 0.0, True),
    (0.0, -0.39, 0.0, True), (0.0, 0.41, 0.0, False), (0.0, 0.0, 1.39, True), (0.0, 0.0, 1.41, False),
])  # fmt: skip
def test_a_wall_stands_at_a_planned_one_that_faces_the_same_way_near_it_and_overlaps_it(
    degrees: float, off: float, along: float, is_found: bool
) -> None:
    nx, ny = rotation(np.radians(degrees))[:, 0].tolist()
    planned = WallSurface("planned", None, (0.0, 0.0), (1.0, 0.0), 2.0)
    seen = WallSurface("seen", None, (off, along), (nx, ny), 2.0)
    assert associated(seen, planned) == [0 if is_found else -1]
