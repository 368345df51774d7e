"""The wheel, installed where the repository is not: every file that the code reads is in it, and the commands work."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import pytest

from data.common.build import PACKAGES

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]
PIP, OFFLINE = (sys.executable, "-m", "pip"), ("--no-deps", "--no-index", "-q")


def called(*command: object, cwd: Path) -> str:
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, cwd=cwd, env=environment, timeout=240, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built of a copy, since building leaves files beside the sources, without network."""
    if find_spec("pip") is None or find_spec("setuptools") is None or int(version("setuptools").split(".")[0]) < 77:
        pytest.skip("pip and setuptools 77 or newer build the wheel; they are not installed")
    folder = tmp_path_factory.mktemp("wheel")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, folder / "source" / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "source")
    called(*PIP, "wheel", "--no-build-isolation", *OFFLINE, "-w", folder, folder / "source", cwd=folder)
    return next(folder.glob("sgslam-*.whl"))


def test_every_file_of_the_packages_is_in_the_wheel(wheel: Path) -> None:
    held = {name for name in zipfile.ZipFile(wheel).namelist() if not name.startswith("sgslam-")}
    files = {p.relative_to(ROOT).as_posix() for name in PACKAGES for p in (ROOT / name).rglob("*") if p.is_file()}
    assert held == {name for name in files if "__pycache__" not in name}


@pytest.mark.long
def test_the_commands_work_in_an_empty_folder(wheel: Path, tmp_path: Path) -> None:
    environment = wheel.parent / "environment"
    venv.create(environment, with_pip=False, symlinks=True)
    python, sgslam = environment / "bin/python", environment / "bin/sgslam"
    called(*PIP, "--python", python, "install", *OFFLINE, wheel, cwd=wheel.parent)
    packages = next((environment / "lib").glob("python*/site-packages"))
    (packages / "libraries.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    assert str(environment) in called(python, "-c", "import data, matching; print(data.__file__)", cwd=tmp_path)
    assert all(line.split()[0] in ("ok", "all") for line in called(sgslam, "doctor", cwd=tmp_path).splitlines())
