"""Our packages have common names: an error names the foreign package that stands in the place of one of ours."""

import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def run(folder: Path, code: str = "import sgslam") -> subprocess.CompletedProcess[str]:
    """Runs code in a folder whose packages come first."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, [folder, ROOT]))}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=False)


@pytest.mark.parametrize("file", ["data.py", "matching/__init__.py", "factors/__init__.py"])
def test_a_foreign_package_before_ours_is_named_with_its_path(tmp_path: Path, file: str) -> None:
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text("")
    done = run(tmp_path)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and last.startswith("ImportError: ") and str(tmp_path / file) in last


def test_public_names_are_listed_and_loaded_on_first_use(tmp_path: Path) -> None:
    code = """if True:
        import sys, sgslam
        heavy = {"numpy", "scipy", "gtsam", "torch", "numba", "pydantic", "ifcopenshell", "data", "matching"}
        assert not heavy & sys.modules.keys(), heavy & sys.modules.keys()
        from sgslam import *
        assert all(globals()[name] is getattr(sgslam, name) for name in sgslam.__all__)
        print(sgslam.__version__)
    """
    done = run(tmp_path, code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == importlib.metadata.version("sgslam")
