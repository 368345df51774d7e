"""When the sensor leaves its floor, and when it arrives on one."""

from time import process_time

import numpy as np
import pytest

from sgslam.config import Config
from sgslam.mapping import Floors
from sgslam.tracking import FloorTransition
from sgslam.tracking.floor_transition import Arrival

HEIGHT = 1.4  # m, of the sensor above the ground


def follow(x: np.ndarray, ground: np.ndarray) -> tuple[list[bool], list[Arrival]]:
    """Whether the sensor is between two floors after each step, and the arrivals."""
    config = Config()
    transition, floors = FloorTransition(config.floors), Floors(config)
    between, arrivals, level = [], [], 0.0
    for place, z in zip(x, ground, strict=True):
        T = np.eye(4)
        T[0, 3], T[2, 3] = place, z - level + HEIGHT
        arrival = transition.follow(T, np.eye(4), HEIGHT, floors)
        if arrival is not None:
            transition.end(arrival)
            arrivals.append(arrival)
            level += arrival.height if arrival.floor is None else 0.0  # heights are above the new floor then
        between.append(bool(transition.active))
    return between, arrivals


@pytest.mark.parametrize("sway", [0.0, 0.15])
def test_a_raised_floor_is_no_climb(sway: float) -> None:
    x = np.arange(0.0, 12.0, 0.1)
    ground = np.where((x > 3) & (x < 8), 0.3, 0.0) + sway * np.sin(3 * x)
    between, arrivals = follow(x, ground)
    assert not any(between) and not arrivals


@pytest.mark.parametrize("rise", [2.6, -2.6])
def test_by_stairs_a_new_floor_is_reached(rise: float) -> None:
    x = np.arange(0.0, 14.0, 0.1)
    ground = np.sign(rise) * np.clip((x - 4) * 0.65, 0, abs(rise))
    between, arrivals = follow(x, ground)
    (arrival,) = arrivals
    assert arrival.floor is None and arrival.height == pytest.approx(rise, abs=0.05)
    assert not any(between[:45]) and all(between[55:75]) and not any(between[-20:])


def test_a_platform_belongs_to_its_floor() -> None:
    x = np.arange(0.0, 14.0, 0.1)
    between, arrivals = follow(x, np.clip((x - 4) * 0.5, 0, 0.9))
    (arrival,) = arrivals
    assert arrival.floor is not None and arrival.height == pytest.approx(0.9, abs=0.05)
    assert any(between) and not between[-1]


@pytest.mark.parametrize("climb", [0.0, 0.1])
def test_a_transition_that_does_not_end_costs_no_more_with_each_scan(climb: float) -> None:
    """Someone stays on a landing, or goes up a ramp for ever."""
    transition, floors, T, times = FloorTransition(Config().floors), Floors(Config()), np.eye(4), []
    for k in range(4000):
        T[0, 3], T[2, 3] = 0.3 * np.sin(k / 9) + climb * k, HEIGHT + 0.05 * np.sin(k / 7) + climb * k + bool(k)
        began = process_time()
        assert transition.follow(T, np.eye(4), HEIGHT, floors) is None and transition.active == bool(k)
        times.append(process_time() - began)
    assert np.median(times[-1000:]) < 3 * np.median(times[500:1500]) + 1e-4
