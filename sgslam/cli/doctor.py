"""Whether what is installed works here, one line a check; exit code 1 where something fails.

    python -m sgslam.cli.doctor

Each library is loaded in a process of its own and does a small piece of its work there, since a library that was
built for another machine does not raise but takes its process with it.
"""

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

LIMIT_S = 120.0  # for a library to load and do its small piece
LEAST_MEMORY_GB, ENOUGH_MEMORY_GB = 1.0, 2.0  # a run with the learned matcher takes 1 GB in its process
EXTRAS = {
    "dxf": "DXF drawings as plans",
    "scans": "LAS, LAZ and E57 scans",
    "mesh": "COLLADA meshes of buildings",
    "view": "runs as a page in the browser",
    "tune": "the study of the published matcher's hyper-parameters",
    "cluster": "measurements and training data by several machines",
    "docs": "the documentation as a site",
    "dev": "the tests",
}

State = Literal["ok", "FAIL", "note"]


@dataclass(frozen=True)
class Finding:
    """One line: `note` is what may be known but need not be mended."""

    state: State
    what: str
    told: str


def main(arguments: list[str] | None = None) -> int:
    """The command: 0 where all is well, 1 where something fails."""
    Parser(prog="python -m sgslam.cli.doctor", description="Whether what is installed works here.").parse_args(
        arguments
    )
    failed = 0
    for finding in examine():
        print(f"{finding.state:<5} {finding.what}: {finding.told}", flush=True)
        failed += finding.state == "FAIL"
    print("all is well" if not failed else f"{failed} of the above {'fails' if failed == 1 else 'fail'}")
    return 1 if failed else 0


def examine() -> Iterator[Finding]:
    """All checks, the quick ones first."""
    from sgslam.cli.installed import extras, fits_python, requirements, siblings
    from sgslam.cli.self_tests import SMALL_WORKS

    yield _judged("Python", fits_python())
    yield _judged("our packages", siblings())
    for name, told in requirements():
        yield _judged(name, told)
    yield from _machine()
    yield _cache()
    with ThreadPoolExecutor(min(4, cores())) as pool:
        for name, told in zip(SMALL_WORKS, pool.map(tried, SMALL_WORKS), strict=True):
            yield _judged(f"{name} at work", told)
    for name, missing in extras():
        purpose = EXTRAS.get(name, "")
        lack = f"{purpose}; pip install 'sgslam[{name}]' brings {missing}"
        yield Finding("note" if missing else "ok", f"extra {name}", lack if missing else f"installed ({purpose})")


def _judged(what: str, told: tuple[bool, str]) -> Finding:
    return Finding("ok" if told[0] else "FAIL", what, told[1])


def tried(name: str) -> tuple[bool, str]:
    """One of the small works, in a process of its own."""
    line = [sys.executable, "-c", f"from sgslam.cli.self_tests import SMALL_WORKS; SMALL_WORKS[{name!r}]()"]
    try:
        done = subprocess.run(line, env=environment(), capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return False, f"does not come to an end within {LIMIT_S:g} s"
    if done.returncode < 0:
        return False, f"its process was ended by {signal.Signals(-done.returncode).name}: built for another processor?"
    if done.returncode:
        return False, (done.stderr.strip().splitlines() or ["fails without a word"])[-1]
    return True, "done"


def _machine() -> Iterator[Finding]:
    yield Finding("ok", "processor", f"{cores()} cores for us, {platform.machine()}")
    free = _memory_gb()
    if free is None:
        yield Finding("note", "memory", "not known")
    else:
        state: State = "FAIL" if free < LEAST_MEMORY_GB else "note" if free < ENOUGH_MEMORY_GB else "ok"
        told = f"{free:.1f} GB to be had"
        yield Finding(state, "memory", told if state == "ok" else f"{told}; a run needs {ENOUGH_MEMORY_GB:g} GB")


def _memory_gb() -> float | None:
    """What is available, of the machine's or of the container's, whichever is less; None where it is not told."""
    free = []
    try:
        fields = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        free.append(int(fields["MemAvailable"].split()[0]) / 1e6)
        limit = Path("/sys/fs/cgroup/memory.max").read_text().strip()
        if limit != "max":
            free.append((int(limit) - int(Path("/sys/fs/cgroup/memory.current").read_text())) / 1e9)
    except (OSError, ValueError, KeyError):
        pass
    return min(free, default=None)


def _cache() -> Finding:
    from data.plans.bim import user_cache

    folder = user_cache()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        told = f"{folder} cannot be written ({error.strerror}): every run reads its building anew"
        return Finding("note", "cache", f"{told}; SGSLAM_CACHE_DIR names another")
    return Finding("ok", "cache", str(folder))


if __name__ == "__main__":
    run_command(main)
