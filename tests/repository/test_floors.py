"""Which packages may import which: lower floors know nothing of upper ones, nothing goes in a circle, and heavy
libraries have one home each."""

import ast
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import networkx
import pytest

ROOT = Path(__file__).resolve().parents[2]
BELOW = {
    "data": set[str](),
    "matching": {"data"},
    "factors": set[str](),
    "sgslam": {"data", "matching", "factors"},
    "evaluation": {"data", "matching", "factors", "sgslam"},
}
HOMES = {"torch": "matching", "ifcopenshell": "data"}
FLOORS = {  # sub-packages and modules of each package, the lowest first
    "data": "common bags geometry scene_graph trajectory imu scans streams slam_output ifc plans datasets generation "
    "simulation synthetic_maps simulate",
    "matching": "torch_extra protocol result arrays search deformation network learned training published "
    "combinatorial ambiguity matcher match train self_test",
    "factors": "noise planes rooms bim protocols match_checks anchors",
    "sgslam": "own_packages config geometry serialization perception inertial surfels registration odometry mapping "
    "backend loops tracking anchoring adjustment as_built cloud_to_model report session slam "
    "inspection viewer export cli run evalio_pipeline live other_slam",
    "evaluation": "metrics study rows tables render running buildings conditions drive peers variants stand_ins tracker "
    "outcome elements run matching studies",
}


@cache
def imported(code: str) -> list[tuple[int, str]]:
    """Line and module of every import, also of those within functions; `from a import b` gives a.b."""
    found = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found += [(node.lineno, f"{node.module}.{alias.name}") for alias in node.names]
    return found


def forbidden(package: str, code: str) -> list[tuple[int, str]]:
    """The imports that a file of this package may not have."""
    upper = BELOW.keys() - BELOW[package] - {package}
    elsewhere = {library for library, home in HOMES.items() if home != package}
    found = [(line, name) for line, name in imported(code) if name.partition(".")[0] in upper | elsewhere]
    if package == "factors":
        may = {"gtsam", "gtsam_unstable", "numpy", "factors", *sys.stdlib_module_names}
        found += [(line, name) for line, name in imported(code) if name.partition(".")[0] not in may]
    return found


@cache
def sources(package: str) -> dict[str, str]:
    """The code of a package's modules by their names."""
    paths = sorted((ROOT / package).rglob("*.py"))
    return {".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): p.read_text() for p in paths}


def upwards(package: str, modules: Mapping[str, str]) -> list[tuple[str, str]]:
    """The imports within a package that go from a lower floor to an upper one; its `__init__` may import all."""
    order = {name: floor for floor, name in enumerate(FLOORS[package].split())}

    def floor(module: str) -> int:
        return order[module.split(".")[1]]

    found = []
    for module, code in modules.items():
        if "." not in module or module.endswith("__main__"):
            continue
        inner = {name for _, name in imported(code) if name.startswith(f"{package}.") and name.split(".")[1] in order}
        found += [(module, name) for name in inner if floor(name) > floor(module)]
    return found


def circles(modules: Mapping[str, str]) -> list[set[str]]:
    """Modules that import one another, directly or not, also within functions."""
    graph = networkx.DiGraph()
    for module, code in modules.items():
        for _, name in imported(code):
            target = name if name in modules else name.rpartition(".")[0]
            if target in modules and target != module:
                graph.add_edge(module, target)
    return [found for found in networkx.strongly_connected_components(graph) if len(found) > 1]


@pytest.mark.parametrize("package", BELOW)
def test_no_file_imports_what_its_floor_may_not(package: str) -> None:
    found = {module: forbidden(package, code) for module, code in sources(package).items()}
    assert found and not {module: lines for module, lines in found.items() if lines}


@pytest.mark.parametrize("package", FLOORS)
def test_sub_packages_import_downwards_only(package: str) -> None:
    modules = sources(package)
    assert {m.split(".")[1] for m in modules if "." in m} - {"__main__"} == set(FLOORS[package].split())
    assert not upwards(package, modules)


def test_no_modules_import_each_other_in_a_circle() -> None:
    modules = {module: code for package in BELOW for module, code in sources(package).items()}
    assert len(modules) > 300 and not circles(modules)


@pytest.mark.parametrize(
    ("package", "code"),
    [
        ("data", "from matching.arrays.walls import Walls"),
        ("matching", "def f():\n    import sgslam.slam"),
        ("sgslam", "def f():\n    import torch"),
        ("factors", "import scipy.linalg"),
    ],
)
def test_an_import_that_breaks_the_rule_is_found(package: str, code: str) -> None:
    assert forbidden(package, code)
    assert not forbidden(package, "import json\nimport numpy as np\nfrom . import own")
    modules = {"data.common.low": "def f():\n    import data.scans.high", "data.scans.high": "import data.common.low"}
    assert upwards("data", modules) == [("data.common.low", "data.scans.high")] and circles(modules) == [set(modules)]
