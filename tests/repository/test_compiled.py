"""The compiled loops against numpy and scipy, which say the same more slowly."""

import ast
import os
from pathlib import Path

import numpy as np
import pytest

from data.common.build import PACKAGES
from data.common.compiled import FOLDER, MOST_VERSIONS, compiled, folder, sources, version
from sgslam.geometry.normal_equations import add_row, solved

ROOT = Path(__file__).resolve().parents[2]
RNG = np.random.default_rng(4)


@pytest.mark.parametrize("size", [1, 3, 6])
def test_normal_equations_are_those_of_least_squares(size: int) -> None:
    J, off, weight = RNG.normal(size=(20, size)), RNG.normal(size=20), RNG.uniform(0.1, 2.0, 20)
    H, g = np.zeros((size, size)), np.zeros(size)
    for row in zip(J, off, weight, strict=True):
        add_row(H, g, *row)
    root = np.sqrt(weight)[:, None]
    expected, *_ = np.linalg.lstsq(root * J, root[:, 0] * off, rcond=None)
    assert solved(H, g) == pytest.approx(expected, abs=1e-9)


def test_what_cannot_be_kept_on_disk_is_compiled_all_the_same() -> None:
    names: dict[str, object] = {}
    exec("def twice(x):\n    return 2 * x", names)  # of no file, so there is no place beside it
    assert compiled(names["twice"])(21.0) == 42.0  # type: ignore[type-var, operator]


def test_after_an_update_of_any_compiled_file_nothing_old_is_loaded(tmp_path: Path) -> None:
    (tmp_path / "matching").mkdir()
    told = []
    for name, text in (
        ("inner", "compiled"), ("outer", "compiled"), ("other", "no loop"), ("inner", "otherwise compiled"),
    ):  # fmt: skip
        (tmp_path / "matching" / f"{name}.py").write_text(text)
        told.append(version(tmp_path))
    assert told[1] == told[2] and len(set(told)) == 3


def test_all_that_compiled_functions_are_made_of_counts_as_their_source() -> None:
    """Other functions and numbers of ours that they name; each is found where it is written down."""
    known = {".".join(path.relative_to(ROOT).with_suffix("").parts): path.read_text() for path in sources(ROOT)}
    assert "data.geometry.se2_compiled" in known and FOLDER.name == f"sgslam-{version(ROOT)}"
    seen = 0
    for name, text in known.items():
        tree = ast.parse(text)
        homes = {a.name: n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names}
        values = {t.id: named(n.value) for n in tree.body if isinstance(n, ast.Assign) for t in n.targets
                  if isinstance(t, ast.Name)}  # fmt: skip
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and any("compiled" in ast.unparse(d) for d in node.decorator_list):
                names = set().union(*map(named, node.body))
                names |= set().union(*(values[n] for n in names & values.keys()))
                own = {homes[n] for n in names & homes.keys() if homes[n].partition(".")[0] in PACKAGES}
                assert own <= known.keys(), f"{name}.{node.name}: say in {own - known.keys()} that it is compiled"
                seen += len(own)
    assert seen > 20


def named(node: ast.AST) -> set[str]:
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}


def test_old_versions_go_but_for_the_latest(tmp_path: Path) -> None:
    for k in range(MOST_VERSIONS + 2):
        made = folder(tmp_path, str(k))
        os.utime(made, (k, k))
    assert folder(tmp_path, "3").is_dir()
    assert len(list(tmp_path.iterdir())) == MOST_VERSIONS and not (tmp_path / "sgslam-0").exists()
    (tmp_path / "a file").touch()
    assert not folder(tmp_path / "a file", "1").exists()
