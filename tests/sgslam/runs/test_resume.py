"""A run that was broken off goes on as if it had not been."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from time import sleep

import numpy as np
import pytest
from commands import refused
from drives import fed, small_drive, small_run
from shared_runs import write_scans

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.mapping import KeyframeClouds
from sgslam.session.checkpoints import FILE, load, read_run, write_run
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow
PART = 150  # scans
FILES = (
    "trajectory.tum", "trajectory_live.tum", "trajectory_odometry.tum", "s_graph.json", "deviations.json",
    "pose_graph.g2o",
)  # fmt: skip


def test_a_run_goes_on_bit_by_bit(tmp_path: Path) -> None:
    drive, whole, after = small_drive(), small_run(with_bim=True)[1], 60
    clouds = KeyframeClouds()
    first = fed(SceneGraphSlam(drive.bim, clouds=clouds), drive.scans[:after])
    assert write_run(tmp_path, {"fed": after}, first.state())
    second = SceneGraphSlam(drive.bim, clouds=clouds)
    assert load(tmp_path, second.restore) == {"fed": after}
    result = fed(second, drive.scans[after:]).finish()
    assert np.array_equal(result.trajectory.poses, whole.trajectory.poses)
    assert np.array_equal(result.trajectory_odometry.poses, whole.trajectory_odometry.poses)
    assert result.s_graph == whole.s_graph and result.deviations == whole.deviations
    assert result.anchors == whole.anchors and [*map(list, result.factors.values())] == [
        *map(list, whole.factors.values())
    ]
    assert {**(result.matches or {}), "seconds": 0} == {**(whole.matches or {}), "seconds": 0}


def test_a_state_of_an_unlike_run_is_refused(tmp_path: Path) -> None:
    drive = small_drive()
    write_run(tmp_path, {}, fed(SceneGraphSlam(), drive.scans[:20]).state())
    with pytest.raises(UserError, match="different run"):
        load(tmp_path, SceneGraphSlam(drive.bim).restore)
    with pytest.raises(UserError, match="no run state"):
        load(tmp_path / "elsewhere", SceneGraphSlam().restore)


def begun(*arguments: str | Path, cores: int = 2) -> subprocess.Popen[str]:
    """`sgslam.run`, which writes its state after every scan: in two processes, or in one on one core."""
    some = f"import os; os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:{cores}]); "
    often = "import sgslam.session.checkpoints as c; c.EVERY_S = 0; from sgslam.run import *; "
    command = [sys.executable, "-c", f"{some}{often}run_command(main)", *map(str, arguments)]
    return subprocess.Popen(command, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def come_to(process: subprocess.Popen[str], out: Path, keyframes: int) -> None:
    while process.poll() is None:
        if (out / FILE).is_file() and read_run(out)[0]["keyframes"] >= keyframes:
            return
        sleep(0.01)
    raise AssertionError("it was done before")


def test_two_processes_write_what_one_does(tmp_path: Path) -> None:
    told = ("--scan-dir", write_scans(tmp_path / "scans", 60))
    assert (
        begun(*told, "--out", tmp_path / "two").wait() == begun(*told, "--out", tmp_path / "one", cores=1).wait() == 0
    )
    for name in FILES:
        assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "one" / name).read_bytes(), name
    assert "second pass" in (tmp_path / "two" / "run.log").read_text()


@pytest.mark.long
def test_a_command_that_was_killed_or_interrupted_is_continued_to_the_same_files(tmp_path: Path) -> None:
    """Killed and continued in two processes, interrupted in one; the whole run is in one."""
    out, whole, plan = tmp_path / "out", tmp_path / "whole", tmp_path / "a_graph.json"
    small_drive().bim.graph.save(plan)
    scans = write_scans(tmp_path / "scans", PART)
    told = ("--scan-dir", scans, "--bim", plan, "--set", "matching.method=voting")
    process = begun(*told, "--out", out)
    come_to(process, out, 5)
    process.kill()
    process.communicate()
    refuses_what_does_not_go_with_it(plan, out)
    process = begun("--resume", out, cores=1)
    come_to(process, out, 12)
    process.send_signal(signal.SIGINT)  # what was computed is there, and a line says how to go on
    said = process.communicate()[1].splitlines()
    assert process.returncode == 2 and f"--resume {out}" in said[-1]
    assert len(Trajectory.read_tum(out / "trajectory.tum")) < PART
    assert not read_run(out)[0].get("finished")
    assert begun("--resume", out).wait() == begun(*told, "--out", whole, cores=1).wait() == 0
    assert len(Trajectory.read_tum(out / "trajectory.tum")) == PART
    for name in FILES:
        assert (out / name).read_bytes() == (whole / name).read_bytes(), name
    matches = [json.loads((folder / "matches.json").read_text()) for folder in (out, whole)]
    assert {**matches[0], "seconds": 0} == {**matches[1], "seconds": 0}
    assert "finished" in refused("sgslam.run", "--resume", out)


def refuses_what_does_not_go_with_it(plan: Path, out: Path) -> None:
    words = ("sgslam.run", "--resume", out)
    for option in (("--set", "matching.method=voting"), ("--bim", plan), ("--demo",), ("--out", out)):
        assert f"leave out {option[0]}" in refused(*words, *option)
    text, at = plan.read_text(), plan.stat()
    plan.write_text(text + " ")
    assert "has changed" in refused(*words)
    plan.write_text(text)
    os.utime(plan, ns=(at.st_atime_ns, at.st_mtime_ns))
    whole = (out / FILE).read_bytes()
    (out / FILE).write_bytes(whole[:-3000])
    assert str(out / FILE) in refused(*words)
    (out / FILE).write_bytes(whole)
