"""Stamps that name the start, the middle or the end of a scan: the poses are those of that instant."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_files import lidar_bag, scan_points
from boxes import pose, room, scan, scene_of
from commands import called
from small_ifc import write_small_ifc

from data.plans import load_bim
from data.scans import Scan, ScanFolder, ScanSource
from data.scans.point_times import Stamped
from data.scans.sources import open_scans
from data.scans.writers import SCAN_WRITERS
from data.simulation import SimulatedRun, SpinningSensor
from data.simulation.carriers import HANDHELD
from data.simulation.simulate import simulate
from data.streams import Arrival, GrowingFolder, McapPipe, ScanStream
from sgslam import SceneGraphSlam
from sgslam.config import Config, TrackingSettings

STAMPED: tuple[Stamped, ...] = ("start", "middle", "end")
TIMES = np.linspace(0.0, 0.099, 40, dtype=np.float32)  # s, from the first point


@pytest.mark.parametrize("form", ["folder", "growing folder", "bag", "pipe"])
def test_every_reader_counts_relative_times_from_the_instant_that_is_stamped(form: str, tmp_path: Path) -> None:
    made = tmp_path if "folder" in form else lidar_bag(tmp_path / "bag", "mcap", 2)
    if "folder" in form:
        for k in range(2):
            SCAN_WRITERS["ply"](tmp_path / f"{k}.5.ply", scan_points(k), TIMES)
    source: ScanSource | ScanStream
    if form in ("folder", "bag"):
        source = open_scans(made, stamped="end")
    else:
        source = GrowingFolder(made) if "folder" in form else McapPipe(next(made.glob("*.mcap")).open("rb"))
        source.stamped = "end"
    first = next(iter(source))
    read = first.scan if isinstance(first, Arrival) else first
    assert isinstance(read, Scan) and read.point_times == pytest.approx(TIMES - 0.099, abs=1e-6)


@pytest.mark.slow
def test_a_run_says_which_instant_it_takes_stamps_for(tmp_path: Path) -> None:
    scene = scene_of(room(-3.0, -2.0, 5.0, 3.0))
    (tmp_path / "scans").mkdir()
    for k in range(6):
        np.save(tmp_path / f"scans/{k}.npy", scan(scene, pose(0.02 * k, 0.0, 1.3), seed=k))
    for more, stamped in ((("--stamp", "end"), "end"), ((), "start")):
        out = tmp_path / stamped
        done = called("sgslam.run", "--single-pass", "--scan-dir", tmp_path / "scans", "--out", out, *more)
        assert done.returncode == 0, done.stderr
        assert f"stamp: {stamped}" in (out / "config.yaml").read_text()
        assert f"{stamped} of a scan" in (out / "report.html").read_text()


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
    for read in ScanFolder(run.out_dir / "scans"):
        scans.append(read if timed else replace(read, point_times=None))
        slam.add_scan(read.stamp_ns, read.points, scans[-1].point_times)
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
