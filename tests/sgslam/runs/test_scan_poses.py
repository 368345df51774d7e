"""How well the poses of scans are known, which of them are anchored, and where those of unplaced parts lie."""

import re
from dataclasses import replace

import numpy as np
import pytest
from boxes import Array, pose
from drives import fed, small_drive, small_run

from data.trajectory import Trajectory
from sgslam.config import Config, QualitySettings
from sgslam.session import Result
from sgslam.session.scan_poses import ScanPose, with_unplaced
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty, scan_uncertainty, why_none_is_anchored
from sgslam.slam import SceneGraphSlam


@pytest.fixture(scope="module")
def usual() -> Result:
    return small_run(with_bim=True)[1]


def test_live_sigma_is_unknown_at_first_and_grows_where_nothing_is_seen() -> None:
    drive, said = small_drive(), []
    slam = SceneGraphSlam(drive.bim)
    for stamp_ns, points in drive.scans[:60]:
        slam.add_scan(stamp_ns, points)
        said.append(slam.sigma())
    assert np.isnan(said[:5]).all()
    for k in range(1, 6):
        slam.add_scan(stamp_ns + k * 200_000_000, points[:20])
        said.append(slam.sigma())
    covered = np.array(said)[-6:, :2].max(axis=1)
    assert (np.diff(covered) > 0).all()


def test_at_the_end_of_a_run_live_sigma_is_about_what_the_result_says(usual: Result) -> None:
    ratio = small_run(with_bim=True)[0].sigma() / usual.uncertainty.sigma[-1]
    assert ((ratio > 1 / 3) & (ratio < 3)).all()


def run_with(**limits: float) -> Result:
    """The drive until it is anchored."""
    drive = small_drive()
    config = Config(quality=QualitySettings(**limits))
    return fed(SceneGraphSlam(drive.bim, config=config), drive.scans[:150]).finish()


@pytest.mark.slow
def test_a_scan_that_is_not_known_well_enough_is_not_anchored(usual: Result) -> None:
    assert usual.uncertainty.anchored.all()
    position = 1.96 * float(np.median(usual.uncertainty.sigma[:150, :3].max(axis=1)))
    result = run_with(anchored_position=position)
    known = (1.96 * result.uncertainty.sigma[:, :3] <= position).all(axis=1)
    assert 0.2 < known.mean() < 0.8
    assert result.uncertainty.anchored.tolist() == known.tolist()
    assert result.anchored and len(result.trajectory) == known.sum()
    assert result.trajectory.stamps_ns.tolist() == result.trajectory_map.stamps_ns[known].tolist()
    assert result.metrics()["anchored_share"] == pytest.approx(known.mean())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit", "what"), [("anchored_position", "position|height"), ("anchored_attitude", "pitch|roll|heading")]
)
def test_a_run_with_no_scan_that_is_known_is_not_anchored_and_says_what_is_unknown(limit: str, what: str) -> None:
    result = run_with(**{limit: 1e-4})
    assert not result.anchored and result.T_bim_map is None and not result.uncertainty.anchored.any()
    assert len(result.trajectory) == len(result.trajectory_map)
    assert re.search(f"its ({what}) is too uncertain.*--set quality.{limit}=", result.reason)
    assert np.isfinite(result.uncertainty.sigma).all()


@pytest.mark.slow
def test_a_run_whose_place_tilts_the_map_is_not_anchored_and_says_what_accepts_it() -> None:
    tilt = run_with().quality["plan_tilt_deg"]
    assert 0 < tilt.value < tilt.limit and run_with(plan_tilt=1.01 * tilt.value).anchored
    result = run_with(plan_tilt=0.99 * tilt.value)
    assert not result.anchored and result.T_bim_map is None and not result.uncertainty.anchored.any()
    assert not result.deviations and not result.quality["plan_tilt_deg"].ok
    assert re.search("tilted by .* degrees.*--set quality.plan_tilt=", result.reason)


def test_lost_scans_and_unknown_covariances_have_reasons_of_their_own(usual: Result) -> None:
    own, settings = usual.uncertainty, QualitySettings()
    lost = replace(own, health=("lost",) * len(own.health))
    unknown = replace(own, sigma=np.full_like(own.sigma, np.nan))
    assert why_none_is_anchored(lost, settings).endswith("every scan is lost")
    assert "cannot be computed" in why_none_is_anchored(unknown, settings)


def degrees(x: float, y: float, z: float, roll: float, yaw: float) -> Array:
    return pose(x, y, z, np.radians(yaw), 0.0, np.radians(roll))


def test_a_part_begins_level_at_the_last_known_place_and_heading() -> None:
    known = Trajectory(np.array([0, 10]), np.stack([np.eye(4), degrees(5.0, 2.0, 1.0, roll=20.0, yaw=90.0)]))
    first, second = degrees(0.0, 0.0, 0.0, roll=-10.0, yaw=0.0), degrees(3.0, 0.0, 0.0, roll=0.0, yaw=30.0)
    scans = [
        ScanPose(20, first, first, 0, np.eye(4)),
        ScanPose(30, second, second, 1, np.eye(4), T_previous_sensor=np.linalg.inv(first) @ second),
    ]
    whole = with_unplaced(known, [(scans, np.stack([first, second]))])
    assert whole.stamps_ns.tolist() == [0, 10, 20, 30]
    np.testing.assert_allclose(whole.poses[2], degrees(5.0, 2.0, 1.0, roll=-10.0, yaw=90.0), atol=1e-9)
    np.testing.assert_allclose(whole.poses[3], degrees(5.0, 5.0, 1.0, roll=0.0, yaw=120.0), atol=1e-9)


def test_parts_that_joined_out_of_their_order_are_in_that_of_their_stamps() -> None:
    """As where an earlier part of a run joins the map of a later one."""
    slam = fed(SceneGraphSlam(), small_drive().scans[:60])
    slam.finish()
    scans, backend = slam._map.scans, slam._map.backend
    known, second = backend.uncertainty(), backend.keyframes[len(backend.keyframes) // 2]

    def told() -> ScanUncertainty:
        return scan_uncertainty(scans, slice(None), backend, known, np.eye(3), Config(), 0, placed=True)

    before, stamps = told(), [scan.stamp_ns for scan in scans]
    last = max(k.stamp_ns for k in backend.keyframes if k.scan < second.scan)  # before the seam
    earlier = 10**12  # ns, of the second half, which stays behind the first one in the map
    for scan in scans[second.scan :]:
        scan.stamp_ns -= earlier
    for k, keyframe in enumerate(backend.keyframes):
        if keyframe.scan >= second.scan:
            backend.keyframes[k] = replace(keyframe, stamp_ns=keyframe.stamp_ns - earlier)
    after = told()
    order = [*range(second.scan, len(scans)), *range(second.scan)]
    assert np.all(np.diff(after.stamps_ns) > 0) and after.stamps_ns.tolist() == [scans[i].stamp_ns for i in order]
    inside = [n for n, i in enumerate(order) if i >= second.scan or stamps[i] <= last]
    assert len(inside) > 50
    np.testing.assert_allclose(after.sigma[inside], before.sigma[order][inside], rtol=1e-6)
