"""The library writes the folder that the command writes, of the same scans."""

import json
import re
import zipfile
from pathlib import Path

import ifcopenshell
import numpy as np
import pytest
from commands import called
from drives import small_drive, small_run
from slam_outputs import slam_output, write_poses
from small_ifc import write_small_ifc

from data.plans import load_bim
from data.scans import ScanSource
from data.scans.sources import open_scans
from data.slam_output import open_slam_output
from sgslam.config import Config
from sgslam.config.loading import load_config
from sgslam.session import PriorMap
from sgslam.slam import SceneGraphSlam

OF_THE_COMMAND = {"run.log"}
TIMED = {
    "metrics.json",
    "matches.json",
    "report.html",
    "elements.xlsx",
    "state.npz",
    "deviations.bcf",
    "deviations_3.0.bcf",
}
ADDED = {"seconds", "cpu_seconds", "told", "about", "advice"}  # to metrics.json, by the command


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clouds")
    scans = small_drive().scans[:130]
    for k, (_, points) in enumerate(scans):
        np.save(folder / f"{k:06d}.npy", points)
    (folder / "times.txt").write_text("".join(f"{stamp / 1e9:.9f}\n" for stamp, _ in scans))
    return folder


def move_wall(ifc: Path, name: str, by: float) -> None:
    """Along the building's x axis, in metres."""
    model = ifcopenshell.open(str(ifc))
    (wall,) = [own for own in model.by_type("IfcWall") if own.Name == name]
    location = wall.ObjectPlacement.RelativePlacement.Location
    location.Coordinates = (location.Coordinates[0] + by, *location.Coordinates[1:])
    model.write(str(ifc))


def topics(bcf: Path) -> dict[str, bytes]:
    """What is in the archive, without the time at which it was written."""
    with zipfile.ZipFile(bcf) as archive:
        return {n: re.sub(rb"<CreationDate>.*?</CreationDate>", b"", archive.read(n)) for n in archive.namelist()}


def values(path: Path) -> dict[str, object]:
    """What is in a JSON file, but times and what only the command knows."""
    return {name: value for name, value in json.loads(path.read_text()).items() if name not in ADDED}


@pytest.mark.slow
@pytest.mark.parametrize("given", [False, True])
def test_command_and_library_write_the_same(given: bool, clouds: Path, tmp_path: Path) -> None:
    """A wall of the plan stands elsewhere; `given`: with the poses of another system."""
    bim = write_small_ifc(tmp_path / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0).path
    move_wall(bim, "between", 0.06)
    source: ScanSource
    if given:
        poses, *_ = told = write_poses(slam_output(0.0005, 0.01).poses, tmp_path, "tum")
        arguments = ("sgslam.other_slam.anchor", *told, "--scans", clouds)
        source = open_slam_output(Path(str(poses)), clouds, None, None, None)
    else:
        arguments, source = ("sgslam.run", "--scan-dir", clouds), open_scans(clouds, None)
    done = called(*arguments, "--bim", bim, "--out", tmp_path / "command")
    assert done.returncode == 0, done.stderr
    slam = SceneGraphSlam(load_bim(bim), config=load_config(tmp_path / "command/config.yaml", []))
    for scan in source:
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, scan.T_odom_sensor, scan.step_covariance)
    slam.finish(source).save(tmp_path / "library")

    command, library = tmp_path / "command", tmp_path / "library"
    names = {path.name for path in command.iterdir()} - OF_THE_COMMAND
    assert {path.name for path in library.iterdir()} == names
    assert {"elements.json", "elements.csv", "deviations.bcf", "trajectory_live.tum", "state.npz"} <= names
    assert ("trajectory_all.tum" in names) == given
    for name in names - TIMED:
        assert (library / name).read_bytes() == (command / name).read_bytes(), name
    for name in ("deviations.bcf", "deviations_3.0.bcf"):
        assert topics(library / name) == topics(command / name)
    assert json.loads((library / "deviations.json").read_text())
    for name in ("metrics.json", "matches.json"):
        assert values(library / name) == values(command / name)
    maps = [PriorMap.load(folder, Config()) for folder in (command, library)]
    assert len({len(known.scans) for known in maps}) == 1 and maps[0].T_bim_map is not None


@pytest.mark.slow
def test_a_model_that_is_gone_costs_the_verdicts_alone(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    result = small_run(with_bim=True)[1]
    assert result.plan_file is not None and not result.plan_file.exists()  # it was read from a temporary folder
    result.save(tmp_path)
    assert "no verdicts on elements" in caplog.text
    assert any(
        "no verdicts on elements" in line for line in json.loads((tmp_path / "metrics.json").read_text())["advice"]
    )
    assert (tmp_path / "deviations.bcf").is_file() and (tmp_path / "report.html").is_file()
    assert not (tmp_path / "elements.json").exists()
