"""What remains after failures of the optimizer."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import Array, pose
from two_rooms import Run, anchors_of

from sgslam.mapping import Anchors


def anchored(run: Run) -> tuple[Anchors, Array]:
    return anchors_of(run, pose(3.0, -8.0, 12.5, 2.5))


def off(run: Run, T_map_local: Array) -> float:
    """m, of the BIM frame."""
    assert run.backend.T_map_local is not None
    return float(np.linalg.norm((run.backend.T_map_local - T_map_local)[:3, 3]))


def test_anchors_that_break_the_optimizer_are_withdrawn_and_can_come_back(caplog: pytest.LogCaptureFixture) -> None:
    run = Run()
    anchors, T_map_local = anchored(run)
    run.optimise(replace(anchors, elevations={0: (1e12, 0.01)}))  # m
    assert "failed" in caplog.text and run.backend.T_map_local is None
    assert run.errors().max() < 0.02 and not run.backend.held["anchor"]
    run.optimise(anchors)
    assert off(run, T_map_local) < 0.02


def test_what_is_beyond_repair_leaves_the_last_optimum(caplog: pytest.LogCaptureFixture) -> None:
    run = Run()
    run.optimise()
    before = run.backend.poses
    for s in run.seen:  # half of those who saw a wall say that it stands beyond the moon
        s.plane = s.plane + np.array([0, 0, 0, 1e12 * (s.keyframe % 2)])
    run.backend.held["wall"] = {}
    run.optimise()
    assert "the last estimates are kept" in caplog.text
    np.testing.assert_array_equal(run.backend.poses, before)
