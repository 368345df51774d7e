"""The wheel, installed where the repository is not: every file that the code reads is in it, and the commands work."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from boxes import pose, room, scan, scene_of
from packaging.requirements import Requirement
from packaging.version import Version
from small_ifc import write_small_ifc

from data.common.build import PACKAGES

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def called(*command: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    line = list(map(str, command))
    return subprocess.run(line, capture_output=True, text=True, cwd=cwd, env=environment, timeout=240, check=False)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built of a copy, since building leaves files beside the sources, without network."""
    try:
        if Version(metadata.version("setuptools")) < Version("77") or not metadata.version("pip"):
            pytest.skip("setuptools 77 or newer builds the wheel; it is not installed")
    except metadata.PackageNotFoundError as error:
        pytest.skip(f"the wheel is built without network by what is installed, and {error.name} is not")
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    options = ["--no-build-isolation", "--no-deps", "--no-index", "-q", "-w", folder]
    built = called(sys.executable, "-m", "pip", "wheel", *options, source, cwd=folder)
    assert built.returncode == 0, built.stderr
    return next(folder.glob("sgslam-*.whl"))


@pytest.fixture(scope="module")
def installed(wheel: Path) -> Path:
    """The folder of commands of a new environment that holds the wheel alone, and looks up its libraries in ours."""
    environment = wheel.parent / "environment"
    venv.create(environment, with_pip=False, symlinks=True)
    python = environment / "bin" / "python"
    options = ["--no-deps", "--no-index", "-q"]
    done = called(sys.executable, "-m", "pip", "--python", python, "install", *options, wheel, cwd=wheel.parent)
    assert done.returncode == 0, done.stderr
    packages = next((environment / "lib").glob("python*/site-packages"))
    (packages / "libraries.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    return environment / "bin"


def test_every_file_of_the_packages_is_in_the_wheel(wheel: Path) -> None:
    held = {name for name in zipfile.ZipFile(wheel).namelist() if not name.startswith("sgslam-")}
    ours = {p.relative_to(ROOT).as_posix() for name in PACKAGES for p in (ROOT / name).rglob("*") if p.is_file()}
    ours = {name for name in ours if "__pycache__" not in name}
    assert held == ours
    assert {f"{name}/py.typed" for name in PACKAGES} <= held
    schema = "data/scene_graph/scene_graph.schema.json"
    assert {"matching/weights/learned.npz", "sgslam/report/report.html", "sgslam/report/report.css", schema} <= held


@pytest.mark.long
def test_the_commands_work_in_an_empty_folder(installed: Path, tmp_path: Path) -> None:
    where = called(installed / "python", "-c", "import data, matching; print(data.__file__)", cwd=tmp_path)
    assert str(installed.parent) in where.stdout, where.stderr
    version = called(installed / "sgslam", "--version", cwd=tmp_path)
    assert version.stdout.split() == ["sgslam", PROJECT["project"]["version"]]
    checked = called(installed / "sgslam", "doctor", cwd=tmp_path)
    assert checked.returncode == 0, checked.stdout
    *lines, last = checked.stdout.splitlines()
    assert last == "all checks passed" and all(line.split()[0] in ("ok", "note") for line in lines)
    told = [line[6:].partition(":")[0] for line in lines]
    needed = {Requirement(r).name for r in PROJECT["project"]["dependencies"]}
    assert needed | {f"extra {e}" for e in PROJECT["project"]["optional-dependencies"]} <= set(told)
    assert "the matchers' weights self test" in told and len(set(told)) == len(told)


@pytest.mark.long
def test_a_plan_is_inspected_and_scans_are_run_from_the_wheel(installed: Path, tmp_path: Path) -> None:
    building = write_small_ifc(tmp_path / "small.ifc").path
    looked = called(
        installed / "sgslam", "inspect-bim", building, "--out", "seen", "--method", "voting", "--jobs", 1, cwd=tmp_path
    )
    assert looked.returncode == 0, looked.stderr
    assert "--heat-1" in (tmp_path / "seen/inspection.html").read_text()
    (tmp_path / "scans").mkdir()
    scene = scene_of(room(0, 0, 10, 3))
    for n in range(4):
        np.save(tmp_path / f"scans/{n}.npy", scan(scene, pose(2 + 0.1 * n, 1.5), seed=n))
    words = ["--scan-dir", "scans", "--bim", building, "--out", "out"]
    words += ["--set", "matching.method=voting"]  # of the other, which doctor loads, there is a minute to compile
    done = called(installed / "sgslam", "run", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "out/report.html").read_text()
    assert "--bim-walls" in page and 'getElementById("plan")' in page  # its style and its script
