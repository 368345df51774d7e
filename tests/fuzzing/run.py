"""`python -m fuzzing.run --inputs N --out DIR`: feeds damaged files of every format to every reader.

Each input is a mutated small file, determined by its number and the seed. It is read in a process with limits on memory
and time. A reader may read the file or refuse it (UserError; for single scans UnreadableScanError). Any other
exception, a signal, a hang or running out of memory is a crash. Inputs that crash a reader are written to DIR.
"""

import multiprocessing
import os
import random
import resource
import signal
import sys
import tempfile
import traceback
from collections import Counter
from multiprocessing.connection import Connection, wait
from pathlib import Path
from time import monotonic
from typing import Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from fuzzing.readers import READERS, REFUSED, Reader

MEMORY = 3 << 30  # bytes a reader may allocate for an input, on top of the libraries
HANG = 20.0  # s of CPU time
WAIT = 20  # wall-clock limit as a multiple of HANG: the machine may be shared
OUTCOMES = ("read", "refused", "crashes")


class Hang(BaseException):
    """The time limit is exceeded. A BaseException, so that no `except Exception` of a reader catches it."""


def input_of(reader: Reader, seeds: list[bytes], seed: int, number: int) -> bytes:
    """The bytes of an input; the same for the same arguments."""
    return reader.mutate(seeds, random.Random(f"{seed} {reader.name} {number}"))


def outcome_of(reader: Reader, path: Path) -> tuple[str, str]:
    """Reads a file; returns one of OUTCOMES and, for a crash, its description."""
    signal.setitimer(signal.ITIMER_PROF, HANG)
    signal.setitimer(signal.ITIMER_REAL, WAIT * HANG)
    try:
        reader.read(path)
        return "read", ""
    except REFUSED as error:
        return ("crashes", f"an error of several lines: {error!r}") if "\n" in str(error) else ("refused", "")
    except Hang:
        return "crashes", f"took over {HANG:.0f} s"
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return "crashes", f"{type(error).__name__}: {str(error)[:200]} ({Path(place.filename).name}:{place.lineno})"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)


def _read_inputs(name: str, numbers: list[int], seed: int, results: Connection) -> None:
    """Reads the inputs; sends each number before it is read and the outcome afterwards."""
    reader = next(r for r in READERS if r.name == name)
    raise_on_timeout()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as folder:
        seeds = reader.samples(Path(folder))
        path = Path(folder) / "input"
        for at, whole in enumerate(seeds):  # loads the libraries and checks that the samples are valid
            (path := path.with_name(f"whole{at}{reader.suffix}")).write_bytes(whole)
            reader.read(path)
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
        path = Path(folder) / f"input{reader.suffix}"
        for number in numbers:
            path.write_bytes(input_of(reader, seeds, seed, number))
            results.send((number, "began", ""))
            results.send((number, *outcome_of(reader, path)))
    results.close()


def raise_on_timeout() -> None:
    """Raises `Hang` in this process when a timer expires."""
    for number in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(number, _raise_hang)


def _raise_hang(*_: Any) -> None:
    raise Hang


def fuzz(
    names: list[str], inputs: int, seconds: float, seed: int, out: Path | None, processes: int
) -> dict[str, Counter[str]]:
    """Fuzzes the readers for at most `seconds`; returns the counts of outcomes by reader."""
    chosen = [r for r in READERS if r.name in names]
    total = sum(r.share for r in chosen)
    jobs = [(r.name, list(range(max(1, round(inputs * r.share / total))))) for r in chosen]
    jobs = [(name, numbers[k::processes]) for name, numbers in jobs for k in range(processes) if numbers[k::processes]]
    counts: dict[str, Counter[str]] = {r.name: Counter() for r in chosen}
    ends, running = monotonic() + seconds, dict[Any, "_Run"]()
    while (jobs or running) and monotonic() < ends:
        while jobs and len(running) < processes:
            run = _Run(*jobs.pop(0), seed)
            running[run.connection] = run
        for heard in wait(list(running), timeout=1.0):
            if not running[heard].listen(counts, seed, out):
                rest = running.pop(heard).after_exit(counts, seed, out)
                jobs[:0] = [rest] if rest is not None else []
        for run in [r for r in running.values() if monotonic() - r.since > 2 * WAIT * HANG]:
            run.process.kill()  # it does not react to the timer
    for run in running.values():
        run.process.kill()
    return counts


class _Run:
    """A child process and the input that it reads now."""

    def __init__(self, name: str, numbers: list[int], seed: int) -> None:
        self.name, self.numbers, self.since, self.current = name, numbers, monotonic(), -1
        self.connection, results = multiprocessing.Pipe(duplex=False)
        arguments = (name, numbers, seed, results)
        self.process = multiprocessing.get_context("fork").Process(target=_read_inputs, args=arguments)
        self.process.start()
        results.close()

    def listen(self, counts: dict[str, Counter[str]], seed: int, out: Path | None) -> bool:
        """Handles one message; returns False when the connection is closed."""
        try:
            number, outcome, what = self.connection.recv()
        except EOFError:
            return False
        self.since = monotonic()
        self.current = number if outcome == "began" else -1
        if outcome != "began":
            counts[self.name][outcome] += 1
            self.numbers = self.numbers[self.numbers.index(number) + 1 :]
            if outcome == "crashes":
                _report_crash(self.name, number, seed, what, out)
        return True

    def after_exit(self, counts: dict[str, Counter[str]], seed: int, out: Path | None) -> tuple[str, list[int]] | None:
        """Records what the process was doing when it ended; returns the reader's name and the inputs left, or None."""
        self.process.join()
        if self.current >= 0:
            counts[self.name]["crashes"] += 1
            _report_crash(self.name, self.current, seed, f"the process ended with {self.process.exitcode}", out)
            self.numbers = [n for n in self.numbers if n > self.current]
        elif self.numbers:
            raise UserError(f"{self.name}: cannot read an undamaged sample (exit code {self.process.exitcode})")
        return (self.name, self.numbers) if self.numbers else None


def _report_crash(name: str, number: int, seed: int, what: str, out: Path | None) -> None:
    print(f"crash: {name}, input {number}: {what}", file=sys.stderr, flush=True)
    if out is not None:
        reader = next(r for r in READERS if r.name == name)
        with tempfile.TemporaryDirectory() as folder:
            raw = input_of(reader, reader.samples(Path(folder)), seed, number)
        (out / f"{name.replace(' ', '_')}-{number}{reader.suffix}").write_bytes(raw)


def table(counts: dict[str, Counter[str]]) -> str:
    """Markdown table with a line for each reader."""
    lines = ["| reader | inputs | read | refused | crashes |", "|---|---|---|---|---|"]
    total: Counter[str] = Counter()
    for name, count in counts.items():
        total += count
        lines.append(f"| {name} | {count.total():,} | {count['read']:,} | {count['refused']:,} | {count['crashes']} |")
    lines.append(f"| all | {total.total():,} | {total['read']:,} | {total['refused']:,} | {total['crashes']} |")
    return "\n".join(lines)


def main() -> int:
    """The command line; returns 1 if a reader crashed. Raises UserError."""
    parser = Parser(
        prog="python -m fuzzing.run", description="Feed damaged files of every format to every reader."
    )
    add = parser.add_argument
    add("--inputs", type=int, default=10_000, metavar="N", help="inputs in total (default 10000)")
    add("--seconds", type=float, default=3600.0, metavar="S", help="time limit (default 3600)")
    add("--seed", type=int, default=0, metavar="N", help="the same seed gives the same inputs")
    add("--reader", action="append", metavar="NAME", help=f"one of: {', '.join(r.name for r in READERS)}")
    add("--processes", type=int, default=1, metavar="N", help="processes in parallel (default 1)")
    add("--out", type=Path, metavar="DIR", help="folder for the table and the inputs that crash")
    options = parser.parse_args()
    names = options.reader or [r.name for r in READERS]
    if unknown := [n for n in names if n not in {r.name for r in READERS}]:
        raise UserError(f"--reader {unknown[0]}: no such reader; see --help")
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    counts = fuzz(names, options.inputs, options.seconds, options.seed, options.out, options.processes)
    text = table(counts)
    print(text)
    if options.out is not None:
        (options.out / "fuzz.md").write_text(text + "\n")
    return int(any(count["crashes"] for count in counts.values()))


if __name__ == "__main__":
    run_command(main)
