"""`python -m evaluation.studies.long_run --out DIR`: time and memory of half an hour of scans.

20,000 scans of a simulated drive (`--standing`: of a robot that stands still), each of 14,400 beams with its own noise,
are read from files and processed as `sgslam.run` does, checkpoints and results included. Time counts from the first
file to the end of the report, without the simulation, which runs in another process.
"""

import gc
import io
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically, write_json
from data.plans import load_bim
from data.scans import ScanFolder
from evaluation.drives.endless_drive import DriveSpec, EndlessDrive
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.keyframe_clouds import FILE
from sgslam.session import Checkpoints, Stopwatch
from sgslam.session.result import prepare_folder
from sgslam.slam import SceneGraphSlam

_ROWS = 10


@dataclass(frozen=True)
class Sample:
    """The state after `scans` scans: seconds of wall clock and CPU (all threads) so far, CPU seconds of the
    optimisation among them, and the memory in use (MB)."""

    scans: int
    keyframes: int
    seconds: float
    cpu: float
    optimisation: float
    memory: float


class _Meter:
    """A stopwatch for wall-clock and CPU time."""

    def __init__(self) -> None:
        self.seconds = self.cpu = 0.0

    @contextmanager
    def running(self) -> Iterator[None]:
        began, used = perf_counter(), process_time()
        yield
        self.seconds += perf_counter() - began
        self.cpu += process_time() - used


def measure(way: DriveSpec, out: Path) -> tuple[list[Sample], dict[str, Any]]:
    """The samples and the numbers of the whole run; its results are written to `out`/run.

    Raises UserError for a building or a storey that cannot be driven through.
    """
    bim, meter, samples, folder = load_bim(way.bim), _Meter(), list[Sample](), prepare_folder(out / "run")
    slam = SceneGraphSlam(bim, clouds=KeyframeClouds(folder / FILE), stopwatch=Stopwatch(process_time))
    checkpoints = Checkpoints(folder, {})
    gc.freeze()
    with EndlessDrive(way) as drive:
        count = 0
        for part in drive.parts():
            with meter.running():
                for scan in ScanFolder(part):
                    update = slam.add_scan(scan.stamp_ns, scan.points)
                    count += 1
                    checkpoints.write_if_due(slam, {"fed": count})
            optimised = slam.seconds["optimisation"]
            samples.append(Sample(count, update.keyframes, meter.seconds, meter.cpu, optimised, memory_in_use()))
            print(_progress_line(samples), flush=True)
        adding = meter.seconds
        with meter.running():
            result = slam.finish()
        finishing = meter.seconds - adding
        with meter.running():
            result.save(folder)
        errors = np.linalg.norm(result.trajectory.positions - drive.truth.positions, axis=1)
    whole = {
        "scans": count, "keyframes": result.keyframes, "seconds": meter.seconds, "cpu_seconds": meter.cpu,
        "scans_per_second": count / meter.seconds, "finish_seconds": finishing,
        "writing_seconds": meter.seconds - adding - finishing, "memory_mb": memory_in_use(),
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "report_mb": (folder / "report.html").stat().st_size / 1e6, "anchored": result.anchored,
        "rmse_m": float(np.sqrt(np.mean(errors**2))) if result.anchored else None,
        "load": os.getloadavg()[2],
    }  # fmt: skip
    return samples, whole


def memory_in_use() -> float:
    """The resident memory (MB) of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def _progress_line(samples: list[Sample]) -> str:
    s = samples[-1]
    return f"{s.scans} scans, {s.keyframes} keyframes, {s.scans / s.seconds:.0f} scans/s, {s.memory:.0f} MB"


def table(samples: list[Sample]) -> str:
    """Markdown table: a line for each tenth of the run, with the times of that tenth."""
    each = ("processor, ms a scan", "optimisation, ms a keyframe")
    head = ("scans", "keyframes", "scans a second", *each, "memory (MB)")
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    marks = sorted({round(x) for x in np.linspace(0, len(samples), _ROWS + 1)[1:]} - {0})
    before = Sample(0, 0, 0.0, 0.0, 0.0, 0.0)
    for s in (samples[mark - 1] for mark in marks):
        scans, keyframes = s.scans - before.scans, max(s.keyframes - before.keyframes, 1)
        speed, cpu = scans / (s.seconds - before.seconds), 1000 * (s.cpu - before.cpu) / scans
        optimised = 1000 * (s.optimisation - before.optimisation) / keyframes
        lines.append(f"| {s.scans} | {s.keyframes} | {speed:.0f} | {cpu:.1f} | {optimised:.1f} | {s.memory:.0f} |")
        before = s
    return "\n".join(lines) + "\n"


def summary(whole: dict[str, Any]) -> str:
    """A paragraph on the whole run."""
    rmse = f"RMSE {1000 * whole['rmse_m']:.1f} mm in building coordinates" if whole["anchored"] else "not anchored"
    return (
        f"**{whole['scans']} scans in {whole['seconds']:.0f} s: {whole['scans_per_second']:.0f} scans a second** "
        f"({whole['cpu_seconds']:.0f} s of the processor), of it {whole['finish_seconds']:.1f} s to finish and "
        f"{whole['writing_seconds']:.1f} s to write the results; {whole['keyframes']} keyframes; memory at most "
        f"{whole['peak_memory_mb']:.0f} MB; the report {whole['report_mb']:.1f} MB; {rmse}. "
        f"The machine's load has been {whole['load']:.1f} for 15 minutes.\n"
    )


def picture(samples: list[Sample], path: Path) -> None:
    """Plots memory and scans per second against scans, as SVG."""
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    memory, speed = figure.subplots(1, 2)
    scans = np.array([0, *(s.scans for s in samples)])
    memory.plot(scans[1:], [s.memory for s in samples], color="black")
    memory.set(xlabel="scans", ylabel="memory in use (MB)", ylim=(0.0, None))
    speed.plot(scans[1:], np.diff(scans) / np.diff([0.0, *(s.seconds for s in samples)]), color="black")
    speed.axhline(10.0, linestyle="--", color="grey", label="the sensor")
    speed.set(xlabel="scans", ylabel="scans a second", ylim=(0.0, None))
    speed.legend(fontsize=7)
    for axes in (memory, speed):
        axes.grid(True, linewidth=0.3)
    drawn = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": path.name}):
        figure.savefig(drawn, format="svg", metadata={"Date": None})
    write_atomically(path, drawn.getvalue())


def main() -> int:
    """The command line."""
    parser = Parser(prog="python -m evaluation.studies.long_run", description="Measure time and memory of a long run.")
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for the run, the numbers and the plot")
    add("--bim", default="demo", metavar="FILE", help="IFC file (default: the demo building)")
    add("--storey", metavar="NAME", help="storey to drive through; needed for an IFC file")
    add("--scans", type=int, default=20_000, metavar="N", help="number of scans, 10 per second (default 20000)")
    add("--standing", action="store_true", help="a robot that stands still")
    add("--seed", type=int, default=0, metavar="N", help="seed of the drive")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section is written")
    options = parser.parse_args()
    if options.scans < 1:
        raise UserError(f"--scans {options.scans}: must be at least 1")
    options.out.mkdir(parents=True, exist_ok=True)
    bim, storey = _building(options.bim, options.storey, options.out)
    samples, whole = measure(DriveSpec(bim, storey, options.scans, options.standing, options.seed), options.out)
    write_json(options.out / "samples.json", {"samples": [asdict(s) for s in samples], "whole": whole})
    name = "standing" if options.standing else "long-run"
    picture(samples, options.out / f"{name}.svg")
    print(f"{table(samples)}\n{summary(whole)}", end="")
    if options.benchmarks is not None:
        _write_section(options.benchmarks, name, samples, whole, options)
    return 0


def _building(bim: str, storey: str | None, out: Path) -> tuple[Path, str]:
    from data.generation.demo_building import DEMO_STOREY, write_demo_building

    if bim != "demo":
        if storey is None:
            raise UserError("--storey is missing; name the storey to drive through")
        return Path(bim), storey
    path = out / "demo_building.ifc"
    write_demo_building(path)
    return path, storey or DEMO_STOREY


def _write_section(page: Path, name: str, samples: list[Sample], whole: dict[str, Any], options: Any) -> None:
    from evaluation.harness.benchmark_page import made_by, write_section

    docs = page.parent / "docs"
    docs.mkdir(exist_ok=True)
    picture(samples, docs / f"{name}.svg")
    words = [f"--out {options.out.name}", f"--scans {options.scans}", f"--seed {options.seed}"]
    words += [f"--bim {options.bim} --storey '{options.storey}'"] if options.bim != "demo" else []
    words += ["--standing"] if options.standing else []
    command = f"python -m evaluation.studies.long_run {' '.join(words)} --benchmarks {page.name}"
    text = f"{HEADS[name]}\n\n{summary(whole)}\n{table(samples)}\n![{name}](docs/{name}.svg)\n\nBy {made_by(command)}."
    write_section(page, name, text)


HEADS = {
    "long-run": "## Half an hour of scans\n\nA drive of 10 scans a second, 16 beams x 900 = 14,400 a scan, anchored to "
    "the plan.",
    "standing": "## An hour of standing still\n\nThe same sensor where a drive begins, with new noise in each scan.",
}

if __name__ == "__main__":
    run_command(main)
