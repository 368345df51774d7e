"""`python -m evaluation.long_run SCANS BIM`: what a keyframe costs in a run of thousands.

The scans of a drive are fed to and fro, as if it were driven there and back again, until there are so many keyframes.
Seconds are those of the processor (all threads of the process), so that a busy machine does not tell.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from data.bim import load_bim
from data.cli import Parser, run_command
from data.errors import UserError
from data.scans import ScanFolder
from sgslam.slam import SceneGraphSlam

PERIOD_NS = 100_000_000
MARKS = (300, 600, 1000, 1500, 2000, 3000)  # keyframes


class ProcessorTimed(SceneGraphSlam):
    """The same system; `seconds` are those of the processor."""

    @contextmanager
    def _clock(self, stage: str) -> Iterator[None]:
        began = process_time()
        yield
        self.seconds[stage] += process_time() - began


@dataclass(frozen=True)
class Mark:
    """What was spent when there were so many keyframes."""

    keyframes: int
    scans: int
    optimisation: float  # seconds
    everything: float

    @property
    def share(self) -> float:
        """Seconds of optimisation for each keyframe."""
        return self.optimisation / self.keyframes


def to_and_fro(scans: ScanFolder) -> Iterator[NDArray[np.float32]]:
    """The points of all scans, forwards and backwards without end."""
    points = [scan.points.astype(np.float32) for scan in scans]
    while True:
        yield from points
        yield from reversed(points[1:-1])


def measure(scans: ScanFolder, bim: Path, keyframes: int) -> list[Mark]:
    """The marks up to so many keyframes. Raises UserError where that is fewer than the first mark."""
    if keyframes < MARKS[0]:
        raise UserError(f"--keyframes {keyframes}: at least {MARKS[0]} are needed")
    slam, marks = ProcessorTimed(load_bim(bim)), list[Mark]()
    wanted = [mark for mark in MARKS if mark < keyframes] + [keyframes]
    for number, points in enumerate(to_and_fro(scans), 1):
        known = slam.add_scan(number * PERIOD_NS, points.astype(float)).keyframes
        if known >= wanted[len(marks)]:
            marks.append(Mark(known, number, slam.seconds["optimisation"], sum(slam.seconds.values())))
            print(f"{known} keyframes, {1000 * marks[-1].share:.2f} ms of optimisation each", flush=True)
            if known >= keyframes:
                break
    return marks


def table(marks: list[Mark]) -> str:
    """Markdown: a line for each mark."""
    head = ("keyframes", "scans", "optimisation (s)", "ms a keyframe", "of the first", "all stages, ms a scan")
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for m in marks:
        each, ratio = f"{1000 * m.share:.2f}", f"{m.share / marks[0].share:.2f}"
        everything = f"{1000 * m.everything / m.scans:.1f}"
        lines.append(f"| {m.keyframes} | {m.scans} | {m.optimisation:.1f} | {each} | {ratio} | {everything} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """The command line."""
    parser = Parser(prog="python -m evaluation.long_run", description="What a keyframe costs in a run of thousands.")
    parser.add_argument("scans", type=Path, metavar="SCANS", help="folder of a drive's scans")
    parser.add_argument("bim", type=Path, metavar="BIM", help="the building")
    parser.add_argument("--keyframes", type=int, default=MARKS[-1], metavar="N", help="to run to (default 3000)")
    parser.add_argument("--benchmarks", type=Path, metavar="FILE", help="page of results to write a section of")
    options = parser.parse_args()
    text = table(measure(ScanFolder(options.scans), options.bim, options.keyframes))
    print(text, end="")
    if options.benchmarks is not None:
        from evaluation.benchmark_page import made_by, write_section

        command = f"python -m evaluation.long_run {options.scans} {options.bim} --keyframes {options.keyframes}"
        write_section(options.benchmarks, "long-run", f"{HEAD}\n\n{text}\nBy {made_by(command)}.")
    return 0


HEAD = (
    "## A run of thousands of keyframes\n\nOne drive's scans fed to and fro, anchored to the plan; seconds of the "
    "processor."
)

if __name__ == "__main__":
    run_command(main)
