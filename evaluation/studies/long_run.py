"""Time and memory of half an hour of scans.

The scans of a simulated drive, or of a robot that stands still, each of 14,400 beams with its own noise, are read from
files and processed as `sgslam.run` does, checkpoints and results included. Time counts from the first file to the end
of the report, without the simulation, which runs in another process.
"""

import gc
import resource
from collections.abc import Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveInt

from data.common.errors import UserError
from data.plans import load_bim
from data.scans import ScanFolder
from data.trajectory import Trajectory
from evaluation.drives.buildings import demo_building
from evaluation.drives.endless_drive import DriveSpec, endless_drive
from evaluation.harness import Case, Cost, Options, Record, Study
from evaluation.harness.memory import memory_in_use
from evaluation.metrics.trajectories import error_in_bim
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.keyframe_clouds import FILE
from sgslam.session import Checkpoints, Stopwatch
from sgslam.session.result import prepare_folder
from sgslam.slam import SceneGraphSlam

if TYPE_CHECKING:
    import pandas as pd  # not imported in the process whose memory is measured

ROWS = 10  # of the table
SENSOR_RATE = 10.0  # scans a second


class Choice(Options):
    """A drive of so many scans through a storey of an IFC file or of the building `demo`, or `standing` still."""

    bim: str = "../shared/data/ifc/AC11-Institute-Var-2-IFC.ifc"
    storey: str | None = "Erdgeschoss"
    scans: PositiveInt = 20_000
    standing: bool = False
    seed: int = 0


class LongDrive(Case):
    """A drive, or a robot that stands still where the drive begins."""

    bim: str
    storey: str
    scans: int
    standing: bool
    seed: int

    def files(self) -> set[str]:
        """The building."""
        return {self.bim} - {"demo"}


class Sample(Record):
    """The state after `scans` scans: wall-clock and CPU seconds so far (all threads), CPU seconds of the optimisation
    among them, and the memory in use."""

    scans: int
    keyframes: int
    seconds: float
    cpu_seconds: float
    optimisation_seconds: float
    memory_mb: float


class Whole(Record):
    """The whole run: its RMSE (m) in the BIM frame and the share of the scans that it is over, None if it is not
    anchored, and what it took. There is a sample
    for each part of the drive."""

    keyframes: int
    rmse_m: float | None
    seconds: Cost
    cpu_seconds: Cost
    finish_seconds: Cost
    writing_seconds: Cost
    peak_memory_mb: Cost
    report_mb: Cost
    samples: Annotated[tuple[Sample, ...], "cost"]
    coverage: float | None = None


def cases(options: Choice) -> list[LongDrive]:
    """The one drive. Raises UserError if the storey is missing."""
    from data.generation.demo_building import DEMO_STOREY

    storey = options.storey or (DEMO_STOREY if options.bim == "demo" else None)
    if storey is None:
        raise UserError("storey: name the storey to drive through")
    return [LongDrive(**(options.model_dump() | {"storey": storey}))]


def measure(case: LongDrive, work: Path) -> Whole:
    """Runs the drive. Raises UserError for a building or a storey that cannot be driven through."""
    path = demo_building(work) if case.bim == "demo" else Path(case.bim)
    way = DriveSpec(path, case.storey, case.scans, case.standing, case.seed)
    with TemporaryDirectory(dir=work) as out, endless_drive(way) as (truth, parts):
        return _run(path, parts, truth, prepare_folder(Path(out)))


def _run(bim: Path, parts: Iterable[Path], truth: Trajectory, folder: Path) -> Whole:
    plan, samples = load_bim(bim), list[Sample]()
    slam = SceneGraphSlam(plan, clouds=KeyframeClouds(folder / FILE), stopwatch=Stopwatch(process_time))
    checkpoints, spent, count = Checkpoints(folder, {}), np.zeros(2), 0
    gc.freeze()
    for part in parts:
        began = _clock()
        for scan in ScanFolder(part):
            update = slam.add_scan(scan.stamp_ns, scan.points)
            count += 1
            checkpoints.write_if_due(slam, {"fed": count})
        spent += _clock() - began
        samples.append(Sample(
            scans=count, keyframes=update.keyframes, seconds=spent[0], cpu_seconds=spent[1],
            optimisation_seconds=slam.seconds["optimisation"], memory_mb=memory_in_use(),
        ))  # fmt: skip
    times = [_clock()]
    result = slam.finish()
    times.append(_clock())
    result.save(folder)
    finishing, writing = np.diff([*times, _clock()], axis=0)
    seconds, cpu_seconds = spent + finishing + writing
    error = error_in_bim(result.trajectory, truth) if result.anchored else None
    return Whole(
        keyframes=result.keyframes,
        rmse_m=None if error is None else error.position.rmse,
        coverage=None if error is None else error.matched_poses / count,
        seconds=seconds, cpu_seconds=cpu_seconds, finish_seconds=finishing[0], writing_seconds=writing[0],
        peak_memory_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        report_mb=(folder / "report.html").stat().st_size / 1e6, samples=tuple(samples),
    )  # fmt: skip


def _clock() -> NDArray[np.float64]:
    """(2,) seconds of wall clock and CPU."""
    return np.array([perf_counter(), process_time()])


def tables(rows: "pd.DataFrame") -> Mapping[str, Any]:
    """A line for each run; a line for each tenth of a run, with the times of that tenth."""
    import pandas as pd

    from evaluation.harness.tables import coverage

    covered = [coverage(rows.loc[[at]]) for at in rows.index]
    runs = rows.assign(drive=_names(rows), speed=rows.scans / rows.seconds, rmse_mm=1000 * rows.rmse_m, covered=covered)
    tenths = [_parts(run.samples, ROWS).assign(drive=run.drive) for run in runs.itertuples()]
    return {"runs": _text(runs, RUN).replace("nan", "not anchored"), "tenths": _text(pd.concat(tenths), TENTH)}


RUN = {
    "drive": ("drive", ""), "scans": ("scans", ""), "keyframes": ("keyframes", ""), "seconds": ("seconds", ".0f"),
    "speed": ("scans a second", ".0f"), "cpu_seconds": ("processor (s)", ".0f"),
    "finish_seconds": ("to finish (s)", ".1f"), "writing_seconds": ("to write (s)", ".1f"),
    "peak_memory_mb": ("memory at most (MB)", ".0f"), "report_mb": ("report (MB)", ".1f"),
    "rmse_mm": ("RMSE (mm)", ".1f"), "covered": ("coverage", ""),
}  # fmt: skip
TENTH = {
    "drive": ("drive", ""), "scans": ("scans", ""), "keyframes": ("keyframes", ""), "speed": ("scans a second", ".0f"),
    "cpu_ms": ("processor, ms a scan", ".1f"), "optimisation_ms": ("optimisation, ms a keyframe", ".1f"),
    "memory_mb": ("memory (MB)", ".0f"),
}  # fmt: skip


def _text(rows: "pd.DataFrame", columns: dict[str, tuple[str, str]]) -> "pd.DataFrame":
    """The columns, each with its title and format."""
    import pandas as pd

    return pd.DataFrame({title: [format(x, form) for x in rows[name]] for name, (title, form) in columns.items()})


def _names(rows: "pd.DataFrame") -> "pd.Series[str]":
    standing = rows.standing.map({True: ", standing", False: ""})
    return rows.bim.map(lambda bim: Path(bim).stem) + ", " + rows.storey + standing


def _parts(samples: list[dict[str, Any]], count: int) -> "pd.DataFrame":
    """`count` equal parts of a run: the samples at their ends, with the speed (scans a second) and times of each."""
    import pandas as pd

    marks = sorted({round(x) for x in np.linspace(0, len(samples), count + 1)[1:]} - {0})
    ends = pd.DataFrame(samples).iloc[[mark - 1 for mark in marks]]
    own = ends.diff().fillna(ends)
    return ends.assign(
        speed=own.scans / own.seconds, cpu_ms=1000 * own.cpu_seconds / own.scans,
        optimisation_ms=1000 * own.optimisation_seconds / own.keyframes.clip(lower=1),
    )  # fmt: skip


def plots(rows: "pd.DataFrame", folder: Path) -> None:
    """Memory and scans a second against scans."""
    from evaluation.harness.plots import COLOURS, new_figure, save

    figure = new_figure(9.0, 3.0)
    memory, speed = figure.subplots(1, 2)
    for name, samples, colour in zip(_names(rows), rows.samples, COLOURS, strict=False):
        run = _parts(samples, len(samples))
        memory.plot(run.scans, run.memory_mb, color=colour, label=name)
        speed.plot(run.scans, run.speed, color=colour, label=name)
    speed.axhline(SENSOR_RATE, linestyle="--", color="grey", label="the sensor")
    for axes, label in ((memory, "memory in use (MB)"), (speed, "scans a second")):
        axes.set(xlabel="scans", ylabel=label, ylim=(0.0, None))
        axes.grid(True, linewidth=0.3)
    speed.legend(fontsize=7)
    save(figure, folder / "long_run.svg")


STUDY = Study(
    "long_run", "time and memory of half an hour of scans", Choice,
    Choice(bim="demo", storey=None, scans=1500), LongDrive, Whole, cases, measure, tables, plots=plots, timed=True,
)  # fmt: skip
