"""The command `sgslam`: one name for the `python -m` forms, quick help, settings that are read back, and its doctor."""

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from commands import refused

from data.common.errors import UserError
from sgslam.cli import doctor
from sgslam.cli.command import COMMANDS, call
from sgslam.config import Config
from sgslam.config.loading import load_config


def run(*arguments: object, module: str = "sgslam") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", module, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "module"), [("run", "sgslam.run"), ("evaluate", "evaluation")])
def test_help_and_mistakes_are_those_of_the_module_under_the_name_of_the_command(name: str, module: str) -> None:
    ours, theirs = run(name, "--help"), run("--help", module=module)
    assert ours.returncode == theirs.returncode == 0
    assert ours.stdout.startswith(f"usage: sgslam {name} [") and f"usage: python -m {module} [" in theirs.stdout
    assert ours.stdout.split("]", 1)[1].split() == theirs.stdout.split("]", 1)[1].split()
    mistaken = run(name, "--no-such-option")
    assert mistaken.returncode == 2 and len(mistaken.stderr.splitlines()) == 1
    assert f"'sgslam {name} --help'" in mistaken.stderr


def test_mistakes_are_one_line_that_names_what_is_meant(tmp_path: Path) -> None:
    assert "'run'" in refused("sgslam.cli.command", "rum")
    assert "'dump-config'" in refused("sgslam.cli.command", "dumpconfig")
    assert "nowhere" in refused("sgslam.cli.command", "run", "--scan-dir", "nowhere")
    for module, more in (("sgslam.run", ("--scan-dir", tmp_path)), ("data.simulate", ("--bim", "demo.ifc"))):
        assert "-400,0,0" in refused(module, *more, "--out", tmp_path / "o", "--mount", "-400,0,0")


def test_the_command_lists_its_sub_commands_and_tells_its_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert call([]) == call(["--version"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert set(COMMANDS) <= {line.split()[0] for line in lines if line} and last == f"sgslam {version('sgslam')}"


def test_dumped_settings_are_read_back(tmp_path: Path) -> None:
    file, changes = tmp_path / "mine.yaml", ["odometry.voxel_size=0.4", "tracking.mount=[0, 12, 0]"]
    done = run("dump-config", *(word for change in changes for word in ("--set", change)), "--out", file)
    assert done.returncode == 0, done.stderr
    assert load_config(file, []) == load_config(None, changes) != Config()


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        ("tracking.mount=180", r"tracking\.mount.*3 numbers.*180"),
        ("surfaces.high_band=[1, b]", r"surfaces\.high_band.*2 numbers.*'b'"),
        ("odometry.voxel_size=-3", r"odometry\.voxel_size.*greater than 0.*-3"),
        ("odometry.voxel=1", r"odometry\.voxel"),
    ],
)
def test_an_invalid_setting_is_refused_with_its_form(pair: str, message: str) -> None:
    with pytest.raises(UserError, match=message):  # in one line
        load_config(None, [pair])


def test_the_doctor_finds_a_crashing_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gtsam.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGILL)\n")
    monkeypatch.syspath_prepend(tmp_path)  # as one built for another processor
    assert "SIGILL" in (doctor.run_self_test("gtsam") or "")
    assert doctor.run_self_test("shapely") is None
