"""`sgslam batch JOBS.csv`: many runs, on this machine or on a Dask cluster, with one page on all of them."""

import csv
import io
import os
import shlex
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.common.children import may_have_children, run_isolated
from data.common.cli import Parser, add_workers, run_command
from data.common.cluster import completed
from data.common.errors import UserError
from data.common.files import text_lines, write_atomically, write_json
from data.common.json_files import read_json

COLUMNS = ("scans", "plan", "out", "flags")
RESULTS = (
    "out", "status", "reason", "scans", "scans_skipped", "anchored_share", "first_anchor_s", "rmse_bim_m", "seconds",
)  # fmt: skip
RECORD = "job.json"  # in a job's folder: its command and its exit code, null until it has ended
_DONE = (0, 3)  # exit codes of a run that has written its results


@dataclass(frozen=True)
class Job:
    """A line of the list: the arguments of `sgslam run`, which is called in `folder`, and the folder of its results."""

    folder: Path
    arguments: tuple[str, ...]
    out: Path

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
            "out": str(self.out), "status": badge(metrics) if metrics else "failed",
            "reason": metrics.get("reason") or record.get("error") or "",
            **{name: metrics.get(name) for name in RESULTS[3:7]},
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
    lines = csv.DictReader(io.StringIO("\n".join(text_lines(path, "a CSV file of jobs"))), skipinitialspace=True)
    if unknown := {*(lines.fieldnames or ())} - {*COLUMNS}:
        raise UserError(f"{path}: unknown column '{min(map(str, unknown))}'; the columns are {', '.join(COLUMNS)}")
    jobs: dict[Path, Job] = {}
    folder = path.resolve().parent
    for line in lines:
        where = f"{path}, line {lines.line_num}"
        scans, plan, out = ((line.get(name) or "").strip() for name in COLUMNS[:3])
        if not scans or None in line:
            raise UserError(f"{where}: {'more values than columns' if None in line else 'scans are missing'}")
        try:
            flags = shlex.split(line.get("flags") or "")
        except ValueError as error:
            raise UserError(f"{where}: flags: {str(error).lower()}") from None
        results = folder / (out or f"{path.stem}_runs/{Path(scans).name}")
        if results in jobs:
            raise UserError(f"{where}: {results} is the folder of an earlier job too; give each its own 'out'")
        arguments = ("--scan-dir", scans, *(("--bim", plan) if plan else ()), "--out", str(results), *flags)
        jobs[results] = Job(folder, arguments, results)
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
    from sgslam.run import main

    os.chdir(folder)
    with (out / "run.out").open("a") as printed:
        os.dup2(printed.fileno(), sys.stdout.fileno())
        os.dup2(printed.fileno(), sys.stderr.fileno())
    try:
        return main(list(arguments))
    except SystemExit:  # of the parser, whose line is in the file
        raise UserError((out / "run.out").read_text().splitlines()[-1]) from None


def _write_summary(path: Path, results: list[dict[str, Any]]) -> tuple[Path, Path]:
    """Writes the page and the table of all jobs beside the list; returns their paths."""
    from sgslam.report.html_page import TEMPLATES

    page, table = (path.with_name(f"{path.stem}_results{suffix}") for suffix in (".html", ".csv"))
    links = [os.path.relpath(Path(result["out"]) / "report.html", page.parent) for result in results]
    template = TEMPLATES.get_template("report/batch.html")
    write_atomically(page, template.render(name=path.name, results=results, links=links))
    text = io.StringIO()
    writer = csv.DictWriter(text, RESULTS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(results)
    write_atomically(table, text.getvalue())
    return page, table


def _progress(jobs: list[Job], options: Any) -> Iterator[Job]:
    """Runs the jobs, and yields each that has ended."""
    for job, outcome in completed(run_job, jobs, options.jobs, options.scheduler):
        if isinstance(outcome, BaseException):  # its worker died, more often than Dask tries again
            job.note(2, str(outcome) or type(outcome).__name__)
        yield job


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 1 if a job failed. Raises UserError."""
    parser = Parser(prog="python -m sgslam.cli.batch", description="Run many jobs, and summarise them on one page.")
    about = "CSV with the columns scans, plan, out, flags (further options of 'sgslam run'); only scans is required"
    parser.add_argument("list", type=Path, metavar="JOBS.csv", help=about)
    add_workers(parser, "--jobs", "number of processes (default: 1)")
    options = parser.parse_args(arguments)
    if options.jobs < 1:
        raise UserError(f"--jobs {options.jobs}: must be at least 1")
    jobs = read_jobs(options.list)
    todo = [job for job in jobs if not job.is_done()]
    print(f"{options.list}: {len(jobs)} jobs, {len(todo)} to run", flush=True)
    for number, job in enumerate(_progress(todo, options), 1):
        result = job.result()
        print(f"{number}/{len(todo)} {job.out}: {result['status']}: {result['reason']}", flush=True)
        _write_summary(options.list, [job.result() for job in jobs if (job.out / RECORD).is_file()])
    results = [job.result() for job in jobs]
    page, table = _write_summary(options.list, results)
    failed = [result["out"] for result in results if result["status"] == "failed"]
    print(f"summary: {page}, {table}" + "".join(f"\nfailed: {out}" for out in failed))
    return 1 if failed else 0


if __name__ == "__main__":
    run_command(main)
