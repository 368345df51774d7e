"""Stamps that name the start, the middle or the end of a scan: the poses are those of that instant."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_ifc import write_small_ifc

from data.plans import load_bim
from data.scans import Scan, ScanFolder
from data.scans.point_times import Stamped
from data.simulation import SimulatedRun, SpinningSensor
from data.simulation.carriers import HANDHELD
from data.simulation.simulate import simulate
from sgslam import SceneGraphSlam
from sgslam.config import Config, TrackingSettings

STAMPED: tuple[Stamped, ...] = ("start", "middle", "end")


def drives(folder: Path) -> tuple[Path, dict[Stamped, SimulatedRun]]:
    """A building, and the same scans in a hand, stamped in three ways."""
    building, sensor = write_small_ifc(folder / "small.ifc").path, SpinningSensor(azimuths=450)
    made = {
        stamped: simulate(
            building, "Ground", folder / stamped, seed=3, min_rooms=3, min_length=20.0, sensor=sensor, carrier=HANDHELD,
            effects=("rolling",), seconds=20.0, stamped=stamped,
        )
        for stamped in STAMPED
    }  # fmt: skip
    return building, made


def rmse(building: Path, run: SimulatedRun, stamped: Stamped, timed: bool) -> float:
    """Metres from the truth at the stamps, in the BIM frame."""
    config = Config(tracking=TrackingSettings(stamp=stamped, point_times="auto" if timed else "order"))
    slam, scans = SceneGraphSlam(load_bim(building), config=config), list[Scan]()
    for scan in ScanFolder(run.out_dir / "scans"):
        scans.append(scan if timed else replace(scan, point_times=None))
        slam.add_scan(scan.stamp_ns, scan.points, scans[-1].point_times)
    found = slam.finish(scans).trajectory
    true = run.truth.at(found.stamps_ns)
    assert len(found) == len(scans)
    return float(np.sqrt(np.mean(np.sum((found.positions - true[:, :3, 3]) ** 2, axis=1))))


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("timed", [False, True])
def test_a_stamp_at_any_instant_of_a_scan_is_as_good_as_one_at_its_start(timed: bool, tmp_path: Path) -> None:
    building, runs = drives(tmp_path)
    errors = {stamped: rmse(building, run, stamped, timed) for stamped, run in runs.items()}
    assert max(errors.values()) < max(1.1 * errors["start"], errors["start"] + 0.001), errors
    if not timed:  # the wrong instant is off by as much as a hand moves until the right one
        wrong = {stamped: rmse(building, runs[stamped], "start", timed) for stamped in ("middle", "end")}
        assert wrong["middle"] > 5 * errors["start"] and wrong["end"] > 10 * errors["start"], (errors, wrong)
