"""Time of a whole run beside KISS-ICP's and small_gicp's, in turns, each in a process of its own."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import pandas as pd
from pydantic import BaseModel, PositiveInt

from data.common.errors import UserError
from data.scans import ScanFolder
from evaluation.drives.sequences import DriveCase, DriveOptions, Sequence, prepare
from evaluation.harness import Claim, Record, Study
from evaluation.harness.tables import grouped, spread

PEERS = {"kiss_icp": "KISS-ICP", "small_gicp": "small_gicp"}
PROGRAMS = {
    "warm": "sgslam", "cold": "sgslam, a building not seen before", "first": "sgslam, just installed",
    "kiss_icp_pipeline": "KISS-ICP's own pipeline, its default voxels of 1 m", **PEERS,
}  # fmt: skip
_PIPELINE = """
import sys
from pathlib import Path
from kiss_icp.datasets import dataset_factory
from kiss_icp.pipeline import OdometryPipeline
def run(scans): OdometryPipeline(dataset_factory(dataloader="generic", data_dir=Path(scans))).run()
"""
_PEER = """
import sys
from pathlib import Path
from data.scans import ScanFolder
from evaluation.slam_ablation import peers
def run(scans): getattr(peers, sys.argv[3] + "_alone")(ScanFolder(Path(scans)))
"""
_TIMED = """
import json, time
began, used = time.perf_counter(), time.process_time()
run(sys.argv[1])
seconds = {"inner": time.perf_counter() - began, "cpu": time.process_time() - used}
Path(sys.argv[2]).write_text(json.dumps(seconds))
"""


class Choice(DriveOptions):
    """Which drives are timed, and in how many turns."""

    sequences: tuple[str, ...] = ("institute", "office")
    seeds: tuple[int, ...] = (0,)
    turns: PositiveInt = 3


class Turn(DriveCase):
    """All programs once, one after another, on the same scans. `first` is measured in the first turn only, since
    installing compiles for a minute."""

    turn: int


class Timed(BaseModel):
    """Seconds of a process from its start to its end (`whole`), of the work in it without start, imports, reading the
    plan and the report (`inner`), and of the CPU in the latter (all threads)."""

    whole: float
    inner: float
    cpu: float


Measured = Annotated[Timed | None, "cost"]


class Times(Record):
    """The times of the programs (`PROGRAMS`)."""

    scans: int
    points: int
    load: Annotated[float, "cost"]
    warm: Measured
    cold: Measured
    first: Measured
    kiss_icp_pipeline: Measured
    kiss_icp: Measured
    small_gicp: Measured


def cases(options: Choice) -> list[Turn]:
    """The turns of each drive."""
    drives = options.drives()
    return [Turn(sequence=spec, seed=seed, turn=n) for spec, seed in drives for n in range(options.turns)]


def measure(case: Turn, work: Path) -> Times:
    """Runs all programs on a drive."""
    sequence = prepare(case.sequence, case.seed, work)
    sizes = [len(scan.points) for scan in ScanFolder(sequence.scan_dir)]
    _of_run(sequence, {})  # fills the caches of the building and of compiled loops
    with tempfile.TemporaryDirectory() as empty, tempfile.TemporaryDirectory() as bare:
        cold = {"SGSLAM_CACHE_DIR": empty}
        first = {"SGSLAM_CACHE_DIR": str(Path(bare, "plans")), "NUMBA_CACHE_DIR": str(Path(bare, "loops"))}
        return Times(
            scans=len(sizes), points=round(statistics.mean(sizes)), load=os.getloadavg()[0],
            kiss_icp_pipeline=_of_peer(_PIPELINE, sequence.scan_dir), warm=_of_run(sequence, {}),
            kiss_icp=_of_peer(_PEER, sequence.scan_dir, "kiss_icp"), cold=_of_run(sequence, cold),
            small_gicp=_of_peer(_PEER, sequence.scan_dir, "small_gicp"),
            first=None if case.turn else _of_run(sequence, first),
        )  # fmt: skip


def _of_run(sequence: Sequence, environment: dict[str, str]) -> Timed:
    """The time of `sgslam.run`, results and report included; `inner` is without the report."""
    with tempfile.TemporaryDirectory() as folder:
        files = ["--scan-dir", str(sequence.scan_dir.resolve()), "--bim", str(sequence.bim.resolve())]
        whole = _run([sys.executable, "-m", "sgslam.run", *files, "--out", "out"], folder, environment)
        metrics = json.loads(Path(folder, "out", "metrics.json").read_text())
    seconds = metrics["seconds"]
    return Timed(whole=whole, inner=seconds["total"], cpu=metrics["cpu_seconds"])


def _of_peer(script: str, scans: Path, *arguments: str) -> Timed:
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-c", script + _TIMED, str(scans.resolve()), "seconds", *arguments]
        whole = _run(words, folder, {})
        return Timed(whole=whole, **json.loads(Path(folder, "seconds").read_text()))


def _run(command: list[str], folder: str, environment: dict[str, str]) -> float:
    """The seconds of a command in a folder; modules are found as in this process."""
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    began = perf_counter()
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": paths, **environment},
    )  # fmt: skip
    if done.returncode:
        output = [line for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        raise UserError(f"a timed program failed: {output[-1].strip() if output else 'no message'}")
    return perf_counter() - began


def tables(rows: pd.DataFrame) -> Mapping[str, Any]:
    """A line for each program: scans a second over all drives, and times KISS-ICP's pipeline; and for each drive."""
    lines = [_line(rows, name, label) for name, label in PROGRAMS.items() if f"{name}.whole" in rows]
    rates = {name: _rates(rows, name) for name in ("warm", "cold")}
    return {
        "programs": pd.DataFrame(lines),
        "drives": grouped(rows, ("sequence.name", "scans"), _of_drive).rename(columns={"sequence.name": "drive"}),
        "scans-a-second": _range(rates["warm"]), "scans-a-second-cold": _range(rates["cold"]),
        "inner-times": spread(_ratio(rows, "warm", "inner"), ".1f"),
        "points": f"{rows.points.median():,.0f}",
        "first-seconds": _range(rows["first.whole"].dropna()),
        "warm-seconds": _range(rows.groupby("sequence.name")["warm.whole"].median()),
    }  # fmt: skip


def _line(rows: pd.DataFrame, name: str, label: str) -> dict[str, str]:
    rates = _rates(rows, name)
    ratios = {what: _ratio(rows, name, what).dropna() for what in ("whole", "inner", "cpu")}
    return {
        "program": label, "runs": str(rows[f"{name}.whole"].notna().sum()),
        "scans a second, whole process": _range(rates),
        "process, times KISS-ICP's": f"{ratios['whole'].median():.2f}",
        "work alone, times KISS-ICP's": f"{ratios['inner'].median():.2f}",
        "its CPU, times KISS-ICP's": f"{ratios['cpu'].median():.2f}",
    }  # fmt: skip


def _of_drive(own: pd.DataFrame) -> dict[str, str]:
    names = [name for name in PROGRAMS if f"{name}.whole" in own]
    return {f"{PROGRAMS[name]} (s)": f"{own[f'{name}.whole'].median():.1f}" for name in names}


def _rates(rows: pd.DataFrame, name: str) -> "pd.Series[float]":
    """Scans a second of the whole process, the median of each drive."""
    return (rows.scans / rows[f"{name}.whole"]).groupby(rows["sequence.name"]).median().dropna()


def _ratio(rows: pd.DataFrame, name: str, what: str) -> "pd.Series[float]":
    """Times KISS-ICP's own pipeline in the same turn."""
    return rows[f"{name}.{what}"] / rows[f"kiss_icp_pipeline.{what}"]


def _range(rates: "pd.Series[float]") -> str:
    ends = dict.fromkeys(f"{rate:.0f}" for rate in (rates.min(), rates.max())) if len(rates) else {}
    return " to ".join(ends)


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How fast a whole run is."""
    ratio, n = _ratio(rows, "warm", "whole"), f"{len(rows)} turns on {rows['sequence.name'].nunique()} drives"
    times = spread(ratio, ".2f")
    rate = _range(_rates(rows, "warm"))
    points = f"{rows.points.median():.0f}"
    return [
        Claim(f"Scans a second of a whole run, start and report included (scans of {points} points)", rate, n),
        Claim("Time of the whole process, times that of KISS-ICP's own pipeline (median, least, most)", times, n),
    ]


STUDY = Study(
    "timing", "how long a whole run takes beside KISS-ICP and small_gicp", Choice,
    Choice(sequences=("demo",), turns=1), Turn, Times, cases, measure, tables, claims, timed=True,
)  # fmt: skip
