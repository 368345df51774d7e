"""Worker processes: how many to use, and their environment."""

import os
import sys


def cores() -> int:
    """The number of cores that this process may use, at least one."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def environment() -> dict[str, str]:
    """This process's environment, extended so that a child Python imports the same modules."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(p or os.getcwd() for p in sys.path)}
