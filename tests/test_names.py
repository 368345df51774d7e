"""Our packages have common names: one of somebody else's in their place is told at once, with its path."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def import_sgslam(folder: Path, code: str = "import sgslam") -> subprocess.CompletedProcess[str]:
    """Imports it in a folder whose own packages come first."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, [folder, ROOT]))}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=False)


@pytest.mark.parametrize("as_module", [False, True])
@pytest.mark.parametrize("name", ["data", "matching", "factors", "evaluation"])
def test_a_foreign_package_before_ours_is_told_with_its_path(tmp_path: Path, name: str, as_module: bool) -> None:
    foreign = tmp_path / f"{name}.py" if as_module else tmp_path / name / "__init__.py"
    foreign.parent.mkdir(exist_ok=True)
    foreign.write_text("")
    done = import_sgslam(tmp_path)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and last.startswith("ImportError: sgslam needs its own package")
    assert f"'{name}' from {ROOT}" in last and str(foreign) in last


def test_a_folder_of_ones_own_data_is_no_package(tmp_path: Path) -> None:
    """Without an `__init__.py` it does not stand before ours."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "scan.bin").write_text("")
    done = import_sgslam(tmp_path, code="import sgslam, data.scans; print(data.__file__)")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str(ROOT / "data/__init__.py")


def test_a_module_in_place_of_ours_is_told(tmp_path: Path) -> None:
    code = "import sys, types; sys.modules['data'] = types.ModuleType('data'); import sgslam"
    assert "but Python finds none" in import_sgslam(tmp_path, code=code).stderr.splitlines()[-1]
