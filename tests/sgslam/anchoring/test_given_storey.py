"""A given storey decides between storeys that look alike; it is contradicted where another one fits better."""

import numpy as np
import pytest
from drives import Drive, fed, off, small_drive
from test_building_anchoring import HIGHER, storeys

from sgslam.session import Result
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def drive() -> Drive:
    return small_drive()


def run(drive: Drive, moved: float, storey: str) -> Result:
    return fed(SceneGraphSlam(storeys(drive.bim.graph, moved), storey=storey), drive.scans).finish()


def test_a_given_storey_is_contradicted_where_another_explains_the_map_better(drive: Drive) -> None:
    wrong, right = run(drive, 0.6, "storey 1"), run(drive, 0.6, "Ground")
    assert right.anchored and drive.rmse(right) < 0.05
    assert not wrong.anchored
    assert "storey 'Ground' of the plan explains the map better" in wrong.reason and "--storey" in wrong.reason


@pytest.mark.long
def test_a_given_storey_decides_between_two_that_look_alike(drive: Drive) -> None:
    for storey, height in (("Ground", 0.0), ("storey 1", HIGHER)):
        result = run(drive, 0.0, storey)
        assert result.anchored
        assert np.abs(off(result.trajectory, drive.truth)[:, 2] - height).max() < 0.2
