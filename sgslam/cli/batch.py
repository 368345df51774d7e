"""`sgslam batch JOBS.csv`: many runs, on this machine or on a Dask cluster, with one page on all of them.

Each job is a run in a process of its own, and its folder says how it stands.
"""

import csv
import io
import os
import shlex
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from data.common.cli import Parser, add_workers, called_as, run_command
from data.common.errors import UserError
from data.common.files import read_json, text_lines, write_atomically, write_csv, write_json
from data.common.processes import completed, may_have_children, run_isolated
from sgslam.cli.execute import NOT_ENOUGH, execute, run_parser
from sgslam.cli.options import RunOptions

COLUMNS = ("scans", "plan", "out", "flags")
RECORD = "job.json"  # in a job's folder: what it is told and its exit code, null until it has ended
_DONE = (0, NOT_ENOUGH)  # exit codes of a run that has written its results


@dataclass(frozen=True)
class Job:
    """A line of the list: a run in `folder`, which the paths of its options are relative to."""

    folder: Path
    out: Path
    options: RunOptions

    @property
    def told(self) -> dict[str, str]:
        """The options that are given, in JSON form."""
        return {name: str(value) for name, value in self.options.changed().items()}

    def record(self) -> dict[str, Any]:
        """What the folder says of this very job; empty before it has begun."""
        path = self.out / RECORD
        found = read_json(path, "a job") if path.is_file() else {}
        return found if isinstance(found, dict) and found.get("told") == self.told else {}

    def is_done(self) -> bool:
        """Whether it has ended with results."""
        return self.record().get("code") in _DONE

    def note(self, code: int | None, error: str = "") -> None:
        """Writes how the job stands into its folder."""
        self.out.mkdir(parents=True, exist_ok=True)
        write_json(self.out / RECORD, {"told": self.told, "code": code, "error": error})

    def result(self) -> dict[str, Any]:
        """The row of the summary by its columns."""
        from sgslam.report.tables import badge

        metrics = read_json(self.out / "metrics.json", "a finished run") if self.is_done() else {}
        return {
            "scans_of": self.options.scan_dir,
            "plan": self.options.bim or "",
            "out": str(self.out),
            "status": badge(metrics) if metrics else "failed",
            "reason": metrics.get("reason") or self.record().get("error") or "",
            **{name: metrics.get(name) for name in ("scans", "scans_skipped", "anchored_share", "first_anchor_s")},
            "rmse_bim_m": (metrics.get("accuracy") or {}).get("rmse_bim_m"),
            "seconds": (metrics.get("seconds") or {}).get("total"),
        }


def read_jobs(path: Path) -> list[Job]:
    """The jobs of a CSV file with the columns scans, plan, out and flags, of which only scans is required; its paths
    are relative to its folder. Raises UserError for other columns, a line without scans or with unknown flags, and two
    jobs of one folder."""
    text = "\n".join(text_lines(path, "a CSV file of jobs")).lstrip("\ufeff")
    lines = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    if unknown := {*(lines.fieldnames or ())} - {*COLUMNS}:
        raise UserError(f"{path}: unknown column '{min(map(str, unknown))}'; the columns are {', '.join(COLUMNS)}")
    jobs: dict[Path, Job] = {}
    folder = path.resolve().parent
    with called_as("sgslam run"):  # whose help lists the flags
        parser = run_parser()
    for line in lines:
        where = f"{path}, line {lines.line_num}"
        if None in line:
            raise UserError(f"{where}: more values than columns; put flags that have commas in quotes")
        scans, plan, out, flags = ((line.get(name) or "").strip() for name in COLUMNS)
        if not scans:
            raise UserError(f"{where}: scans are missing")
        try:
            options = RunOptions.of(parser.parse_args(shlex.split(flags)))
        except (ValueError, UserError) as error:
            raise UserError(f"{where}: flags: {error}") from None
        results = folder / (out or f"{path.stem}_runs/{Path(scans).name}")
        if results in jobs:
            raise UserError(f"{where}: {results} is the folder of an earlier job too; give each its own 'out'")
        options = replace(options, scan_dir=Path(scans), bim=Path(plan) if plan else options.bim, out=results)
        jobs[results] = Job(folder, results, options)
    if not jobs:
        raise UserError(f"{path}: has no jobs; give a header ({','.join(COLUMNS)}) and a line for each")
    return list(jobs.values())


def run_job(job: Job) -> None:
    """Runs a job, or resumes it, in a process of its own that ends with this one; notes in its folder how it ended."""
    may_have_children()  # a worker of Dask is a daemon
    begun = job.record()
    options = job.options
    if begun and begun.get("code") is None and (job.out / "state.bin").is_file():
        from sgslam.session.checkpoints import read_run

        if not read_run(job.out)[0].get("finished"):  # else only the note of its end is missing
            options = RunOptions(resume=job.out, strict=job.options.strict)
    job.note(None)
    try:
        job.note(run_isolated(_run, job.folder, options, job.out, what=f"{job.out}"))
    except UserError as error:
        job.note(2, str(error))


def _run(folder: Path, options: RunOptions, out: Path) -> int:
    """With what it prints in `run.out`."""
    os.chdir(folder)
    with (out / "run.out").open("a") as printed:
        os.dup2(printed.fileno(), sys.stdout.fileno())
        os.dup2(printed.fileno(), sys.stderr.fileno())
    return execute(options)


def _write_summary(path: Path, results: list[dict[str, Any]]) -> tuple[Path, Path]:
    """Writes the page and the table of all jobs beside the list; returns their paths."""
    from sgslam.report.html_page import TEMPLATES

    page, table = (path.with_name(f"{path.stem}_results{suffix}") for suffix in (".html", ".csv"))
    links = [os.path.relpath(Path(result["out"]) / "report.html", page.parent) for result in results]
    template = TEMPLATES.get_template("report/batch.html")
    write_atomically(page, template.render(name=path.name, results=results, links=links))
    write_csv(table, [results[0], *(result.values() for result in results)])
    return page, table


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 1 if a job failed, else 3 if one is not what its `--strict` demands. Raises UserError."""
    about = "Run many jobs, and summarise them in JOBS_results.html and .csv beside the list. Jobs that are done are "
    about += "skipped, interrupted ones are resumed. Exit code 1 if a job failed."
    parser = Parser(prog="python -m sgslam.cli.batch", description=about)
    about = "CSV with the columns scans, plan, out, flags (further options of 'sgslam run'); only scans is required, "
    about += "paths are relative to the list; see docs/batch.md"
    parser.add_argument("list", type=Path, metavar="JOBS.csv", help=about)
    add_workers(parser, "--jobs", "number of processes (default: 1)")
    options = parser.parse_args(arguments)
    if options.jobs < 1:
        raise UserError(f"--jobs {options.jobs}: must be at least 1")
    jobs = read_jobs(options.list)
    todo = [job for job in jobs if not job.is_done()]
    print(f"{options.list}: {len(jobs)} jobs, {len(todo)} to run", flush=True)
    for number, (job, outcome) in enumerate(completed(run_job, todo, options.jobs, options.scheduler), 1):
        if isinstance(outcome, BaseException):  # its worker died, more often than Dask tries again
            job.note(2, str(outcome) or type(outcome).__name__)
        result = job.result()
        print(f"{number}/{len(todo)} {job.out}: {result['status']}: {result['reason']}", flush=True)
        _write_summary(options.list, [job.result() for job in jobs if job.record()])
    results = [job.result() for job in jobs]
    page, table = _write_summary(options.list, results)
    failed = [result["out"] for result in results if result["status"] == "failed"]
    print(f"summary: {page}, {table}" + "".join(f"\nfailed: {out}" for out in failed))
    too_little = [str(job.out) for job in jobs if job.record().get("code") == NOT_ENOUGH]
    print("".join(f"not enough for --strict: {out}\n" for out in too_little), end="")
    return 1 if failed else NOT_ENOUGH if too_little else 0


if __name__ == "__main__":
    run_command(main)
