"""The command `sgslam`: it is the `python -m` forms under one name, and it answers at once."""

import importlib.metadata
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from data.common.cli import Parser, called_as
from data.common.errors import UserError
from sgslam.cli import doctor, installed
from sgslam.cli.command import COMMANDS
from sgslam.cli.doctor import EXTRAS, run_self_test
from sgslam.config import Config
from sgslam.config.dump import documented_yaml
from sgslam.config.loading import load_config

ROOT = Path(__file__).resolve().parents[2]


def run(*arguments: object, code: list[str] | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *(code or ["-m", "sgslam"]), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def children_seconds() -> float:
    used = os.times()
    return used.children_user + used.children_system


def test_every_name_is_a_module_with_a_line_of_its_own() -> None:
    for command in COMMANDS.values():
        assert importlib.util.find_spec(command.module), command.module
        assert len(command.about.split()) > 1 and "python -m" not in command.about, command


def test_the_help_of_a_part_names_the_whole_command() -> None:
    with called_as("sgslam evaluate"):
        part = Parser(prog="python -m evaluation").add_subparsers().add_parser("run")
    assert part.prog == "sgslam evaluate run"
    assert Parser(prog="python -m evaluation").add_subparsers().add_parser("run").prog == "python -m evaluation run"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "module"),
    [
        (["run"], "sgslam.run"),
        (["simulate"], "data.simulate"),
        (["evaluate"], "evaluation"),
    ],
)  # fmt: skip
def test_help_and_mistakes_are_those_of_the_module_under_the_commands_name(names: list[str], module: str) -> None:
    ours, theirs = run(*names, "--help"), run("--help", code=["-m", module])
    assert ours.returncode == theirs.returncode == 0
    name = " ".join(["sgslam", *names])
    assert ours.stdout.startswith(f"usage: {name} [") and theirs.stdout.startswith(f"usage: python -m {module} [")
    told = [" ".join(text.split("]", 1)[1].split()) for text in (ours.stdout, theirs.stdout)]
    assert told[0] == told[1]
    mistaken = run(*names, "--no-such-option")
    assert mistaken.returncode == 2 and mistaken.stderr.rstrip().endswith(f"see '{name} --help'")
    assert len(mistaken.stderr.splitlines()) == 1


@pytest.mark.slow
def test_a_users_mistake_ends_with_2_through_the_command_too() -> None:
    done = run("run", "--scan-dir", "nowhere")
    assert done.returncode == 2 and done.stderr.startswith("error: nowhere") and len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "near"),
    [(["rum"], "'run'"), (["dumpconfig"], "'dump-config'")],
)  # fmt: skip
def test_an_unknown_command_is_told_with_the_nearest_name(arguments: list[str], near: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2 and near in done.stderr and len(done.stderr.splitlines()) == 1


@pytest.mark.slow
def test_help_lists_all_and_takes_less_time_than_numpy_thrice() -> None:
    """In processor time, so that a busy machine does not matter: 0.15 s where `import numpy` takes 0.1 s."""
    times = []
    for command in (["-c", "import numpy"], ["-m", "sgslam", "--help"], ["-m", "sgslam", "run", "--help"]):
        used = min(_seconds(command) for _ in range(3))
        times.append(used)
    assert times[1] < 3 * times[0] and times[2] < 3 * times[0], times
    listed = run("--help").stdout
    assert all(name in listed for name in COMMANDS)


def _seconds(command: list[str]) -> float:
    before = children_seconds()
    subprocess.run([sys.executable, *command], capture_output=True, check=True)
    return children_seconds() - before


@pytest.mark.slow
def test_what_is_dumped_is_read_back_and_explained(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    done = run("dump-config", "--set", "odometry.voxel_size=0.4", "--set", "tracking.mount=[0, 12, 0]", "--out", file)
    assert done.returncode == 0, done.stderr
    config = load_config(file, [])
    assert config == load_config(None, ["odometry.voxel_size=0.4", "tracking.mount=[0, 12, 0]"]) != Config()
    lines = file.read_text().splitlines()
    for group, fields in yaml.safe_load(file.read_text()).items():
        for name in fields:
            place = next(n for n in range(lines.index(f"{group}:"), len(lines)) if lines[n].startswith(f"  {name}:"))
            assert lines[place - 1].startswith("  # "), f"{group}.{name} has no description"
    assert documented_yaml(config) == file.read_text()
    assert run("dump-config", "--set", "odometry.voxel=1").returncode == 2


@pytest.mark.parametrize(
    ("pair", "told"),
    [
        ("tracking.mount=180", ("tracking.mount", "list of 3 numbers", "roll, pitch and yaw", "given: 180")),
        ("tracking.mount=[1, 2]", ("tracking.mount:", "list of 3 numbers", "roll, pitch and yaw")),
        ("surfaces.high_band=[1, b]", ("surfaces.high_band:", "list of 2 numbers", "given: 'b'")),
        ("odometry.voxel_size=-3", ("odometry.voxel_size", "must be greater than 0", "given: -3")),
    ],
)
def test_an_invalid_setting_is_told_with_its_form_and_meaning(pair: str, told: tuple[str, ...]) -> None:
    with pytest.raises(UserError) as error:
        load_config(None, [pair])
    assert [part for part in told if part not in str(error.value)] == [] and "\n" not in str(error.value)


def test_version() -> None:
    assert run("--version").stdout.split() == ["sgslam", importlib.metadata.version("sgslam")]


def test_a_package_that_is_missing_or_too_old_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    python, _, _ = installed.required()
    wanted = [Requirement("no-such-package-of-ours>=1"), Requirement("numpy<1")]
    monkeypatch.setattr(installed, "required", lambda: (python, wanted, {}))
    (_, absent), (_, old) = installed.requirements()
    assert absent == (False, "not installed; pip install 'no-such-package-of-ours>=1'")
    assert old[0] is False and old[1].endswith("pip install 'numpy<1'")


def test_a_library_that_ends_its_process_fails_and_the_doctor_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one built for another processor does."""
    (tmp_path / "gtsam.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGILL)\n")
    monkeypatch.syspath_prepend(tmp_path)
    well, told = run_self_test("gtsam")
    assert not well and "SIGILL" in told
    assert run_self_test("shapely") == (True, "done")


def test_the_doctor_knows_what_each_extra_is_for() -> None:
    assert EXTRAS.keys() == dict(installed.extras()).keys() and all(EXTRAS.values())


def test_the_doctor_says_why_the_memory_is_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "memory.max").write_text("much")
    monkeypatch.setattr(doctor, "_CGROUP", tmp_path)
    found = doctor._memory()
    assert found.state == "note" and "ValueError" in found.message and "much" in found.message
    (tmp_path / "memory.max").write_text("max")
    assert doctor._memory().message.endswith(("available", "2 GB"))
    (tmp_path / "memory.max").write_text("3000000000")
    (tmp_path / "memory.current").write_text("2500000000")
    assert doctor._memory().message == "0.5 GB available; a run needs 2 GB"
