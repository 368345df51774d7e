"""When the sensor leaves its floor, and when it arrives on one."""

import numpy as np
import pytest
from boxes import Array, pose

from sgslam.config import Config
from sgslam.mapping import Floors, FloorTransition
from sgslam.mapping.floor_transition import Arrival

HEIGHT = 1.4  # m, of the sensor above the ground
X = np.arange(0.0, 14.0, 0.1)


def follow(ground: Array) -> tuple[list[bool], list[Arrival]]:
    """Whether the sensor is between two floors after each step along x, and the arrivals."""
    transition, floors = FloorTransition(Config().floors, HEIGHT), Floors(Config())
    between, arrivals, level = [], [], 0.0
    for x, z in zip(X, ground, strict=True):
        arrival = transition.follow(pose(x, 0, z - level + HEIGHT), np.eye(4), floors)
        if arrival is not None:
            arrivals.append(arrival)
            level += arrival.height if arrival.floor is None else 0.0  # heights are above the new floor then
        between.append(bool(transition.active))
    return between, arrivals


@pytest.mark.parametrize("sway", [0.0, 0.15])
def test_a_raised_floor_is_no_climb(sway: float) -> None:
    between, arrivals = follow(np.where((X > 3) & (X < 8), 0.3, 0.0) + sway * np.sin(3 * X))
    assert not any(between) and not arrivals


@pytest.mark.parametrize(("rise", "slope", "is_new"), [(2.6, 0.65, True), (-2.6, -0.65, True), (0.9, 0.5, False)])
def test_stairs_reach_a_new_floor_and_a_platform_none(rise: float, slope: float, is_new: bool) -> None:
    between, (arrival,) = follow(np.sign(rise) * np.clip((X - 4) * abs(slope), 0, abs(rise)))
    assert (arrival.floor is None) == is_new and arrival.height == pytest.approx(rise, abs=0.05)
    assert not any(between[:45]) and any(between) and not between[-1]
    assert not is_new or (all(between[55:75]) and not any(between[-20:]))
