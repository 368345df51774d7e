"""Checks the installed packages against the requirements of this distribution.

A check is (passed, one-line message).
"""

import importlib.metadata as metadata
import platform
import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from data.common.build import PACKAGES
from sgslam.own_packages import package_file

NAME = "sgslam"
HERE = Path(__file__).resolve().parents[2]
Check = tuple[bool, str]


def required() -> tuple[str, list[Requirement], dict[str, list[Requirement]]]:
    """The required Python versions, the required packages, and those of each extra: from pyproject.toml in a source
    checkout, else from the installed metadata."""
    project = HERE / "pyproject.toml"
    if project.is_file():
        table = tomllib.loads(project.read_text())["project"]
        more = {k: [Requirement(r) for r in v] for k, v in table["optional-dependencies"].items()}
        return table["requires-python"], [Requirement(r) for r in table["dependencies"]], more
    own = metadata.distribution(NAME)
    needed = [Requirement(r) for r in own.requires or []]
    names = [e.replace("-", "_") for e in own.metadata.get_all("Provides-Extra") or []]  # a build may normalise them
    extras = {e: [r for r in needed if r.marker and not _holds(r, "") and _holds(r, e)] for e in names}
    return own.metadata["Requires-Python"], [r for r in needed if _holds(r, "")], extras


def python_version() -> Check:
    """Checks the version of Python."""
    wanted, version = required()[0], platform.python_version()
    return SpecifierSet(wanted).contains(version, prereleases=True), f"{version} (required: {wanted})"


def requirements() -> Iterator[tuple[str, Check]]:
    """Checks each required package."""
    for requirement in required()[1]:
        yield requirement.name, _installed_version(requirement)


def extras() -> Iterator[tuple[str, str]]:
    """Each extra with its packages that are missing or have a wrong version, comma-separated."""
    for name, needed in required()[2].items():
        yield name, ", ".join(r.name for r in needed if not _installed_version(r)[0])


def own_packages() -> Check:
    """Checks that no other distribution provides packages with the names of ours, which are common words."""
    for name in PACKAGES:
        found = package_file(name)
        if found != HERE / name / "__init__.py":
            return False, f"'{name}' is another package, at {found} instead of {HERE}; remove it from the path"
    others = sorted({d for n in PACKAGES for d in metadata.packages_distributions().get(n, []) if d != NAME})
    if others:
        return False, f"{', '.join(others)} overwrites files of sgslam; use an environment without it"
    return True, f"{', '.join(PACKAGES)} in {HERE}"


def _installed_version(requirement: Requirement) -> Check:
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return False, f"not installed; pip install '{requirement.name}{requirement.specifier}'"
    if not requirement.specifier.contains(version, prereleases=True):
        return False, f"{version} is a wrong version; pip install '{requirement.name}{requirement.specifier}'"
    return True, version


def _holds(requirement: Requirement, extra: str) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})
