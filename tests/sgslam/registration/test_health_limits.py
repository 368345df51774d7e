"""The limits of a scan's health from both sides; what is just at a limit is within it."""

from typing import Any

import numpy as np
import pytest
from boxes import pose

from sgslam.config import TrackingSettings
from sgslam.registration.health import innovation, judged
from sgslam.registration.window import Solved

SURE = 1e-6 * np.eye(6)


def solved(found: int = 1000, close: int = 1000, off: float = 0.0, turned: float = 0.0) -> Solved:
    """A window whose last knot is so many metres and radians off the predicted one; 3 mm and mrad are its sigma."""
    predicted, information = np.tile(np.eye(4), (2, 1, 1)), 1e6 * np.eye(12)
    knots = np.stack([np.eye(4), pose(off, 0, 0, turned)])
    return Solved(np.array([0.0, 0.1]), knots, predicted, information, 0.9 * information, 1000, found, close, 0.01)


def health(window: Solved, relative: float = 1.0, was_lost: bool = False, **settings: Any) -> str:
    return judged(window, SURE, relative, was_lost, TrackingSettings(**settings))[0]


@pytest.mark.parametrize(
    ("found", "close", "within", "beyond", "was_lost"),
    [
        (450, 440, 0.4, 0.399, False),  # much less that is known than before
        (450, 440, 0.85, 0.849, True),  # found again only where it fits as usual
        (1000, 700, 0.4, 0.3, False),
    ],
)
def test_a_scan_is_lost_where_its_surfaces_or_the_map_say_otherwise(
    found: int, close: int, within: float, beyond: float, was_lost: bool
) -> None:
    assert health(solved(found, close), within, was_lost) == "good"
    assert health(solved(found, close), beyond, was_lost) == "lost"
    assert health(solved(1000, 699), within, was_lost) == "lost"  # the points contradict surfaces


@pytest.mark.parametrize(
    ("off", "turned", "expected"),
    [(0.0244, 0.0, "good"), (0.0246, 0.0, "lost"), (0.0, 0.0244, "good"), (0.0, 0.0246, "lost"), (0.02, 0.02, "lost")],
)
def test_a_scan_is_lost_where_its_pose_contradicts_the_prediction(off: float, turned: float, expected: str) -> None:
    assert health(solved(off=off, turned=turned)) == expected  # squares of 7.75 sigmas are 60
    assert health(solved(off=off, turned=turned), innovation=innovation(solved(off=off, turned=turned))) == "good"


@pytest.mark.parametrize(("axis", "limit"), [(0, 0.03), (2, 0.03), (3, 0.1), (5, 0.1)])
def test_a_direction_that_is_not_constrained_degrades_a_scan(axis: int, limit: float) -> None:
    """A sensor that was lost is not found by a pose that may be anywhere along some direction."""
    for share, lost, expected in ((0.99, 0, "good"), (0.99, 1, "good"), (1.01, 0, "degraded"), (1.01, 1, "lost")):
        covariance = SURE.copy()
        covariance[axis, axis] = (share * limit) ** 2
        found, weak = judged(solved(), covariance, 1.0, bool(lost), TrackingSettings())
        assert found == expected
        assert np.abs(weak) == pytest.approx(np.eye(6)[[axis] if found == "degraded" else []])
    settings = TrackingSettings(degraded_rotation=0.25, degraded_translation=0.25)  # squares without rounding
    covariance[axis, axis] = 0.25**2
    assert judged(solved(), covariance, 1.0, False, settings)[0] == "good"
