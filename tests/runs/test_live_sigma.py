"""What a live run says of how well it knows its newest pose."""

import numpy as np
from boxes import Array
from drives import small_drive, small_run

from sgslam.slam import SceneGraphSlam


def run(with_plan: bool, scans: int) -> tuple[SceneGraphSlam, Array]:
    """A run through the first scans, and what it says after each of the last ten."""
    drive = small_drive()
    slam, said = SceneGraphSlam(drive.bim if with_plan else None), []
    for i, (stamp_ns, points) in enumerate(drive.scans[:scans]):
        slam.add_scan(stamp_ns, points)
        if i >= scans - 10:
            said.append(slam.sigma())
    return slam, np.array(said)


def test_nothing_is_said_before_gravity_is_known() -> None:
    _, said = run(with_plan=False, scans=5)
    assert said.shape == (5, 6)
    assert np.isnan(said).all()


def test_at_the_end_of_a_run_it_is_about_what_the_result_says() -> None:
    _, said = run(with_plan=True, scans=len(small_drive().scans))
    _, result = small_run(with_bim=True)
    ratio = said[-1] / result.uncertainty.sigma[-1]
    assert (ratio > 1 / 3).all()
    assert (ratio < 3).all()


def test_who_sees_nothing_knows_less_and_less() -> None:
    slam, said = run(with_plan=True, scans=60)
    stamp_ns, points = small_drive().scans[59]
    covered = []
    for k in range(1, 6):
        slam.add_scan(stamp_ns + k * 200_000_000, points[:20])
        covered.append(slam.sigma()[:2].max())
    assert covered[0] > said[-1][:2].max()
    assert (np.diff(covered) > 0).all()
