"""Reads damaged files in a process of its own, with limits on memory and time."""

import multiprocessing
import os
import random
import resource
import signal
import traceback
from pathlib import Path

from data.common.errors import UserError
from data.scans.reading_errors import UnreadableScanError
from fuzzing.readers import Reader

MEMORY = 3 << 30  # bytes a reader may allocate, on top of what is loaded
SECONDS = 20.0  # of the processor, for an input
WAIT = 20  # wall-clock limit as a multiple of SECONDS: the machine may be shared


def input_of(reader: Reader, seeds: list[bytes], seed: int, number: int) -> bytes:
    """The bytes of an input; the same for the same arguments."""
    return reader.mutate(seeds, random.Random(f"{seed} {reader.name} {number}"))


def outcomes(reader: Reader, folder: Path, seed: int, count: int) -> list[str]:
    """Reads the inputs 0 to `count`; returns for each "read", "refused" or the description of a crash.

    The inputs that crash the reader stay in the folder under their numbers. Raises what the reader raises if it cannot
    read a whole sample.
    """
    seeds, log = reader.samples(folder), folder / "outcomes.txt"
    for k, whole in enumerate(seeds):  # loads the libraries too
        (path := folder / f"whole{k}{reader.suffix}").write_bytes(whole)
        reader.read(path)
    log.touch()
    while len(found := log.read_text().splitlines()) < count:
        arguments = (reader, seeds, seed, range(len(found), count), log)
        process = multiprocessing.get_context("fork").Process(target=_read_inputs, args=arguments)
        process.start()
        process.join()
        if code := process.exitcode:
            with log.open("a") as lines:
                lines.write(f"the process ended with {signal.Signals(-code).name if code < 0 else code}\n")
    return found


def _read_inputs(reader: Reader, seeds: list[bytes], seed: int, numbers: range, log: Path) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    with log.open("a", buffering=1) as lines:
        for number in numbers:
            path = log.with_name(f"{number}{reader.suffix}")
            path.write_bytes(input_of(reader, seeds, seed, number))
            signal.setitimer(signal.ITIMER_PROF, SECONDS)  # a timer that expires ends the process
            signal.setitimer(signal.ITIMER_REAL, WAIT * SECONDS)
            outcome = _outcome(reader, path)
            lines.write(f"{outcome}\n")
            if outcome in ("read", "refused"):
                path.unlink()


def _outcome(reader: Reader, path: Path) -> str:
    try:
        reader.read(path)
    except (UserError, UnreadableScanError) as error:
        return f"an error of several lines: {error!r}" if "\n" in str(error) else "refused"
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{repr(error)[:200]} ({Path(place.filename).name}:{place.lineno})"
    return "read"
