"""Checks the installation, one line per check; exit code 1 if a check fails.

    python -m sgslam.cli.doctor

Each library runs a small self test in a process of its own: a library built for another processor does not raise an
exception but kills its process.
"""

import importlib.metadata as metadata
import platform
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal, NamedTuple

from data.common.cli import Parser, run_command
from data.common.processes import cores, environment

LIMIT_S = 120.0  # of a self test, the library's import included
LEAST_MEMORY_GB, ENOUGH_MEMORY_GB = 1.0, 2.0  # a run with the learned matcher takes 1 GB
EXTRAS = {
    "dxf": "DXF drawings as plans",
    "office": "tables of building elements as XLSX",
    "scans": "LAS, LAZ and E57 scans",
    "mesh": "COLLADA meshes of buildings",
    "view": "runs shown in the browser",
    "evalio": "evalio's data sets, and our tracking beside its odometries",
    "open3d": "distances of the map from the model, and a desktop viewer",
    "rerun": "runs as recordings for the Rerun viewer",
    "torch": "training the matcher, and the published network",
    "cluster": "measurements and training data on several machines",
    "evaluation": "the studies behind the numbers of the documentation",
    "docs": "the documentation site",
    "dev": "the tests",
}
_DRIVE = (
    "from sgslam import Config; from sgslam.warm_up import warm_up; warm_up(Config(odometry=dict(method='{}')), False)"
)
SELF_TESTS = {  # lines of Python that fail where a native library does not work on this machine
    "gtsam": "import gtsam as g; g.LevenbergMarquardtOptimizer(g.NonlinearFactorGraph(), g.Values()).optimize()",
    "ifcopenshell": "from data.ifc.products import self_test; self_test()",
    "embreex": "from numpy import eye, zeros; from data.geometry.raycast import TriangleScene as Scene; "
    "Scene(eye(3)[None]).distances(zeros(3), eye(3))",
    "kiss-icp": _DRIVE.format("kiss"),
    "small_gicp": _DRIVE.format("small_gicp"),
    "shapely": "import shapely; shapely.box(0, 0, 1, 2).buffer(1)",
    "opencv": "import cv2, numpy; cv2.distanceTransform(numpy.ones((3, 3), numpy.uint8), cv2.DIST_L2, 3)",
    "the matcher's weights": "from matching import Matcher; Matcher.load('learned')",
}
_HERE = Path(__file__).resolve().parents[2]
_CGROUP = Path("/sys/fs/cgroup")  # the limits of a container


class Finding(NamedTuple):
    """The outcome of one check; a `note` need not be fixed."""

    state: Literal["ok", "FAIL", "note"]
    what: str
    message: str


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 if all checks pass, else 1."""
    Parser(prog="python -m sgslam.cli.doctor", description="Check the installation.").parse_args(arguments)
    failed = 0
    for finding in check_installation():
        print(f"{finding.state:<5} {finding.what}: {finding.message}", flush=True)
        failed += finding.state == "FAIL"
    print("all checks passed" if not failed else f"{failed} {'check' if failed == 1 else 'checks'} failed")
    return 1 if failed else 0


def check_installation() -> Iterator[Finding]:
    """Runs all checks, the quick ones first."""
    python, packages, extras = required()
    version = platform.python_version()
    yield _judged("Python", python.contains(version, prereleases=True), f"{version} (required: {python})")
    yield _own_packages()
    for requirement in packages:
        yield check_package(requirement)
    yield Finding("ok", "processor", f"{cores()} cores available, {platform.machine()}")
    yield _memory()
    yield _cache()
    with ThreadPoolExecutor(min(4, cores())) as pool:
        yield from pool.map(run_self_test, SELF_TESTS)
    for name, needed in extras.items():
        missing = ", ".join(own.name for own in needed if check_package(own).state == "FAIL")
        hint = f"{EXTRAS[name]}; pip install 'sgslam[{name}]' installs {missing}"
        yield Finding("note" if missing else "ok", f"extra {name}", hint if missing else f"installed ({EXTRAS[name]})")


def _judged(what: str, passed: bool, message: str) -> Finding:
    return Finding("ok" if passed else "FAIL", what, message)


def required() -> tuple[Any, list[Any], dict[str, list[Any]]]:
    """The required versions of Python, the requirements, and those of each extra: of pyproject.toml in a source
    checkout, else of the installed metadata."""
    from packaging.requirements import Requirement
    from packaging.specifiers import SpecifierSet

    project = _HERE / "pyproject.toml"
    if project.is_file():
        table = tomllib.loads(project.read_text())["project"]
        extras = {name: [*map(Requirement, own)] for name, own in table["optional-dependencies"].items()}
        return SpecifierSet(table["requires-python"]), [*map(Requirement, table["dependencies"])], extras
    own = metadata.distribution("sgslam").metadata
    needed = [Requirement(text) for text in own.get_all("Requires-Dist") or []]
    always = [r for r in needed if r.marker is None or r.marker.evaluate({"extra": ""})]
    names = [name.replace("-", "_") for name in own.get_all("Provides-Extra") or []]  # a build may normalise them
    extras = {e: [r for r in needed if r.marker and r not in always and r.marker.evaluate({"extra": e})] for e in names}
    return SpecifierSet(own["Requires-Python"]), always, extras


def check_package(requirement: Any) -> Finding:
    """Whether a required package is there, in a version that is asked for."""
    hint = f"pip install '{requirement.name}{requirement.specifier}'"
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return Finding("FAIL", requirement.name, f"not installed; {hint}")
    is_right = requirement.specifier.contains(version, prereleases=True)
    return _judged(requirement.name, is_right, version if is_right else f"{version} is a wrong version; {hint}")


def _own_packages() -> Finding:
    """Whether no other distribution provides packages with the names of ours, which are common words."""
    from data.common.build import PACKAGES
    from sgslam.own_packages import foreign_package

    problems = [message for name in PACKAGES if (message := foreign_package(name))]
    provided = metadata.packages_distributions()
    others = sorted({own for name in PACKAGES for own in provided.get(name, []) if own != "sgslam"})
    if others:
        problems.append(f"{', '.join(others)} overwrites files of sgslam; use an environment without it")
    return _judged("our packages", not problems, "; ".join(problems) or f"{', '.join(PACKAGES)} in {_HERE}")


def _memory() -> Finding:
    """The memory that machine and container leave; a note with the reason where it cannot be read."""
    needs = f"a run needs {ENOUGH_MEMORY_GB:g} GB"
    try:
        fields = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        free = int(fields["MemAvailable"].split()[0]) / 1e6
        limit = _CGROUP / "memory.max"
        if limit.is_file() and (most := limit.read_text().strip()) != "max":
            free = min(free, (int(most) - int((_CGROUP / "memory.current").read_text())) / 1e9)
    except (OSError, ValueError, KeyError) as error:
        return Finding("note", "memory", f"unknown ({type(error).__name__}: {error}); {needs}")
    if free >= ENOUGH_MEMORY_GB:
        return Finding("ok", "memory", f"{free:.1f} GB available")
    return Finding("FAIL" if free < LEAST_MEMORY_GB else "note", "memory", f"{free:.1f} GB available; {needs}")


def _cache() -> Finding:
    from data.plans.bim import plan_cache

    folder = plan_cache()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        message = f"cannot write to {folder} ({error.strerror}), so every run reads its building again"
        return Finding("note", "cache", f"{message}; set SGSLAM_CACHE_DIR to another folder")
    return Finding("ok", "cache", str(folder))


def run_self_test(name: str) -> Finding:
    """Runs one of SELF_TESTS in a process of its own."""
    what = f"{name} self test"
    line = [sys.executable, "-c", SELF_TESTS[name]]
    try:
        done = subprocess.run(line, env=environment(), capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return Finding("FAIL", what, f"did not finish within {LIMIT_S:g} s")
    if done.returncode < 0:
        killed = f"its process was killed by {signal.Signals(-done.returncode).name}"
        return Finding("FAIL", what, f"{killed}; the library may be built for another processor")
    last = (done.stderr.strip().splitlines() or ["failed without a message"])[-1]
    return _judged(what, not done.returncode, last if done.returncode else "done")


if __name__ == "__main__":
    run_command(main)
