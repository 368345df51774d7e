"""Our packages have common names: an error names the foreign package that stands in the place of one of ours."""

import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def import_sgslam(folder: Path, code: str = "import sgslam") -> subprocess.CompletedProcess[str]:
    """Imports it in a folder whose own packages come first."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, [folder, ROOT]))}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=False)


@pytest.mark.parametrize("as_module", [False, True])
@pytest.mark.parametrize("name", ["data", "matching", "factors"])
def test_a_foreign_package_before_ours_is_told_with_its_path(tmp_path: Path, name: str, as_module: bool) -> None:
    foreign = tmp_path / f"{name}.py" if as_module else tmp_path / name / "__init__.py"
    foreign.parent.mkdir(exist_ok=True)
    foreign.write_text("")
    done = import_sgslam(tmp_path)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and last.startswith("ImportError: sgslam needs its own package")
    assert f"'{name}' from {ROOT}" in last and str(foreign) in last


def test_a_foreign_package_that_a_run_does_not_need_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "evaluation").mkdir()
    (tmp_path / "evaluation" / "__init__.py").write_text("raise RuntimeError('must not be loaded')")
    code = "from sgslam import load_bim; from sgslam.cli.command import call; call(['--help'])"
    done = import_sgslam(tmp_path, code=code)
    assert done.returncode == 0, done.stderr
    assert "evaluate" in done.stdout


def test_a_foreign_evaluation_is_told_where_it_is_used(tmp_path: Path) -> None:
    foreign = tmp_path / "evaluation" / "__init__.py"
    foreign.parent.mkdir()
    foreign.write_text("raise RuntimeError('must not be loaded')")
    for arguments in (["evaluate"], ["evaluate", "ablation", "--help"]):
        code = f"import sys; sys.argv = ['sgslam', *{arguments}]; from sgslam.cli.command import main; main()"
        done = import_sgslam(tmp_path, code=code)
        assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
        assert done.stderr.startswith("error: sgslam needs its own package 'evaluation'")
        assert str(foreign) in done.stderr


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


def test_the_public_names_are_listed_and_loaded_on_first_use(tmp_path: Path) -> None:
    code = (
        "import sys, sgslam\n"
        "heavy = {'numpy', 'scipy', 'gtsam', 'torch', 'numba', 'pydantic', 'ifcopenshell', 'data', 'matching'}\n"
        "assert not heavy & sys.modules.keys(), heavy & sys.modules.keys()\n"
        "assert {*sgslam.__all__, '__version__'} <= set(dir(sgslam))\n"
        "from sgslam import *\n"
        "for name in sgslam.__all__:\n"
        "    assert globals()[name] is getattr(sgslam, name), name\n"
        "assert not hasattr(sgslam, 'no_such_name')\n"
        "import data, matching\n"
        "assert matching.Matcher is Matcher and data.SceneGraph is SceneGraph and data.UserError is UserError\n"
        "print(sgslam.__version__)"
    )
    done = import_sgslam(tmp_path, code=code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == importlib.metadata.version("sgslam")
