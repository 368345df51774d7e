"""What another SLAM system left behind is anchored to the plan, in every form that is read."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import called
from drives import off, small_drive
from slam_outputs import SlamOutput, slam_output, write_poses
from small_ifc import write_small_ifc

from data.scans.writers import write_ply
from data.trajectory import Trajectory
from sgslam.cli.job.run import Interruption

pytestmark = pytest.mark.slow
COMMAND = "sgslam.other_slam.anchor"
Words = list[Path | str]


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("building") / "small.ifc"
    return write_small_ifc(path, site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0).path


def anchored(building: Path, out: Path, *words: object) -> dict[str, object]:
    """What metrics.json says of the call."""
    done = called(COMMAND, *words, "--bim", building, "--out", out)
    assert done.returncode == 0, done.stderr
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["anchored"], metrics["reason"]
    return dict(metrics)


def rmse(path: Path) -> float:
    """Metres in the BIM frame, no alignment, of the poses that the command wrote."""
    apart = off(Trajectory.read_tum(path), small_drive().truth)
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def graph(output: SlamOutput, folder: Path) -> Words:
    """With the keyframes' clouds and their stamps."""
    clouds = output.write_clouds(folder / "clouds")
    (clouds / "times.txt").write_text("".join(f"{stamp / 1e9:.9f}\n" for stamp in output.keyframes.stamps_ns))
    return [output.write_g2o(folder / "graph.g2o"), "--scans", clouds]


def keyframes(output: SlamOutput, folder: Path) -> Words:
    return [*write_poses(output.keyframes, folder, "kitti"), "--scans", output.write_clouds(folder / "clouds")]


def one_map(output: SlamOutput, folder: Path) -> Words:
    """It is given back to the poses that saw it."""
    write_ply(folder / "map.ply", output.map())
    return [*write_poses(output.poses, folder, "tum"), "--cloud", folder / "map.ply"]


DRIFTED = (0.0005, 0.001)  # 28 cm and 7 degrees off at its end
FORMS: dict[str, tuple[Callable[[SlamOutput, Path], Words], tuple[float, ...], float, str]] = {
    "poses": (keyframes, DRIFTED, 0.02, "keyframes"),
    "a map": (one_map, (), 0.04, "poses"),
    "KISS-SLAM": (lambda output, folder: [output.write_kiss_slam(folder / "kiss")], (), 0.04, "keyframes"),
    "g2o": (graph, DRIFTED, 0.02, "keyframes"),
}


@pytest.mark.parametrize("form", FORMS)
def test_each_form_is_anchored(form: str, building: Path, tmp_path: Path) -> None:
    """To so many metres, all poses or those of keyframes."""
    words, drift, within, which = FORMS[form]
    output = slam_output(*drift)
    anchored(building, tmp_path / "out", *words(output, tmp_path), "--single-pass")
    written = tmp_path / "out" / ("trajectory.tum" if drift else "trajectory_all.tum")
    assert len(Trajectory.read_tum(written)) == len(getattr(output, which))
    assert rmse(written) < within and (tmp_path / "out/report.html").is_file()


def test_what_was_interrupted_is_continued_to_the_same_end(
    building: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """KISS-SLAM's poses with scans instead of its own maps."""
    output = slam_output()
    told = [output.write_kiss_slam(tmp_path / "kiss"), "--scans", output.write_clouds(tmp_path / "clouds")]
    anchored(building, tmp_path / "whole", *told)
    assert rmse(tmp_path / "whole/trajectory.tum") < 0.02
    with monkeypatch.context() as patch:
        asked = iter([False] * 30)  # once a scan
        patch.setattr(Interruption, "__bool__", lambda self: next(asked, True))
        done = called(COMMAND, *told, "--bim", building, "--out", tmp_path / "out")
    assert done.returncode == 2 and "interrupted after" in done.stderr, done.stderr
    done = called("sgslam.run", "--resume", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    for name in ("trajectory.tum", "trajectory_all.tum"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
