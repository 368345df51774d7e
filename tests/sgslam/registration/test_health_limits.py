"""The limits of a scan's health from both sides; what is just at a limit is within it."""

from typing import Any

import numpy as np
import pytest
from boxes import Array

from sgslam.config import TrackingSettings
from sgslam.registration.health import innovation, judged
from sgslam.registration.window import Solved

SURE = 1e-6 * np.eye(6)


def solved(found: int = 1000, close: int = 1000, off: float = 0.0, turned: float = 0.0) -> Solved:
    """A window whose last knot is so many metres and radians off the predicted one; 3 mm and mrad are its sigma."""
    predicted = np.tile(np.eye(4), (2, 1, 1))
    knots = predicted.copy()
    knots[-1, 0, 3] = off
    knots[-1, :2, :2] = [[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]
    information = 1e6 * np.eye(12)
    return Solved(np.array([0.0, 0.1]), knots, predicted, information, 0.9 * information, 1000, found, close, 0.01)


def health(window: Solved, relative: float = 1.0, was_lost: bool = False, **settings: Any) -> str:
    return judged(window, SURE, relative, was_lost, TrackingSettings(**settings))[0]


@pytest.mark.parametrize(
    ("found", "close", "relative", "was_lost", "expected"),
    [
        (1000, 700, 1.0, False, "good"), (1000, 699, 1.0, False, "lost"),  # the points contradict surfaces
        (450, 440, 0.4, False, "good"), (450, 440, 0.399, False, "lost"),  # much less that is known than before
        (450, 440, 0.85, True, "good"), (450, 440, 0.849, True, "lost"),  # found again only where it fits as usual
        (1000, 699, 0.3, False, "lost"),
    ],
)  # fmt: skip
def test_a_scan_is_lost_where_its_surfaces_or_the_map_say_otherwise(
    found: int, close: int, relative: float, was_lost: bool, expected: str
) -> None:
    assert health(solved(found, close), relative, was_lost) == expected


@pytest.mark.parametrize(
    ("off", "turned", "expected"),
    [(0.0244, 0.0, "good"), (0.0246, 0.0, "lost"), (0.0, 0.0244, "good"), (0.0, 0.0246, "lost"), (0.02, 0.02, "lost")],
)
def test_a_scan_is_lost_where_its_pose_contradicts_the_prediction(off: float, turned: float, expected: str) -> None:
    assert health(solved(off=off, turned=turned)) == expected  # squares of 7.75 sigmas are 60


def test_a_pose_as_far_off_as_is_allowed_is_not_lost() -> None:
    window = solved(off=0.01)
    assert innovation(window) == pytest.approx(10.0)
    assert health(window, innovation=innovation(window)) == "good"


def covariance(axis: int, sigma: float) -> Array:
    found = SURE.copy()
    found[axis, axis] = sigma**2
    return found


@pytest.mark.parametrize(("axis", "limit"), [(0, 0.03), (2, 0.03), (3, 0.1), (5, 0.1)])
def test_a_direction_that_is_not_constrained_degrades_a_scan(axis: int, limit: float) -> None:
    settings = TrackingSettings()
    within, beyond = covariance(axis, 0.99 * limit), covariance(axis, 1.01 * limit)
    found, weak = judged(solved(), beyond, 1.0, False, settings)
    assert found == "degraded"
    assert np.abs(weak) == pytest.approx(np.eye(6)[[axis]])
    # a sensor that was lost is not found by a pose that may be anywhere along some direction
    assert [judged(solved(), C, 1.0, lost, settings)[0] for C in (within, beyond) for lost in (False, True)] == [
        "good", "good", "degraded", "lost",
    ]  # fmt: skip


def test_a_direction_as_uncertain_as_is_allowed_is_constrained() -> None:
    settings = TrackingSettings(degraded_rotation=0.25, degraded_translation=0.25)
    for axis in range(6):
        assert judged(solved(), covariance(axis, 0.25), 1.0, False, settings)[0] == "good"
