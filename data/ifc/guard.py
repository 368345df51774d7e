"""Reads IFC files in a process of its own, so that a file that crashes the reader does not end this process.

ifcopenshell is C++ and may crash on a damaged file.
"""

import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from data.common.errors import UserError
from data.common.processes import environment

MEMORY, MEMORY_EACH = 8 << 30, 200  # bytes, and bytes for each of the file's: real models take 10 to 60
SECONDS, SECONDS_EACH = 300, 120e-6  # of the processor, and for each byte: real models take up to 10e-6


def read_guarded(path: Path, seconds: float | None = None) -> dict[str, Any]:
    """Returns `{"graph": ..., "notices": [...]}` of an IFC file, see `data.ifc.graph.read_ifc`.

    Raises UserError as that does, and if the file crashes its reader or takes more than `seconds` or 8 GB (larger files
    may take more).
    """
    size = path.stat().st_size
    most = int(seconds or SECONDS + SECONDS_EACH * size) + 1
    command = [sys.executable, "-m", "data.ifc.guard", str(path), str(most), str(MEMORY + MEMORY_EACH * size)]
    done = subprocess.run(command, env=environment(), capture_output=True, check=False)
    if -done.returncode in (signal.SIGXCPU, signal.SIGKILL):
        raise UserError(f"{path}: reading it takes over {most} s; export only the walls and spaces")
    try:
        result: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        raise UserError(f"{path}: a broken IFC file that crashes the reader; export it again") from None
    if "error" in result:
        raise UserError(result["error"])
    return result


def _read(path: str, seconds: str, memory: str) -> dict[str, Any]:
    from data.ifc.graph import read_ifc

    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
    resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        graph, notices = read_ifc(path)
        return {"graph": graph.to_dict(), "notices": list(notices)}
    except UserError as error:
        return {"error": str(error)}
    except Exception as error:  # geometry that cannot be: each library raises kinds of its own
        kind = "needs too much memory" if isinstance(error, MemoryError) else "cannot be turned into a plan"
        return {"error": f"{path}: {kind} ({type(error).__name__}); export the walls and spaces again"}


if __name__ == "__main__":
    answer = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what the reader prints is no answer
    answer.write(json.dumps(_read(*sys.argv[1:])))
