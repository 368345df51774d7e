"""The jobs of `sgslam batch`: each is a run in a process of its own, and its folder says how it stands."""

import csv
import io
import os
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.common.children import may_have_children, run_isolated
from data.common.errors import UserError
from data.common.files import text_lines, write_json
from data.common.json_files import read_json

COLUMNS = ("scans", "plan", "out", "flags")
RESULTS = (
    "scans_of", "plan", "out", "status", "reason", "scans", "scans_skipped", "anchored_share", "first_anchor_s",
    "rmse_bim_m", "seconds",
)  # fmt: skip
RECORD = "job.json"  # in a job's folder: its command and its exit code, null until it has ended
NOT_ENOUGH = 3  # the exit code of a run that is not anchored as `--strict` demands
_DONE = (0, NOT_ENOUGH)  # exit codes of a run that has written its results


@dataclass(frozen=True)
class Job:
    """A line of the list: `sgslam run` is called in `folder` with these arguments, and writes to `out`."""

    folder: Path
    scans: str
    plan: str
    out: Path
    flags: tuple[str, ...] = ()

    @property
    def arguments(self) -> tuple[str, ...]:
        """Those of `sgslam run`."""
        plan = ("--bim", self.plan) if self.plan else ()
        return ("--scan-dir", self.scans, *plan, "--out", str(self.out), *self.flags)

    @property
    def is_too_little(self) -> bool:
        """Whether the run ended without what its `--strict` demands."""
        return self._record().get("code") == NOT_ENOUGH

    def is_done(self) -> bool:
        """Whether this very command has ended with results."""
        record = self._record()
        return record.get("arguments") == list(self.arguments) and record.get("code") in _DONE

    def can_resume(self) -> bool:
        """Whether this very command was interrupted, and left a state."""
        record = self._record()
        begun = record.get("arguments") == list(self.arguments) and record.get("code") is None
        return begun and (self.out / "state.npz").is_file()

    def note(self, code: int | None, error: str = "") -> None:
        """Writes how the job stands into its folder."""
        self.out.mkdir(parents=True, exist_ok=True)
        write_json(self.out / RECORD, {"arguments": self.arguments, "code": code, "error": error})

    def result(self) -> dict[str, Any]:
        """The row of the summary, with the names in `RESULTS`."""
        record, metrics = self._record(), {}
        if record.get("code") in _DONE:
            metrics = read_json(self.out / "metrics.json", "a finished run")
        from sgslam.report.tables import badge

        return {
            "scans_of": self.scans, "plan": self.plan, "out": str(self.out),
            "status": badge(metrics) if metrics else "failed",
            "reason": metrics.get("reason") or record.get("error") or "",
            **{name: metrics.get(name) for name in RESULTS[5:9]},
            "rmse_bim_m": (metrics.get("accuracy") or {}).get("rmse_bim_m"),
            "seconds": (metrics.get("seconds") or {}).get("total"),
        }  # fmt: skip

    def _record(self) -> dict[str, Any]:
        path = self.out / RECORD
        found = read_json(path, "a job") if path.is_file() else {}
        return found if isinstance(found, dict) else {}


def read_jobs(path: Path) -> list[Job]:
    """The jobs of a CSV file with the columns scans, plan, out and flags, of which only scans is required; its paths
    are relative to its folder. Raises UserError for other columns, a line without scans, and two jobs of one folder."""
    lines = csv.DictReader(
        io.StringIO("\n".join(text_lines(path, "a CSV file of jobs")).lstrip("\ufeff")), skipinitialspace=True
    )
    if unknown := {*(lines.fieldnames or ())} - {*COLUMNS}:
        raise UserError(f"{path}: unknown column '{min(map(str, unknown))}'; the columns are {', '.join(COLUMNS)}")
    jobs: dict[Path, Job] = {}
    folder = path.resolve().parent
    for line in lines:
        where = f"{path}, line {lines.line_num}"
        scans, plan, out = ((line.get(name) or "").strip() for name in COLUMNS[:3])
        if not scans or None in line:
            lack = (
                "more values than columns; put flags that have commas in quotes"
                if None in line
                else "scans are missing"
            )
            raise UserError(f"{where}: {lack}")
        try:
            flags = shlex.split(line.get("flags") or "")
        except ValueError as error:
            raise UserError(f"{where}: flags: {str(error).lower()}") from None
        results = folder / (out or f"{path.stem}_runs/{Path(scans).name}")
        if results in jobs:
            raise UserError(f"{where}: {results} is the folder of an earlier job too; give each its own 'out'")
        jobs[results] = Job(folder, scans, plan, results, tuple(flags))
    if not jobs:
        raise UserError(f"{path}: has no jobs; give a header ({','.join(COLUMNS)}) and a line for each")
    return list(jobs.values())


def run_job(job: Job) -> None:
    """Runs a job, or resumes it, in a process of its own that ends with this one; notes in its folder how it ended."""
    may_have_children()  # a worker of Dask is a daemon
    arguments = ("--resume", str(job.out)) if job.can_resume() else job.arguments
    job.note(None)
    try:
        job.note(run_isolated(_run, job.folder, arguments, job.out, what=f"{job.out}"))
    except UserError as error:
        job.note(2, str(error))


def _run(folder: Path, arguments: tuple[str, ...], out: Path) -> int:
    """`sgslam run`, with what it prints in `run.out`."""
    from sgslam.cli.command import call

    os.chdir(folder)
    with (out / "run.out").open("a") as printed:
        os.dup2(printed.fileno(), sys.stdout.fileno())
        os.dup2(printed.fileno(), sys.stderr.fileno())
    try:
        return call(["run", *arguments]) or 0
    except SystemExit:  # of the parser, whose line is in the file
        raise UserError((out / "run.out").read_text().splitlines()[-1]) from None
