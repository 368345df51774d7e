"""Deviations that the verdict on the whole element contradicts are not significant."""

import pytest
from element_samples import verdict

from data.scene_graph import WallSurface
from sgslam.as_built.agreement import agreed
from sgslam.as_built.deviation_entries import Deviation, MovedDeviation
from sgslam.as_built.elements import Verdict

WALL = WallSurface("s", None, (0.0, 0.0), (1.0, 0.0), 2.0)


def moved(source: str, significant: bool = True) -> MovedDeviation:
    return {
        "s_id": "s", "a_id": "a", "source": source, "kind": "moved", "offset_m": 0.39, "tilt_rad": 0.0, "sigma_m": 0.01,
        "significant": significant, "reason": "2.0 m of this wall, on one side, have the same offset",
    }  # fmt: skip


@pytest.mark.parametrize(("told", "significant"), [
    ("as planned", False), ("moved", True), ("uncertain", True), ("absent", True), ("not seen", True),
])  # fmt: skip
def test_a_wall_that_stands_as_planned_is_not_significantly_moved(told: Verdict, significant: bool) -> None:
    (own,) = agreed([moved("w1")], [verdict("w1", "Wall", told, WALL)])
    assert own["significant"] is significant and ("as planned" in own["reason"]) is not significant
    assert own["offset_m"] == 0.39


def test_other_deviations_stay_as_they_are() -> None:
    told = verdict("w1", "Wall", "as planned", WALL)
    absent: Deviation = {
        "s_id": None, "a_id": "a", "source": "w1", "kind": "absent", "offset_m": None, "tilt_rad": None,
        "sigma_m": None, "significant": True, "reason": "seen through",
    }  # fmt: skip
    given = [moved("w1", significant=False), moved("w2"), absent]
    assert agreed(given, [told]) == given and agreed(given, []) == given
