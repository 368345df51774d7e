"""Local drift: walls that are off like their neighbours are distinguished from walls that were built elsewhere."""

import numpy as np
import pytest

from sgslam.anchoring.local_drift import drifted_neighbourhoods, drifted_rooms
from sgslam.anchoring.se2_consensus import Pairs, find_consensus

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
