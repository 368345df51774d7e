"""The command `sgslam`: one name for the `python -m` forms, quick help, settings that are read back, and its doctor."""

import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from commands import refused
from packaging.requirements import Requirement

from data.common.cli import Parser
from data.common.errors import UserError
from sgslam.cli import installed
from sgslam.cli.command import COMMANDS
from sgslam.cli.doctor import run_self_test
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
    assert ours.stdout.startswith(f"usage: sgslam {name} [") and theirs.stdout.startswith(
        f"usage: python -m {module} ["
    )
    one, other = (text.split("]", 1)[1].split() for text in (ours.stdout, theirs.stdout))
    assert one == other
    mistaken = run(name, "--no-such-option")
    assert mistaken.returncode == 2 and len(mistaken.stderr.splitlines()) == 1
    assert f"'sgslam {name} --help'" in mistaken.stderr


@pytest.mark.slow
def test_help_lists_all_in_little_more_time_than_numpy_takes() -> None:
    def seconds(*command: str) -> float:
        before = os.times()
        subprocess.run([sys.executable, *command], capture_output=True, check=True)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    commands = (("-c", "import numpy"), ("-m", "sgslam", "--help"), ("-m", "sgslam", "run", "--help"))
    numpy, listed, of_run = (min(seconds(*command) for _ in range(3)) for command in commands)
    assert max(listed, of_run) < 3 * numpy  # processor time, so that a busy machine does not matter
    assert all(name in run("--help").stdout for name in COMMANDS)


def test_mistakes_are_one_line_that_names_what_is_meant(tmp_path: Path) -> None:
    assert "'run'" in refused("sgslam.cli.command", "rum")
    assert "'dump-config'" in refused("sgslam.cli.command", "dumpconfig")
    assert "nowhere" in refused("sgslam.cli.command", "run", "--scan-dir", "nowhere")
    for module, more in (("sgslam.run", ("--scan-dir", tmp_path)), ("data.simulate", ("--bim", "demo.ifc"))):
        assert "-400,0,0" in refused(module, *more, "--out", tmp_path / "o", "--mount", "-400,0,0")


@pytest.mark.parametrize("given", [["--at", "-25,0,0"], ["--at=-25,0,0"], ["--at", "-.5,1,2"]])
def test_the_value_of_an_option_may_begin_with_a_minus_sign(given: list[str]) -> None:
    parser = Parser(prog="p")
    parser.add_argument("--at")
    parser.add_argument("--flag", action="store_true")
    found = parser.parse_args([*given, "--flag"])
    assert found.at.startswith("-") and found.at.count(",") == 2 and found.flag


def test_dumped_settings_are_read_back_and_each_is_explained(tmp_path: Path) -> None:
    file, changes = tmp_path / "mine.yaml", ["odometry.voxel_size=0.4", "tracking.mount=[0, 12, 0]"]
    done = run("dump-config", *(word for change in changes for word in ("--set", change)), "--out", file)
    assert done.returncode == 0, done.stderr
    assert load_config(file, []) == load_config(None, changes) != Config()
    lines = file.read_text().splitlines()
    for group, fields in yaml.safe_load(file.read_text()).items():
        for name in fields:
            place = next(n for n in range(lines.index(f"{group}:"), len(lines)) if lines[n].startswith(f"  {name}:"))
            assert lines[place - 1].startswith("  # "), f"{group}.{name} has no description"


@pytest.mark.parametrize(
    ("pair", "parts"),
    [
        ("tracking.mount=180", ("tracking.mount", "3 numbers", "180")),
        ("tracking.mount=[1, 2]", ("tracking.mount", "3 numbers")),
        ("surfaces.high_band=[1, b]", ("surfaces.high_band", "2 numbers", "'b'")),
        ("odometry.voxel_size=-3", ("odometry.voxel_size", "greater than 0", "-3")),
        ("odometry.voxel=1", ("odometry.voxel",)),
    ],
)
def test_an_invalid_setting_is_refused_with_its_form(pair: str, parts: tuple[str, ...]) -> None:
    with pytest.raises(UserError) as error:
        load_config(None, [pair])
    assert [part for part in parts if part not in str(error.value)] == [] and "\n" not in str(error.value)


def test_version() -> None:
    assert run("--version").stdout.split() == ["sgslam", importlib.metadata.version("sgslam")]


def test_the_doctor_finds_a_missing_an_old_and_a_crashing_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = [Requirement("no-such-package-of-ours>=1"), Requirement("numpy<1")]
    python, _, _ = installed.required()
    monkeypatch.setattr(installed, "required", lambda: (python, wanted, {}))
    for (_, (well, message)), needed in zip(installed.requirements(), wanted, strict=True):
        assert not well and f"pip install '{needed}'" in message
    (tmp_path / "gtsam.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGILL)\n")
    monkeypatch.syspath_prepend(tmp_path)  # as one built for another processor
    well, message = run_self_test("gtsam")
    assert not well and "SIGILL" in message
    assert run_self_test("shapely")[0]
