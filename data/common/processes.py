"""Processes beside this one: how many are worth it, and how they find the same modules."""

import os
import sys


def cores() -> int:
    """Those that this process may use, at least one."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def environment() -> dict[str, str]:
    """This process's, in which a Python imports what this one does."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(p or os.getcwd() for p in sys.path)}
