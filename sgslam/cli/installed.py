"""What is installed of this distribution, and of what it asks for. Whatever is told is (well or not, one line)."""

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
Told = tuple[bool, str]


def asked() -> tuple[str, list[Requirement], dict[str, list[Requirement]]]:
    """The Pythons that we ask for, the packages, and those of each extra; from pyproject.toml where we lie beside it,
    else from what was installed with us."""
    project = HERE / "pyproject.toml"
    if project.is_file():
        table = tomllib.loads(project.read_text())["project"]
        more = {k: [Requirement(r) for r in v] for k, v in table["optional-dependencies"].items()}
        return table["requires-python"], [Requirement(r) for r in table["dependencies"]], more
    own = metadata.distribution(NAME)
    needed = [Requirement(r) for r in own.requires or []]
    names = own.metadata.get_all("Provides-Extra") or []
    extras = {e: [r for r in needed if r.marker and not _holds(r, "") and _holds(r, e)] for e in names}
    return own.metadata["Requires-Python"], [r for r in needed if _holds(r, "")], extras


def fits_python() -> Told:
    """Whether this Python is one that we ask for."""
    wanted, version = asked()[0], platform.python_version()
    return SpecifierSet(wanted).contains(version, prereleases=True), f"{version} (asked for: {wanted})"


def requirements() -> Iterator[tuple[str, Told]]:
    """Each package that a run needs, with the version that is there."""
    for requirement in asked()[1]:
        yield requirement.name, _there(requirement)


def extras() -> Iterator[tuple[str, str]]:
    """Each extra, and which of its packages are not there or of a wrong version."""
    for name, needed in asked()[2].items():
        yield name, ", ".join(r.name for r in needed if not _there(r)[0])


def siblings() -> Told:
    """Whether the packages that are found by our names, which are common ones, are ours, and nobody else's too."""
    for name in PACKAGES:
        found = package_file(name)
        if found != HERE / name / "__init__.py":
            return False, f"'{name}' is found at {found}, not in {HERE}: another package of that name"
    others = sorted({d for n in PACKAGES for d in metadata.packages_distributions().get(n, []) if d != NAME})
    if others:
        return False, f"{', '.join(others)} has installed files over ours; use an environment without it"
    return True, f"{', '.join(PACKAGES)} in {HERE}"


def _there(requirement: Requirement) -> Told:
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return False, f"not installed; pip install '{requirement.name}{requirement.specifier}'"
    if not requirement.specifier.contains(version, prereleases=True):
        return False, f"{version} does not fit; pip install '{requirement.name}{requirement.specifier}'"
    return True, version


def _holds(requirement: Requirement, extra: str) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})
