"""Which packages may import which: lower floors know nothing of upper ones, heavy libraries have one home each."""

import ast
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

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
    "data": "common bags geometry scene_graph trajectory control imu scans streams slam_output walls ifc plans "
    "datasets generation simulation synthetic_maps simulate",
    "matching": "result arrays engine judge training published ambiguity matcher match train",
    "factors": "noise planes bim anchors",
    "sgslam": "own_packages types config geometry serialization perception inertial surfels registration odometry "
    "mapping backend loops tracking anchoring as_built cloud_to_model session report result slam warm_up "
    "inspection viewer cli run evalio_pipeline live other_slam",
    "evaluation": "metrics study rows tables render running buildings conditions peers variants drive stand_ins "
    "tracker outcome elements run calibration known_maps matching maps studies",
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
    order, found = {name: floor for floor, name in enumerate(FLOORS[package].split())}, []
    for module, code in modules.items():
        if "." not in module or module.endswith("__main__"):
            continue
        parts = [name.split(".") for _, name in imported(code) if name.startswith(f"{package}.")]
        found += [(module, part) for _, part, *_ in parts if order.get(part, -1) > order[module.split(".")[1]]]
    return found


@pytest.mark.parametrize("package", BELOW)
def test_no_file_imports_what_its_floor_may_not(package: str) -> None:
    found = {module: forbidden(package, code) for module, code in sources(package).items()}
    assert found and not {module: lines for module, lines in found.items() if lines}


@pytest.mark.parametrize("package", FLOORS)
def test_sub_packages_import_downwards_only(package: str) -> None:
    modules = sources(package)
    assert {m.split(".")[1] for m in modules if "." in m} - {"__main__"} == set(FLOORS[package].split())
    assert not upwards(package, modules)
