"""Scans tracked against known walls and a known floor."""

import numpy as np
import pytest
from boxes import Array, pose, room, scan, scene_of
from scipy.spatial.transform import Rotation

from data.simulation import SpinningSensor
from sgslam.config import TrackingSettings
from sgslam.mapping import Lines
from sgslam.perception import sort_into_columns
from sgslam.tracking.alignment import Carried, Tracked, track

SETTINGS = TrackingSettings()
CARRIED = Carried(0.8, np.array([0.0, 0.0, 1.0]))
BANDS = (0.12, 2.55)
ROOM = (-3.0, -2.0, 4.0, 2.5)
CORRIDOR = (-40.0, -1.0, 40.0, 1.2)
NOBODY = Lines(np.empty(0, np.int64), np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0), np.empty(0, np.int64))


def lines_of(x0: float, y0: float, x1: float, y1: float) -> Lines:
    """The walls of a rectangular room as lines; a line's tangent is its normal turned to the left."""
    normal = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]], dtype=float)
    offset, low, high = np.array([-x0, x1, -y0, y1]), np.array([y0, -y1, -x1, x0]), np.array([y1, -y0, -x0, x1])
    return Lines(np.arange(4), normal, offset, low, high, np.full(4, 9))


def part_of(lines: Lines, chosen: list[int]) -> Lines:
    return Lines(
        lines.ids[chosen], lines.normal[chosen], lines.offset[chosen], lines.low[chosen], lines.high[chosen],
        lines.count[chosen],
    )  # fmt: skip


def off(T: Array, truth: Array) -> tuple[float, float]:
    """Metres and radians between two poses."""
    step = np.linalg.inv(truth) @ T
    angle = np.linalg.norm(Rotation.from_matrix(step[:3, :3]).as_rotvec())
    return float(np.linalg.norm(step[:3, 3])), float(angle)


def tracked(bounds: tuple[float, float, float, float], truth: Array, guess: Array, lines: Lines) -> Tracked:
    points = scan(scene_of(room(*bounds)), truth, SpinningSensor(max_range=30.0))
    return track(sort_into_columns(points, 900), lines, guess, CARRIED, BANDS, SETTINGS)


@pytest.mark.parametrize("direction", np.arange(0, 6.28, 0.9))
def test_a_guess_that_is_off_comes_back_in_a_few_scans(direction: float) -> None:
    """0.2 m and 3 degrees off: the first scan takes most of it away, the next ones the rest."""
    truth = pose(0.6, 0.3, 0.8, direction)
    sign = -1 if direction > 3 else 1
    T = pose(0.6 + 0.2 * np.cos(direction), 0.3 + 0.2 * np.sin(direction), 0.8, direction + sign * np.radians(3))
    metres, radians = off(tracked(ROOM, truth, T, lines_of(*ROOM)).T, truth)
    assert metres < 0.1 and radians < np.radians(1.0)
    for _ in range(5):
        result = tracked(ROOM, truth, T, lines_of(*ROOM))
        T = result.T
    metres, radians = off(T, truth)
    assert metres < 0.01 and radians < np.radians(0.1)
    assert result.share > 0.9


def test_a_leaning_guess_is_set_upright_by_the_floor() -> None:
    truth = pose(0.6, 0.3, 0.8, 1.0)
    T = pose(0.6, 0.3, 0.75, 1.0, np.radians(1.5), np.radians(-1.5))
    for _ in range(5):
        T = tracked(ROOM, truth, T, lines_of(*ROOM)).T
    metres, radians = off(T, truth)
    assert metres < 0.015 and radians < np.radians(0.15)


def test_along_a_bare_corridor_the_place_of_the_guess_is_kept() -> None:
    truth, guess = pose(0.0, 0.1, 0.8, 0.2), pose(0.15, 0.25, 0.8, 0.2 + np.radians(2))
    T = guess
    for _ in range(5):
        T = tracked(CORRIDOR, truth, T, lines_of(*CORRIDOR)).T
    assert T[0, 3] == pytest.approx(guess[0, 3], abs=0.01)  # no wall says where along
    assert T[1, 3] == pytest.approx(truth[1, 3], abs=0.01)
    assert np.arctan2(T[1, 0], T[0, 0]) == pytest.approx(0.2, abs=np.radians(0.1))


def test_without_walls_the_guess_is_the_answer() -> None:
    truth, guess = pose(0.6, 0.3), pose(0.7, 0.2, 0.8, 0.05)
    result = tracked(ROOM, truth, guess, NOBODY)
    np.testing.assert_array_equal(result.T, guess)
    assert result.share == 0.0


def test_walls_that_turn_away_or_lie_far_off_are_not_used() -> None:
    """Beyond their walls' back, and a hundred metres from them, a guess stands as it is."""
    truth, guess = pose(0.6, 0.3), pose(0.7, 0.2, 0.8, 0.05)
    backs = lines_of(*ROOM)
    backs = Lines(backs.ids, -backs.normal, -backs.offset, -backs.high, -backs.low, backs.count)
    for lines in (backs, lines_of(97.0, 98.0, 104.0, 102.5)):
        np.testing.assert_array_equal(tracked(ROOM, truth, guess, lines).T, guess)


@pytest.mark.parametrize("count", [1, 10])
def test_too_few_points_leave_the_guess(count: int) -> None:
    points = np.random.default_rng(0).uniform(-2, 2, (count, 3))
    guess = pose(0.7, 0.2)
    result = track(sort_into_columns(points, 900), lines_of(*ROOM), guess, CARRIED, BANDS, SETTINGS)
    np.testing.assert_array_equal(result.T, guess)


def test_unknown_walls_hardly_disturb() -> None:
    """Two of the four walls are known; what is seen of the others lies beside all lines, or beyond the gates."""
    truth, T = pose(0.6, 0.3, 0.8, 0.7), pose(0.7, 0.2, 0.8, 0.7)
    for _ in range(5):
        result = tracked(ROOM, truth, T, part_of(lines_of(*ROOM), [0, 2]))
        T = result.T
    metres, radians = off(T, truth)
    assert metres < 0.02 and radians < np.radians(0.2)
    assert 0.2 < result.share < 0.8


def test_the_given_pose_is_not_written_to() -> None:
    guess = pose(0.7, 0.2, 0.8, 0.05)
    before = guess.copy()
    tracked(ROOM, pose(0.6, 0.3), guess, lines_of(*ROOM))
    np.testing.assert_array_equal(guess, before)
