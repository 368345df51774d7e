"""Memory in use, on Linux."""

import resource
from pathlib import Path


def memory_in_use(process: int | str = "self") -> float:
    """The resident memory (MB) of this process, or of the one with this number."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20
