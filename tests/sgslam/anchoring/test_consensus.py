"""The place that most walls agree on, while many of them disagree."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import Array

from data import WallSurface
from sgslam.anchoring.se2_consensus import Pairs, determined, find_consensus
from sgslam.anchoring.wall_alignment import _pairs
from sgslam.anchoring.wall_association import WallArrays

TURNED = 0.07


def storey(seed: int, rooms: int = 5, moved: float = 0.0, noise: float = 0.005) -> tuple[Pairs, Array, Array]:
    """Rooms in a row: seen walls placed by `true` (3,), planned ones in the plan; and each wall's shift.

    The two sides of a partition are one unit and move together, as the long walls of all rooms do.
    """
    rng = np.random.default_rng(seed)
    walls: list[tuple[Array, Array, float, int]] = []
    for k in range(rooms):
        x0, x1 = 4.0 * k, 4.0 * k + 3.8
        walls += [(np.array([x0, 2.5]), np.array([1.0, 0.0]), 5.0, k), (np.array([x1, 2.5]), np.array([-1.0, 0.0]), 5.0,
                  k + 1)]  # fmt: skip
        for y, n, unit in ((0.0, 1.0, 20 + k), (5.0, -1.0, 40 + k)):
            walls.append((np.array([(x0 + x1) / 2, y]), np.array([0.0, n]), 3.8, unit))
    units = np.unique([w[3] for w in walls])
    chosen = rng.permutation(units)[: round(moved * len(units))]
    step = {u: rng.uniform(0.1, 0.3) * rng.choice([-1, 1]) * np.ones(2) for u in chosen}
    true = np.array([0.4, 12.0, -7.0])
    R = np.array([[np.cos(true[0]), -np.sin(true[0])], [np.sin(true[0]), np.cos(true[0])]])
    planned, normal = np.array([w[0] for w in walls]), np.array([w[1] for w in walls])
    unit = np.array([w[3] for w in walls])
    shift = np.array([step.get(u, np.zeros(2)) @ n for u, n in zip(unit.tolist(), normal, strict=True)])
    built = planned + (shift + rng.normal(0, noise, len(walls)))[:, None] * normal
    # planned walls stay in the frame in which they are rows of rooms, so the map is the one that is turned
    seen = (built - true[1:]) @ R
    return Pairs(seen, normal @ R, planned, normal, np.array([w[2] for w in walls]), unit), true, shift


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("moved", [0.0, 0.35])
def test_a_third_of_the_walls_moved_does_not_move_the_place(seed: int, moved: float) -> None:
    pairs, true, shift = storey(seed, moved=moved)
    start = true + np.array([0.01, 0.25, -0.2])
    found = find_consensus(pairs, start, TURNED)
    assert found is not None
    np.testing.assert_allclose(pairs.offsets(found.T_plan_map), shift, atol=0.03)
    np.testing.assert_array_equal(found.agree, np.abs(shift) < 0.05)
    assert found.share == pytest.approx(1.0) if not moved else 0.4 < found.share < 0.9


@pytest.mark.parametrize(("degrees", "agrees"), [(5.5, True), (6.5, False)])
def test_a_wall_that_is_turned_has_no_vote(degrees: float, agrees: bool) -> None:
    pairs, true, _ = storey(4)
    turn = np.radians(degrees)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    normals = pairs.seen_normal.copy()
    normals[0] = R @ normals[0]
    found = find_consensus(replace(pairs, seen_normal=normals), true, max_turn=0.2)
    assert found is not None and found.agree[0] == agrees and found.agree[1:].all()


@pytest.mark.parametrize(("noise", "off", "agrees"), [
    (0.0, 0.024, True), (0.0, 0.027, False), (0.04, 0.045, True), (0.04, 0.095, False),
])  # fmt: skip
def test_the_gate_follows_the_scatter_of_the_walls(noise: float, off: float, agrees: bool) -> None:
    pairs, true, _ = storey(6, rooms=8, noise=0.0)
    rng, seen = np.random.default_rng(0), pairs.seen.copy()
    seen += rng.normal(0.0, noise, len(seen))[:, None] * pairs.seen_normal
    seen[2] = pairs.seen[2] + off * pairs.seen_normal[2]
    found = find_consensus(replace(pairs, seen=seen), true, TURNED)
    assert found is not None and found.agree[2] == agrees


def test_many_pieces_of_one_moved_wall_have_one_vote() -> None:
    pairs, true, _ = storey(3)
    pieces = 30
    long = Pairs(
        np.concatenate([pairs.seen, np.tile(pairs.seen[2], (pieces, 1))]),
        np.concatenate([pairs.seen_normal, np.tile(pairs.seen_normal[2], (pieces, 1))]),
        np.concatenate([pairs.planned, np.tile(pairs.planned[2] + [0.0, 0.2], (pieces, 1))]),
        np.concatenate([pairs.planned_normal, np.tile(pairs.planned_normal[2], (pieces, 1))]),
        np.concatenate([pairs.length, np.full(pieces, 1.0)]),
        np.concatenate([pairs.unit, np.full(pieces, 99)]),
    )
    found = find_consensus(long, true, TURNED)
    assert found is not None
    np.testing.assert_allclose(found.T_plan_map, true, atol=0.01)
    assert not found.agree[-pieces:].any()


def test_the_answer_goes_with_the_plan() -> None:
    """A plan and a rough place that are moved alike give a place that is moved alike."""
    pairs, true, _ = storey(1, moved=0.3)
    yaw, t = -2.1, np.array([300.0, -40.0])
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    turned = Pairs(pairs.seen, pairs.seen_normal, pairs.planned @ R.T + t, pairs.planned_normal @ R.T, pairs.length,
                   pairs.unit)  # fmt: skip
    start = true + np.array([0.02, 0.1, 0.1])
    one = find_consensus(pairs, start, TURNED)
    other = find_consensus(turned, np.array([start[0] + yaw, *(R @ start[1:] + t)]), TURNED)
    assert one is not None and other is not None
    place = one.T_plan_map
    np.testing.assert_allclose(other.T_plan_map, [place[0] + yaw, *(R @ place[1:] + t)], atol=1e-6)
    np.testing.assert_array_equal(one.agree, other.agree)


def test_walls_of_one_direction_leave_the_place_open() -> None:
    pairs, true, _ = storey(0)
    along = np.abs(pairs.planned_normal[:, 0]) > 0.5
    parallel = Pairs(*(getattr(pairs, name)[along] for name in
                       ("seen", "seen_normal", "planned", "planned_normal", "length", "unit")))  # fmt: skip
    assert find_consensus(parallel, true, TURNED) is None


@pytest.mark.parametrize(("degrees", "is_determined"), [(41.0, False), (42.0, True), (90.0, True)])
def test_walls_fix_a_place_that_are_not_nearly_parallel(degrees: float, is_determined: bool) -> None:
    angle = np.radians(degrees)
    assert determined(np.array([[1.0, 0.0], [np.cos(angle), np.sin(angle)]])) == is_determined


def test_the_legs_of_a_wall_that_goes_round_corners_are_units_of_their_own() -> None:
    sides = [((0.0, 2.0), (1.0, 0.0)), ((2.0, 0.0), (0.0, 1.0)), ((4.0, 2.0), (-1.0, 0.0)), ((4.2, 2.0), (1.0, 0.0))]
    planned = [WallSurface(str(k), None, c, n, 4.0, source="wall") for k, (c, n) in enumerate(sides)]
    arrays, every = WallArrays.of(planned, {}, np.zeros(2)), np.arange(4)
    assert _pairs(arrays, arrays, every, every, planned).unit.tolist() == [0, 1, 2, 2]


@pytest.mark.parametrize(("units", "is_found"), [(2, False), (3, True)])
def test_three_walls_of_the_building_must_agree(units: int, is_found: bool) -> None:
    pairs, true, _ = storey(0)
    few = pairs.only(np.arange(units + 1)[-units:])  # one of each direction at least
    assert (find_consensus(few, true, TURNED) is not None) == is_found


def test_one_wall_does_not_fix_a_place() -> None:
    assert not determined(np.array([[1.0, 0.0]]))


def test_a_vote_grows_with_the_root_of_a_walls_length_up_to_six_metres() -> None:
    pairs, _, _ = storey(0, rooms=1)
    four = pairs.only(np.arange(4))
    lengths = np.array([1.5, 1.5, 12.0, 4.0])
    votes = replace(four, length=lengths, unit=np.array([0, 0, 1, 2])).votes()
    np.testing.assert_allclose(votes, [np.sqrt(3) / 2, np.sqrt(3) / 2, np.sqrt(6), 2.0])


def test_walls_that_agree_on_nothing_give_no_place() -> None:
    pairs, true, _ = storey(0)
    rng = np.random.default_rng(0)
    off = rng.uniform(-0.5, 0.5, len(pairs.seen))[:, None] * pairs.seen_normal
    scattered = Pairs(pairs.seen + off, pairs.seen_normal, pairs.planned, pairs.planned_normal, pairs.length,
                      np.arange(len(pairs.seen)))  # fmt: skip
    found = find_consensus(scattered, true, TURNED)
    assert found is None or found.share < 0.5
