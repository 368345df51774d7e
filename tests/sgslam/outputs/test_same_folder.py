"""The library writes the folder that the command writes, of the same scans."""

import json
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from drives import small_run

from data.common.errors import UserError
from data.plans import load_bim
from data.scans.sources import open_scans
from sgslam.config import Config
from sgslam.config.loading import load_config
from sgslam.session import PriorMap
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow
TIMED = {"metrics.json", "matches.json", "report.html", "elements.xlsx", "state.bin", "run.log"}
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


def test_command_and_library_write_the_same(anchored_run: Path, tmp_path: Path) -> None:
    """A wall of the plan stands elsewhere."""
    source, command = open_scans(anchored_run / "scans", None), anchored_run / "out"
    slam = SceneGraphSlam(load_bim(anchored_run / "small.ifc"), config=load_config(command / "config.yaml", []))
    for scan in source:
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, scan.T_odom_sensor, scan.step_covariance)
    slam.finish(second_pass=True).save(tmp_path)
    names = {path.name for path in command.iterdir()}
    assert {path.name for path in tmp_path.iterdir()} == names - {"run.log"}
    for name in names - TIMED - TOPICS:
        assert (tmp_path / name).read_bytes() == (command / name).read_bytes(), name
    for name in TOPICS:
        assert topics(tmp_path / name) == topics(command / name)
    for name in ("metrics.json", "matches.json"):
        assert values(tmp_path / name) == values(command / name)
    maps = [PriorMap.load(folder, Config()) for folder in (command, tmp_path)]
    assert len({len(known.scans) for known in maps}) == 1 and maps[0].T_bim_map is not None
    assert any(own["significant"] for own in json.loads((tmp_path / "deviations.json").read_text()))


def test_without_its_model_elements_are_those_of_the_a_graph(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    result = replace(small_run(with_bim=True)[1], plan_file=tmp_path / "gone.ifc")
    with pytest.raises(UserError, match="no such file"):
        _ = result.deviations
    result.save(tmp_path)
    assert "gone.ifc" in caplog.text and result.a_graph is not None
    found = json.loads((tmp_path / "elements.json").read_text())["elements"]
    surfaces = result.a_graph.wall_surfaces + result.a_graph.level_surfaces
    assert {own["global_id"] for own in found} == {own.source or own.id for own in surfaces}
    assert (tmp_path / "deviations.bcf").is_file() and json.loads((tmp_path / "deviations.json").read_text())
