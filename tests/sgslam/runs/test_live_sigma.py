"""How well poses are known: live and in the result, and which of them are known well enough to be anchored."""

import re
from dataclasses import replace

import numpy as np
import pytest
from boxes import Array
from drives import fed, small_drive, small_run

from sgslam.config import Config, QualitySettings
from sgslam.session.result import Result
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty, why_none_is_anchored
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


def run_with(**limits: float) -> Result:
    drive = small_drive()
    return fed(SceneGraphSlam(drive.bim, config=Config(quality=QualitySettings(**limits))), drive.scans).finish()


def errors_95(own: ScanUncertainty) -> Array:
    """(N, 6) in metres and radians."""
    return 1.96 * own.sigma


def test_a_scan_that_is_not_known_well_enough_is_not_anchored() -> None:
    _, usual = small_run(with_bim=True)
    assert usual.uncertainty.anchored.all()
    position = float(np.median(errors_95(usual.uncertainty)[:, :3].max(axis=1)))
    result = run_with(anchored_position=position)
    known = (errors_95(result.uncertainty)[:, :3] <= position).all(axis=1)
    assert 0.3 < known.mean() < 0.7
    assert result.uncertainty.anchored.tolist() == known.tolist()
    assert result.anchored and len(result.trajectory) == known.sum()
    assert result.trajectory.stamps_ns.tolist() == result.trajectory_map.stamps_ns[known].tolist()
    assert result.metrics()["anchored_share"] == pytest.approx(known.mean())


@pytest.mark.parametrize(
    ("limit", "what"), [("anchored_position", "position|height"), ("anchored_attitude", "pitch|roll|heading")]
)
def test_a_run_with_no_scan_that_is_known_is_not_anchored_and_says_what_is_unknown(limit: str, what: str) -> None:
    result = run_with(**{limit: 1e-4})
    assert not result.anchored and result.T_bim_map is None and not result.uncertainty.anchored.any()
    assert len(result.trajectory) == len(result.trajectory_map)
    assert re.search(f"its ({what}) is too uncertain.*--set quality.{limit}=", result.reason)
    _, usual = small_run(with_bim=True)
    in_map, in_bim = (np.linalg.norm(own.uncertainty.sigma[:, :2], axis=1) for own in (result, usual))
    assert np.allclose(in_map, in_bim, rtol=0.25)  # along other axes


def test_a_run_whose_place_tilts_the_map_is_not_anchored_and_says_what_accepts_it() -> None:
    _, usual = small_run(with_bim=True)
    tilt = usual.quality["plan_tilt_deg"].value
    assert usual.anchored and 0 < tilt < usual.quality["plan_tilt_deg"].limit
    assert run_with(plan_tilt=1.01 * tilt).anchored
    result = run_with(plan_tilt=0.99 * tilt)
    assert not result.anchored and result.T_bim_map is None and not result.uncertainty.anchored.any()
    assert not result.deviations and len(result.trajectory) == len(result.trajectory_map)
    assert not result.quality["plan_tilt_deg"].ok  # the report shows which signal it was
    assert re.search("tilted by .* degrees.*--set quality.plan_tilt=", result.reason)


def test_lost_scans_and_unknown_covariances_have_reasons_of_their_own() -> None:
    _, usual = small_run(with_bim=True)
    own, settings = usual.uncertainty, QualitySettings()
    lost = replace(own, health=("lost",) * len(own.health))
    unknown = replace(own, sigma=np.full_like(own.sigma, np.nan))
    assert why_none_is_anchored(lost, settings).endswith("every scan is lost")
    assert "cannot be computed" in why_none_is_anchored(unknown, settings)
