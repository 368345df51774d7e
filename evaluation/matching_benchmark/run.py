"""The matching benchmark: matchers on plans and S-graphs with known truth.

    python -m evaluation.matching_benchmark.run --out DIR

Methods x regimes x plans x rooms seen. Every match is a line in DIR/rows.jsonl; lines that exist already are skipped,
so that an interrupted run can be repeated. Tables and plots are made from the rows alone.
"""

import json
import shlex
import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from time import monotonic

from data.common.cli import Parser, run_command
from data.common.cluster import add_options
from data.common.errors import UserError
from data.common.files import write_atomically
from evaluation.harness.benchmark_page import machine, write_section

ROOMS = ["1", "2", "3", "4", "6", "9", "14", "all"]
COMMANDS = "commands.jsonl"
PROGRESS_EVERY_S = 10.0


def main(arguments: list[str] | None = None) -> int:
    """The command line. Raises UserError."""
    options = _parser().parse_args(arguments)
    out: Path = options.out
    if not options.report_only:
        _run(options, sys.argv[1:] if arguments is None else arguments)
    _report(out, options.page, options.section)
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog="python -m evaluation.matching_benchmark.run", description="Measure matchers on maps with known truth."
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for rows, tables and plots")
    parser.add_argument("--plans", type=Path, nargs="+", default=[], metavar="PATH", help="plans in any known format")
    parser.add_argument("--generated", nargs="+", default=[], metavar="KIND:COUNT[:SKIPPED]", help="generated plans")
    parser.add_argument("--slam-graphs", type=Path, metavar="DIR", help="maps made by evaluation.drives.slam_graphs")
    parser.add_argument(
        "--methods", nargs="+", default=["learned", "voting", "oracle"], metavar="NAME",
        help="learned, voting, oracle, ...",
    )  # fmt: skip
    parser.add_argument("--regimes", nargs="+", metavar="NAME", help="regimes of the S-graphs (default: all)")
    parser.add_argument("--rooms", nargs="+", default=ROOMS, metavar="N", help="rooms seen, or 'all'")
    parser.add_argument(
        "--sizes", nargs="+", default=["small", "large"], metavar="SIZE", help="small plans, large, or both"
    )
    parser.add_argument("--pairs", type=int, default=100, metavar="N", help="pairs per cell (default 100)")
    parser.add_argument("--pairs-of", nargs="+", default=[], metavar="METHOD:N", help="fewer pairs for a slow method")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--limit", type=float, default=60.0, metavar="S", help="time limit per pair (default 60)")
    add_options(parser, "--jobs", "processes of one thread each (default 1)")
    parser.add_argument("--report-only", action="store_true", help="only write tables and plots of existing rows")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page of results; its section is written")
    parser.add_argument("--section", default="matching", metavar="NAME", help="section of the page (default: matching)")
    return parser


def _run(options: object, arguments: Sequence[str]) -> None:
    """Runs the matches that are missing."""
    from evaluation.matching_benchmark.rows import FILE, appending, read_rows
    from evaluation.matching_benchmark.tasks import BenchmarkOptions, tasks_of
    from evaluation.matching_benchmark.worker import run_tasks

    wanted = BenchmarkOptions.of(options)
    path = wanted.out / FILE
    tasks = tasks_of(wanted, {r.key for r in read_rows(path)})
    total = sum(len(t.methods) for t in tasks)
    print(f"{total} matches to make", flush=True)
    if total:
        _remember(wanted.out, arguments)
    began = printed = monotonic()
    with appending(path) as append:
        for done, row in enumerate(run_tasks(tasks, wanted.jobs, wanted.limit_s, wanted.scheduler), 1):
            append(row)
            if monotonic() - printed > PROGRESS_EVERY_S or done == total:
                printed = monotonic()
                left = (printed - began) / done * (total - done) / 60
                where = f"{row.regime} {row.plan}, {row.rooms or 'all'} rooms, {row.method}: {row.status}"
                print(f"{done}/{total} {where}; about {left:.0f} min left", flush=True)


def _remember(out: Path, arguments: Sequence[str]) -> None:
    """Appends the command to the list of commands, once, before the first row."""
    line = {
        "command": shlex.join(["python", "-m", "evaluation.matching_benchmark.run", *arguments]),
        "machine": machine(),
    }
    path = out / COMMANDS
    before = path.read_text().splitlines(keepends=True) if path.exists() else []
    entry = json.dumps(line | {"date": date.today().isoformat()}) + "\n"
    out.mkdir(parents=True, exist_ok=True)
    if entry not in before:
        write_atomically(path, "".join([*before, entry]))


def _report(out: Path, page: Path | None, section: str) -> None:
    from evaluation.matching_benchmark.plots import write_plots
    from evaluation.matching_benchmark.rows import FILE, read_rows
    from evaluation.matching_benchmark.tables import full_tables, latex, markdown, tables

    rows = read_rows(out / FILE)
    if not rows:
        raise UserError(f"{out / FILE}: no rows; run the benchmark without --report-only first")
    made = _made(out)
    short, full = tables(rows), full_tables(rows)
    text = "\n".join(map(markdown, short)) + made
    write_atomically(out / "table.md", text)
    write_atomically(out / "table_full.md", "\n".join(map(markdown, full)) + made)
    write_atomically(out / "table.tex", "\n".join([*map(latex, short), *map(latex, full)]))
    write_plots(rows, out)
    if page is not None:
        notes = [note for methods, note in NOTES.items() if {r.method for r in rows}.intersection(methods)]
        title = "## Matching" if section == "matching" else f"## Matching: {section.replace('-', ' ')}"
        write_section(page, section, f"{title}\n\n{' '.join([INTRODUCTION, *notes])}\n\n{text}")
    print(text)


def _made(out: Path) -> str:
    path = out / COMMANDS
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    return "".join(f"\n- `{v['command']}` on {v['machine']}, {v['date']}" for v in lines) + "\n"


INTRODUCTION = (
    "A pair is an S-graph and the plan in which it is to be found. The S-graph is drawn from a plan by a regime: "
    "`paper` (the published perturbation), `real` (a connected set of rooms, with the noise of real scans, walls "
    "missing, in pieces, and clutter), `drift` (and the map bends), `mis_segmented` (and rooms are badly cut), "
    "`heavy_drift` (drift three times as wide), `negative` "
    "(`real`, from another building: every `unique` answer is wrong). `oracle` is given the true place and does the "
    "rest as `voting` does: what is missing to 1 there no matcher of this kind can know."
)

NOTES = {
    ("pca-gm", "superglue"): "`pca-gm` and `superglue` are networks by these ideas on our features, trained by the "
    "same command for fewer than 1000 steps each and still getting better when they were stopped; their own assignment "
    "is the answer, unchecked.",
    ("combinatorial", "combinatorial-grid"): "`combinatorial` is the search of iS-Graphs, which only answers whole "
    "maps that agree with the plan.",
}


if __name__ == "__main__":
    run_command(main)
