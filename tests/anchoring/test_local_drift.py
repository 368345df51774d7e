"""Local drift: walls that are off like their neighbours are distinguished from walls that were built elsewhere."""

import numpy as np
import pytest

from sgslam.anchoring.local_drift import drifted_neighbourhoods, drifted_rooms
from sgslam.anchoring.se2_consensus import Consensus, Pairs, find_consensus

ROOM = 4.0  # m
TURN = np.radians(4.0)


def rooms_in_a_row(count: int, off: np.ndarray) -> Pairs:
    """Square rooms along x, four walls each; `off` (count, 4) m by which each wall stands before its place."""
    inward = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    middle = np.arange(count)[:, None, None] * [ROOM, 0.0]
    planned = (middle - 0.5 * ROOM * inward).reshape(-1, 2)
    normal = np.tile(inward, (count, 1))
    seen = planned + normal * off.reshape(-1, 1)
    return Pairs(seen, normal, planned, normal, np.full(len(seen), ROOM), np.arange(len(seen)))


def shifted(by: tuple[float, float]) -> np.ndarray:
    """(4,) how far before their planned places the walls of a room stand that is moved by a vector."""
    return np.array([by[0], -by[0], by[1], -by[1]])


def drifted(pairs: Pairs, deviating: np.ndarray | None = None) -> np.ndarray:
    known = np.zeros((len(pairs.unit) // 4, 4), dtype=bool) if deviating is None else deviating
    overall = find_consensus(pairs, np.zeros(3), TURN)
    assert overall is not None and np.allclose(overall.T_plan_map, 0.0, atol=0.01)
    return drifted_neighbourhoods(pairs, overall, TURN, known.ravel()).reshape(-1, 4)


def test_rooms_that_drifted_together_are_found() -> None:
    off = np.zeros((12, 4))
    off[8:] = shifted((0.05, 0.15))
    across = drifted(rooms_in_a_row(12, off))[:, 2:]
    assert across[9:].all() and not across[:8].any()


def test_walls_that_were_built_elsewhere_have_not_drifted() -> None:
    rng = np.random.default_rng(1)
    off = np.zeros(48)
    off[rng.permutation(48)[:16]] = rng.uniform(0.1, 0.3, 16) * rng.choice([-1, 1], 16)
    assert not drifted(rooms_in_a_row(12, off.reshape(12, 4))).any()


@pytest.mark.parametrize("seed", [8, 9, 14])
def test_walls_that_agree_with_every_place_are_no_drift(seed: int) -> None:
    """Half of the walls were built elsewhere: two of one direction with equal offsets are no drift, though all walls of
    the other direction agree with the place that the two tell."""
    rng = np.random.default_rng(seed)
    off = np.zeros(48)
    off[rng.permutation(48)[:22]] = rng.uniform(0.1, 0.3, 22) * rng.choice([-1, 1], 22)
    assert not drifted(rooms_in_a_row(12, off.reshape(12, 4))).any()


def test_a_map_that_agrees_has_not_drifted() -> None:
    assert not drifted(rooms_in_a_row(5, np.zeros((5, 4)))).any()


def test_known_deviations_are_no_drift() -> None:
    """Not themselves, and not their neighbours either, for which too few are left that say so."""
    off, known = np.zeros((12, 4)), np.zeros((12, 4), dtype=bool)
    off[8:] = shifted((0.05, 0.15))
    known[8:, 2:] = True
    assert not drifted(rooms_in_a_row(12, off), known).any()


def moved_whole(off: np.ndarray, deviating: np.ndarray | None = None) -> np.ndarray:
    pairs = rooms_in_a_row(len(off), off)
    overall = find_consensus(pairs, np.zeros(3), TURN)
    assert overall is not None and np.allclose(overall.T_plan_map, 0.0, atol=0.01)
    known = np.zeros(len(pairs.unit), dtype=bool) if deviating is None else deviating.ravel()
    return drifted_rooms(pairs, overall, np.repeat(np.arange(len(off)), 4), known).reshape(-1, 4)


def test_a_room_after_a_wrong_step_has_drifted_as_a_whole() -> None:
    off = np.zeros((12, 4))
    off[5] = shifted((0.1, 0.0))
    found = moved_whole(off)
    assert found[5].tolist() == [True, True, False, False] and found.sum() == 2


@pytest.mark.parametrize("opposite", [0.0, -0.16, 0.1])
def test_a_moved_wall_is_no_drift_of_its_room(opposite: float) -> None:
    """The opposite one stands as planned, or otherwise than the room would have it; or has been pulled already."""
    off = np.zeros((12, 4))
    off[5, :2] = 0.1, opposite
    assert not moved_whole(off).any()
    off[5] = shifted((0.1, 0.0))
    assert not moved_whole(off, deviating=np.abs(off) > 0.05).any()


X, Y = (1.0, 0.0), (0.0, 1.0)
Wall = tuple[tuple[float, float], float, bool]  # normal, m before its planned place, whether it agrees with the map's


def walls_of(*walls: Wall, far: float = 0.0) -> tuple[Pairs, Consensus]:
    """Walls of 4 m at one place, the last `far` (m) away, and the map's place with a gate of 3 cm."""
    normal = np.array([n for n, _, _ in walls])
    planned = np.tile([1.0, 2.0], (len(walls), 1))
    seen = planned + normal * np.array([off for _, off, _ in walls])[:, None]
    away = np.zeros((len(walls), 2))
    away[-1] = far, 0.0
    pairs = Pairs(seen + away, normal, planned + away, normal, np.full(len(walls), 4.0), np.arange(len(walls)))
    return pairs, Consensus(np.zeros(3), np.array([agrees for _, _, agrees in walls]), 0.03, 0.8)


def drifted_among(*walls: Wall, far: float = 0.0) -> int:
    pairs, overall = walls_of(*walls, far=far)
    return int(drifted_neighbourhoods(pairs, overall, TURN, np.zeros(len(walls), dtype=bool)).sum())


OFF_X: Wall = (X, 0.1, False)
OFF_Y: Wall = (Y, 0.1, False)
ON_Y: Wall = (Y, 0.0, True)


@pytest.mark.parametrize(("walls", "found"), [([OFF_X, OFF_Y] * 2 + [OFF_X], 5), ([OFF_X, OFF_Y] * 2, 0)])
def test_five_walls_tell_drift(walls: list[Wall], found: int) -> None:
    assert drifted_among(*walls) == found


@pytest.mark.parametrize(("far", "found"), [(5.9, 5), (6.1, 0)])
def test_walls_within_six_metres_are_neighbours(far: float, found: int) -> None:
    assert drifted_among(*[OFF_Y, OFF_X] * 2, OFF_Y, far=far) == found


@pytest.mark.parametrize(("across", "found"), [(3, 3), (2, 0)])
def test_three_walls_across_the_shift_tell_it(across: int, found: int) -> None:
    along = [ON_Y, ON_Y] if across == 3 else [ON_Y, ON_Y, (Y, 0.0, False)]  # they agree with both places
    assert drifted_among(*[OFF_X] * across, *along) == found


@pytest.mark.parametrize(("agreeing", "found"), [(3, 3), (4, 0)])
def test_a_neighbourhood_of_which_more_than_half_agrees_with_the_map_has_not_drifted(agreeing: int, found: int) -> None:
    assert drifted_among(*[OFF_X] * 3, *[ON_Y] * agreeing) == found


@pytest.mark.parametrize(("others", "found"), [(2, 6), (3, 0)])
def test_seven_tenths_of_a_neighbourhood_must_agree_on_the_shift(others: int, found: int) -> None:
    elsewhere: list[Wall] = [(X, 0.5, False), (X, -0.5, False), (Y, -0.5, False)]
    assert drifted_among(*[OFF_X, OFF_Y] * 3, *elsewhere[:others]) == found


@pytest.mark.parametrize(("degrees", "found"), [(14.0, 0), (16.0, 2)])
def test_walls_within_15_degrees_are_across_the_step_into_a_room(degrees: float, found: int) -> None:
    slanted = float(np.cos(np.radians(degrees))), float(np.sin(np.radians(degrees)))
    pairs, overall = walls_of(OFF_X, ((-1.0, 0.0), -0.1, False), (slanted, 0.0, True))
    for room in (0, -1):
        none = np.zeros(3, dtype=bool)
        drifted_walls = drifted_rooms(pairs, overall, np.full(3, room), none)
        assert drifted_walls.sum() == (found if room == 0 else 0)
