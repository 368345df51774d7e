"""`sgslam batch JOBS.csv`: many runs, on this machine or on a Dask cluster, with one page on all of them."""

import csv
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from data.common.cli import Parser, add_workers, run_command
from data.common.cluster import completed
from data.common.errors import UserError
from data.common.files import write_atomically
from sgslam.cli.batch_jobs import NOT_ENOUGH, RECORD, RESULTS, Job, read_jobs, run_job


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
    """The command; returns 1 if a job failed, else 3 if one is not what its `--strict` demands. Raises UserError."""
    parser = Parser(
        prog="python -m sgslam.cli.batch",
        description=(
            "Run many jobs, and summarise them in JOBS_results.html and .csv beside the list. Jobs that are done are "
            "skipped, interrupted ones are resumed. Exit code 1 if a job failed."
        ),
    )
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
    for number, job in enumerate(_progress(todo, options), 1):
        result = job.result()
        print(f"{number}/{len(todo)} {job.out}: {result['status']}: {result['reason']}", flush=True)
        _write_summary(options.list, [job.result() for job in jobs if (job.out / RECORD).is_file()])
    results = [job.result() for job in jobs]
    page, table = _write_summary(options.list, results)
    failed = [result["out"] for result in results if result["status"] == "failed"]
    print(f"summary: {page}, {table}" + "".join(f"\nfailed: {out}" for out in failed))
    too_little = [str(job.out) for job in jobs if job.is_too_little]
    print("".join(f"not enough for --strict: {out}\n" for out in too_little), end="")
    return 1 if failed else NOT_ENOUGH if too_little else 0


if __name__ == "__main__":
    run_command(main)
