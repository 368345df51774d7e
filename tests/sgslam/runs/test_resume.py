"""A run that was broken off goes on as if it had not been."""

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from time import sleep

import numpy as np
import pytest
from commands import called
from drives import fed, small_drive, small_run

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.run import main
from sgslam.session import Checkpoints, Result
from sgslam.session.checkpoints import FILE, about_run, load
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow

PART = 150  # scans


@pytest.fixture(scope="module")
def whole() -> Result:
    return small_run(with_bim=True)[1]


@pytest.mark.parametrize("after", [1, 7, pytest.param(60, marks=pytest.mark.long), -1])
def test_a_run_goes_on_bit_by_bit(after: int, whole: Result, tmp_path: Path) -> None:
    drive = small_drive()
    first = fed(SceneGraphSlam(drive.bim), drive.scans[:after])
    assert Checkpoints(tmp_path, {}).write(first, {"fed": after})
    second = SceneGraphSlam(drive.bim, clouds=first.clouds)
    assert load(tmp_path, second) == {"fed": after}
    result = fed(second, drive.scans[after:]).finish()
    assert np.array_equal(result.trajectory.poses, whole.trajectory.poses)
    assert np.array_equal(result.trajectory_odometry.poses, whole.trajectory_odometry.poses)
    assert result.s_graph == whole.s_graph and result.deviations == whole.deviations
    assert result.anchors == whole.anchors and result.factors.events == whole.factors.events
    assert result.matches is not None and whole.matches is not None
    assert {**result.matches, "seconds": 0} == {**whole.matches, "seconds": 0}


def test_a_state_of_an_unlike_run_is_refused(tmp_path: Path) -> None:
    drive = small_drive()
    Checkpoints(tmp_path, {}).write(fed(SceneGraphSlam(), drive.scans[:20]), {})
    with pytest.raises(UserError, match="different run"):
        load(tmp_path, SceneGraphSlam(drive.bim))
    with pytest.raises(UserError, match="no run state"):
        load(tmp_path / "elsewhere", SceneGraphSlam())


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As much of the drive as anchors it, as files: scans, times.txt, a_graph.json."""
    drive, folder = small_drive(), tmp_path_factory.mktemp("inputs")
    (folder / "scans").mkdir()
    for i, (_, points) in enumerate(drive.scans[:PART]):
        np.save(folder / "scans" / f"{i}.npy", points.astype(np.float32))
    (folder / "times.txt").write_text("".join(f"{stamp / 1e9:.9f}\n" for stamp, _ in drive.scans[:PART]))
    drive.bim.graph.save(folder / "a_graph.json")
    return folder


def command(*arguments: str | Path, before: str = "") -> list[str]:
    """`sgslam.run`, which writes its state after every scan."""
    often = "import sgslam.session.checkpoints as c; c.SHARE = 1e9; from sgslam.run import *; "
    return [sys.executable, "-c", f"{often}{before}run_command(main)", *map(str, arguments)]


def begun(*arguments: str | Path, before: str = "") -> subprocess.Popen[str]:
    made = command(*arguments, before=before)
    return subprocess.Popen(made, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def waits_in_second_pass(says: Path) -> str:
    """A second pass that creates the file `says` and never ends."""
    waits = f"lambda *_: (open({str(says)!r}, 'w').close(), time.sleep(1000))"
    return f"import sgslam.session.second_pass as p, time; p.smoothed = {waits}; "


def come_to(process: subprocess.Popen[str], out: Path, keyframes: int) -> None:
    while process.poll() is None:
        if (out / FILE).is_file() and about_run(out)["keyframes"] >= keyframes:
            return
        sleep(0.01)
    raise AssertionError("it was done before")


def refused(*arguments: str | Path) -> str:
    """What the command says when it refuses."""
    with pytest.raises(UserError) as told:
        main([*map(str, arguments)])
    assert "\n" not in str(told.value)
    return str(told.value)


@pytest.mark.long
def test_a_command_that_was_stopped_is_gone_on_with(inputs: Path, tmp_path: Path) -> None:
    out, whole = tmp_path / "out", tmp_path / "whole"
    told = ("--scan-dir", inputs / "scans", "--bim", inputs / "a_graph.json", "--set", "matching.method=voting")
    process = begun(*told, "--out", out)
    come_to(process, out, 5)
    process.kill()
    process.communicate()
    refuses_what_does_not_go_with_it(inputs, out, tmp_path)
    process = begun("--resume", out)
    come_to(process, out, 12)
    process.send_signal(signal.SIGINT)  # what was computed is there, and a line says how to go on
    said = process.communicate()[1].splitlines()
    assert process.returncode == 2 and f"--resume {out}" in said[-1]
    assert not any("overwritten" in line for line in said)
    assert len(Trajectory.read_tum(out / "trajectory.tum")) < PART
    process = begun("--resume", out, before=waits_in_second_pass(tmp_path / "waits"))
    while not (tmp_path / "waits").is_file():
        assert process.poll() is None
        sleep(0.01)
    process.send_signal(signal.SIGINT)
    assert f"--resume {out}" in process.communicate()[1].splitlines()[-1] and process.returncode == 2
    process = begun("--resume", out, before=waits_in_second_pass(tmp_path / "again"))
    while not (tmp_path / "again").is_file():
        assert process.poll() is None
        sleep(0.01)
    process.kill()
    process.communicate()
    assert not about_run(out).get("finished")
    assert begun("--resume", out).wait() == called("sgslam.run", *told, "--out", whole).returncode == 0
    assert len(Trajectory.read_tum(out / "trajectory.tum")) == PART
    for name in ("trajectory.tum", "trajectory_live.tum", "trajectory_odometry.tum", "s_graph.json", "deviations.json"):
        assert (out / name).read_bytes() == (whole / name).read_bytes(), name
    matches = [json.loads((folder / "matches.json").read_text()) for folder in (out, whole)]
    assert {**matches[0], "seconds": 0} == {**matches[1], "seconds": 0}
    assert "finished" in refused("--resume", out)


def refuses_what_does_not_go_with_it(inputs: Path, out: Path, tmp_path: Path) -> None:
    assert "no run state" in refused("--resume", tmp_path)
    other = ("--set", "odometry.voxel_size=0.5", "--set", "matching.method=voting")
    assert "voxel_size" in refused("--resume", out, *other)
    fewer = tmp_path / "scans"
    shutil.copytree(inputs / "scans", fewer)
    (fewer / "3.npy").unlink()
    (tmp_path / "times.txt").write_text("".join((inputs / "times.txt").read_text().splitlines(True)[1:]))
    assert "other scans" in refused("--resume", out, "--scan-dir", fewer)
    graph = json.loads((inputs / "a_graph.json").read_text())
    graph["wall_surfaces"].pop()
    (tmp_path / "other.json").write_text(json.dumps(graph))
    assert "another building" in refused("--resume", out, "--bim", tmp_path / "other.json")
    whole = (out / FILE).read_bytes()
    (out / FILE).write_bytes(whole[:-3000])
    assert str(out / FILE) in refused("--resume", out)
    (out / FILE).write_bytes(whole)
