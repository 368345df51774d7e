"""Where a row comes from: the build, the command, the machine and the time."""

import os
import platform
import re
import subprocess
from datetime import datetime
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from data.common.build import content_hash

_ROOT = Path(__file__).resolve().parents[2]


class Provenance(BaseModel):
    """`build` is a hash of all files of the packages that are measured; `commit` that of the checkout, empty without
    git, with a `+` where files differ from it."""

    model_config = ConfigDict(frozen=True)

    build: str
    commit: str
    command: str
    machine: str
    date: str

    @staticmethod
    def of(command: str) -> "Provenance":
        """The provenance of a row that this process computes now."""
        now = datetime.now().isoformat(sep=" ", timespec="minutes")
        return Provenance(build=content_hash(), commit=_commit(), command=command, machine=machine(), date=now)


def machine() -> str:
    """The processor and its number of cores."""
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    except OSError:
        found = None
    processor = found.group(1).strip() if found else platform.processor() or platform.machine()
    return f"{processor}, {os.cpu_count()} cores"


def _commit() -> str:
    command = ["git", "-C", str(_ROOT), "describe", "--always", "--exclude=*", "--dirty=+", "--abbrev=8"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
