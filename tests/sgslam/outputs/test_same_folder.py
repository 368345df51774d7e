"""The library writes the folder that the command writes, of the same scans."""

import json
import re
import zipfile
from pathlib import Path

import pytest
from commands import called
from drives import small_run
from shared_runs import write_scans
from slam_outputs import slam_output, write_poses

from data.plans import load_bim
from data.scans import ScanSource
from data.scans.sources import open_scans
from data.slam_output import open_slam_output
from sgslam.config import Config
from sgslam.config.loading import load_config
from sgslam.session import PriorMap
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow
TIMED = {"metrics.json", "matches.json", "report.html", "report.pdf", "elements.xlsx", "state.npz", "run.log"}
# the truth, which the command was given, is drawn too
TIMED |= {"plan.png"}
TOPICS = {"deviations.bcf", "deviations_3.0.bcf"}
OF_THE_COMMAND = {"seconds", "cpu_seconds", "told", "about", "advice", "accuracy"}  # in metrics.json


def topics(bcf: Path) -> dict[str, bytes]:
    """What is in the archive, without the time at which it was written."""
    with zipfile.ZipFile(bcf) as archive:
        return {n: re.sub(rb"<CreationDate>.*?</CreationDate>", b"", archive.read(n)) for n in archive.namelist()}


def values(path: Path) -> dict[str, object]:
    """What is in a JSON file, but times and what only the command knows."""
    return {name: value for name, value in json.loads(path.read_text()).items() if name not in OF_THE_COMMAND}


def assert_same(source: ScanSource, ifc: Path, command: Path, library: Path) -> set[str]:
    """A run by the library leaves what the command left; returns the names of the files."""
    slam = SceneGraphSlam(load_bim(ifc), config=load_config(command / "config.yaml", []))
    for scan in source:
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, scan.T_odom_sensor, scan.step_covariance)
    slam.finish(source).save(library)
    names = {path.name for path in command.iterdir()}
    assert {path.name for path in library.iterdir()} == names - {"run.log"}
    for name in names - TIMED - TOPICS:
        assert (library / name).read_bytes() == (command / name).read_bytes(), name
    for name in TOPICS:
        assert topics(library / name) == topics(command / name)
    for name in ("metrics.json", "matches.json"):
        assert values(library / name) == values(command / name)
    maps = [PriorMap.load(folder, Config()) for folder in (command, library)]
    assert len({len(known.scans) for known in maps}) == 1 and maps[0].T_bim_map is not None
    return names


def test_command_and_library_write_the_same(anchored_run: Path, tmp_path: Path) -> None:
    """A wall of the plan stands elsewhere."""
    source = open_scans(anchored_run / "scans", None)
    names = assert_same(source, anchored_run / "small.ifc", anchored_run / "out", tmp_path)
    assert {"elements.json", "elements.csv", "trajectory_live.tum"} <= names and "trajectory_all.tum" not in names
    deviations = json.loads((tmp_path / "deviations.json").read_text())
    assert any(own["significant"] for own in deviations)


@pytest.mark.long
def test_command_and_library_write_the_same_of_another_systems_poses(anchored_run: Path, tmp_path: Path) -> None:
    poses, *_ = told = write_poses(slam_output(0.0005, 0.01).poses, tmp_path, "tum")
    scans, ifc = write_scans(tmp_path / "scans", 130), anchored_run / "small.ifc"
    done = called("sgslam.other_slam.anchor", *told, "--scans", scans, "--bim", ifc, "--out", tmp_path / "command")
    assert done.returncode == 0, done.stderr
    source = open_slam_output(Path(str(poses)), scans, None, None, None)
    assert "trajectory_all.tum" in assert_same(source, ifc, tmp_path / "command", tmp_path / "library")


def test_a_model_that_is_gone_costs_the_verdicts_alone(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    result = small_run(with_bim=True)[1]
    assert result.plan_file is not None and not result.plan_file.exists()  # it was read from a temporary folder
    result.save(tmp_path)
    said = "no verdicts on elements"
    assert said in caplog.text
    assert any(said in line for line in json.loads((tmp_path / "metrics.json").read_text())["advice"])
    assert (tmp_path / "deviations.bcf").is_file() and (tmp_path / "report.html").is_file()
    assert not (tmp_path / "elements.json").exists()
