"""Checks the installation, one line per check; exit code 1 if a check fails.

    python -m sgslam.cli.doctor

Each library runs a small self test in a process of its own: a library built for another processor does not raise an
exception but kills its process.
"""

import math
import platform
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

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

_CGROUP = Path("/sys/fs/cgroup")  # the limits of a container
State = Literal["ok", "FAIL", "note"]


@dataclass(frozen=True)
class Finding:
    """The outcome of one check; a `note` need not be fixed."""

    state: State
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
    from sgslam.cli.installed import extras, own_packages, python_version, requirements
    from sgslam.cli.self_tests import SELF_TESTS

    yield _finding("Python", python_version())
    yield _finding("our packages", own_packages())
    for name, check in requirements():
        yield _finding(name, check)
    yield from _machine()
    yield _cache()
    with ThreadPoolExecutor(min(4, cores())) as pool:
        for name, check in zip(SELF_TESTS, pool.map(run_self_test, SELF_TESTS), strict=True):
            yield _finding(f"{name} self test", check)
    for name, missing in extras():
        purpose = EXTRAS[name]
        hint = f"{purpose}; pip install 'sgslam[{name}]' installs {missing}"
        yield Finding("note" if missing else "ok", f"extra {name}", hint if missing else f"installed ({purpose})")


def _finding(what: str, check: tuple[bool, str]) -> Finding:
    passed, message = check
    return Finding("ok" if passed else "FAIL", what, message)


def run_self_test(name: str) -> tuple[bool, str]:
    """Runs one of SELF_TESTS in a process of its own; returns whether it passed, and a one-line message."""
    line = [sys.executable, "-c", f"from sgslam.cli.self_tests import SELF_TESTS; SELF_TESTS[{name!r}]()"]
    try:
        done = subprocess.run(line, env=environment(), capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return False, f"did not finish within {LIMIT_S:g} s"
    if done.returncode < 0:
        name = signal.Signals(-done.returncode).name
        return False, f"its process was killed by {name}; the library may be built for another processor"
    if done.returncode:
        return False, (done.stderr.strip().splitlines() or ["failed without a message"])[-1]
    return True, "done"


def _machine() -> Iterator[Finding]:
    yield Finding("ok", "processor", f"{cores()} cores available, {platform.machine()}")
    yield _memory()


def _memory() -> Finding:
    """The memory that is available; a note with the reason where it cannot be read."""
    try:
        free = min(_free_in_machine_gb(), _free_in_container_gb())
    except (OSError, ValueError, KeyError) as error:
        why = f"{type(error).__name__}: {error}"
        return Finding("note", "memory", f"unknown ({why}); a run needs {ENOUGH_MEMORY_GB:g} GB")
    state: State = "FAIL" if free < LEAST_MEMORY_GB else "note" if free < ENOUGH_MEMORY_GB else "ok"
    message = f"{free:.1f} GB available"
    return Finding(state, "memory", message if state == "ok" else f"{message}; a run needs {ENOUGH_MEMORY_GB:g} GB")


def _free_in_machine_gb() -> float:
    """Available memory (GB). Raises OSError, ValueError or KeyError where the system does not give it as Linux does."""
    fields = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
    return int(fields["MemAvailable"].split()[0]) / 1e6


def _free_in_container_gb() -> float:
    """What the container may still take (GB), infinite without a limit. Raises OSError or ValueError."""
    limit = _CGROUP / "memory.max"
    if not limit.is_file() or (most := limit.read_text().strip()) == "max":
        return math.inf
    return (int(most) - int((_CGROUP / "memory.current").read_text())) / 1e9


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


if __name__ == "__main__":
    run_command(main)
