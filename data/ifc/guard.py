"""Reads IFC files in a separate process, so that a file that crashes the reader does not end this process.

ifcopenshell is C++ and may crash on a damaged file. `read_guarded` uses a helper (this module, run alone), which starts
once, loads ifcopenshell, and reads each file in a fork with limits on memory and time.
"""

import atexit
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, BinaryIO

from data.common.errors import UserError

MEMORY, MEMORY_EACH = 8 << 30, 200  # bytes, and bytes for each of the file's: real models take 10 to 60
SECONDS, SECONDS_EACH = 300, 120e-6  # of the processor, and for each byte: real models take up to 10e-6
_helpers: dict[int, subprocess.Popen[bytes]] = {}  # by process: a copy of this process must not share the pipes


def read_guarded(path: Path, seconds: float | None = None) -> dict[str, Any]:
    """Returns `{"graph": ..., "notices": [...]}` of an IFC file, see `data.ifc.graph.read_ifc`.

    Raises UserError as that does, and if the file crashes its reader or takes more than `seconds` or 8 GB (larger files
    may take more).
    """
    size = path.stat().st_size
    limits = {"seconds": seconds or SECONDS + SECONDS_EACH * size, "memory": MEMORY + MEMORY_EACH * size}
    with tempfile.TemporaryDirectory(prefix="sgslam-") as folder:
        out = Path(folder) / "result.json"
        code = _asked({"path": str(path.absolute()), "shown": str(path), "out": str(out), **limits})
        if code == 0:
            result: dict[str, Any] = json.loads(out.read_bytes())
            if "error" in result:
                raise UserError(result["error"])
            return result
    if -code in (signal.SIGXCPU, signal.SIGKILL):
        raise UserError(f"{path}: reading it takes over {limits['seconds']:.0f} s; export only the walls and spaces")
    raise UserError(f"{path}: a broken IFC file that crashes the reader; export it again")


def _asked(request: dict[str, Any]) -> int:
    """The exit code of the reader, or minus the number of the signal that ended it."""
    helper = _helpers.get(os.getpid())
    if helper is None or helper.poll() is not None:
        helper = _helpers[os.getpid()] = _started()
    assert helper.stdin is not None and helper.stdout is not None
    try:
        helper.stdin.write(json.dumps(request).encode() + b"\n")
        helper.stdin.flush()
        answer = helper.stdout.readline()
    except BaseException:  # interrupted: its answer would be taken for that to the next request
        helper.kill()
        raise
    if not answer:
        raise UserError(f"{request['shown']}: the process that reads IFC files ended; try again")
    return int(answer)


def _started() -> subprocess.Popen[bytes]:
    home = str(Path(__file__).resolve().parents[2])
    paths = os.pathsep.join(filter(None, [home, os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", "data.ifc.guard"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    helper = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, **pipes)  # type: ignore[call-overload]
    atexit.register(_end, helper, os.getpid())
    return helper  # type: ignore[no-any-return]


def _end(helper: subprocess.Popen[bytes], owner: int) -> None:
    if os.getpid() == owner and helper.stdin is not None:
        helper.stdin.close()
        helper.wait()


def _serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answers each request, a line of JSON, with the exit code of the fork that reads the file."""
    import data.ifc.graph  # noqa: F401  loaded once, for all copies

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for line in requests:
        request = json.loads(line)
        pid = os.fork()
        if not pid:
            code = 1
            try:
                _read(request)
                code = 0
            finally:
                os._exit(code)
        _, status = os.waitpid(pid, 0)
        answers.write(f"{os.waitstatus_to_exitcode(status)}\n".encode())
        answers.flush()


def _read(request: dict[str, Any]) -> None:
    from data.ifc.graph import read_ifc

    seconds, memory = int(request["seconds"]) + 1, int(request["memory"])
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        graph, notices = read_ifc(request["path"])
        result: dict[str, Any] = {"graph": graph.to_dict(), "notices": list(notices)}
    except UserError as error:
        result = {"error": str(error).replace(request["path"], request["shown"])}
    except Exception as error:  # geometry that cannot be: each library raises kinds of its own
        kind = "needs too much memory" if isinstance(error, MemoryError) else "cannot be turned into a plan"
        result = {"error": f"{request['shown']}: {kind} ({type(error).__name__}); export the walls and spaces again"}
    Path(request["out"]).write_text(json.dumps(result))


if __name__ == "__main__":
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what the reader prints is no answer
    _serve(sys.stdin.buffer, replies)
