"""Which packages may import which: lower floors know nothing of upper ones, and heavy libraries have one home each."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BELOW = {
    "data": set[str](),
    "matching": {"data"},
    "factors": set[str](),
    "sgslam": {"data", "matching", "factors"},
    "evaluation": {"data", "matching", "factors", "sgslam"},
}
HOMES = {"torch": "matching", "ifcopenshell": "data"}


def imported(code: str) -> Iterator[tuple[int, str]]:
    """Line and first name of every import, also of those within functions."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name.partition(".")[0]) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.lineno, (node.module or "").partition(".")[0]


def forbidden(package: str, code: str) -> list[tuple[int, str]]:
    """The imports that a file of this package may not have."""
    upper = BELOW.keys() - BELOW[package] - {package}
    elsewhere = {library for library, home in HOMES.items() if home != package}
    found = [(line, name) for line, name in imported(code) if name in upper | elsewhere]
    if package == "factors":
        may = {"gtsam", "gtsam_unstable", "numpy", "factors", *sys.stdlib_module_names}
        found += [(line, name) for line, name in imported(code) if name not in may]
    return found


@pytest.mark.parametrize("package", BELOW)
def test_no_file_imports_what_its_floor_may_not(package: str) -> None:
    found = {str(p.relative_to(ROOT)): forbidden(package, p.read_text()) for p in (ROOT / package).rglob("*.py")}
    assert found and not {path: lines for path, lines in found.items() if lines}


@pytest.mark.parametrize(
    ("package", "code"),
    [
        ("data", "from matching.arrays.walls import Walls"),
        ("matching", "def f():\n    import sgslam.slam"),
        ("sgslam", "from evaluation import arms"),
        ("sgslam", "def f():\n    import torch"),
        ("evaluation", "def f():\n    from torch import nn"),
        ("matching", "import ifcopenshell.geom as geom"),
        ("factors", "import scipy.linalg"),
        ("factors", "from data.geometry.poses import inverse"),
    ],
)
def test_an_import_that_breaks_the_rule_is_found(package: str, code: str) -> None:
    assert forbidden(package, code)
    assert not forbidden(package, "import json\nimport numpy as np\nfrom . import own")
