"""`python -m evaluation.published.tables --out DIR`: the published matcher's tables, with the results of other methods.

First the published perturbation, also with an unknown start, then maps built by SLAM. Every match is a line in
DIR/rows.jsonl; lines that exist already are skipped. Tables and the figure are made from the rows alone.
"""

import json
import shlex
import sys
from datetime import date
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically
from evaluation.harness.benchmark_page import machine, write_section

if TYPE_CHECKING:
    from evaluation.matching_benchmark.pairs import Pair
    from evaluation.matching_benchmark.worker import Task

METHODS = ["combinatorial", "paper@published", "paper@repository", "voting", "learned"]
SLOW = ("combinatorial",)
REAL_ROOMS: tuple[int | None, ...] = (2, 4, 6, None)
COMMANDS = "commands.jsonl"
PROGRESS_EVERY_S = 10.0


def main(arguments: list[str] | None = None) -> int:
    """The command line. Raises UserError."""
    given = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(given)
    if not options.report_only:
        _run(options, given)
    _report(options)
    return 0


def _parser() -> Parser:
    parser = Parser(prog="python -m evaluation.published.tables", description="Reproduce the published tables.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for rows.jsonl and tables.md")
    parser.add_argument("--msd", type=Path, metavar="DIR", help="apartments of Modified Swiss Dwellings as JSON")
    parser.add_argument("--pairs", type=int, default=100, metavar="N", help="pairs per cell of --msd (default 100)")
    parser.add_argument("--generated", type=int, default=0, metavar="N", help="generated apartments, one pair each")
    parser.add_argument("--se2", type=Path, metavar="FILE", help="a known map, see evaluation.published.se2_subsets")
    parser.add_argument("--slam-graphs", type=Path, metavar="DIR", help="maps made by evaluation.drives.slam_graphs")
    parser.add_argument("--methods", nargs="*", default=METHODS, metavar="NAME")
    parser.add_argument(
        "--ablation",
        nargs="+",
        default=[],
        metavar="NAME=FILE",
        help="networks of matching.published.train",
    )
    parser.add_argument(
        "--slow-pairs", type=int, default=25, metavar="N", help="pairs of combinatorial in the first table (default 25)"
    )
    parser.add_argument("--limit", type=float, default=60.0, metavar="S", help="time limit per pair (default 60)")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes of one thread each (default 1)")
    parser.add_argument("--report-only", action="store_true", help="only write the tables of existing rows")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page of results; its section 'published' is written")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="SVG file for F1 with an unknown start")
    return parser


def _run(options: Any, given: list[str]) -> None:
    from evaluation.matching_benchmark.rows import FILE, appending, read_rows
    from evaluation.matching_benchmark.worker import run_tasks

    for name, value in (("pairs", options.pairs), ("limit", options.limit), ("jobs", options.jobs)):
        if not value > 0:
            raise UserError(f"--{name} {value:g}: must be more than 0")
    methods = _methods(options)
    path = options.out / FILE
    tasks = _tasks(options, methods, {r.key for r in read_rows(path)})
    total = sum(len(t.methods) for t in tasks)
    print(f"{total} matches to make", flush=True)
    if total:
        _remember(options.out, given)
    began = printed = monotonic()
    with appending(path) as append:
        for done, row in enumerate(run_tasks(tasks, options.jobs, options.limit), 1):
            append(row)
            if monotonic() - printed > PROGRESS_EVERY_S or done == total:
                printed = monotonic()
                left = (printed - began) / done * (total - done) / 60
                print(f"{done}/{total} {row.regime} {row.plan}, {row.method}: {row.status}; about {left:.0f} min left")


def _methods(options: Any) -> tuple[str, ...]:
    """The networks of the ablation; loads all methods once, so that mistakes are reported before anything runs."""
    from matching import Matcher

    networks = []
    for text in options.ablation:
        name, _, file = text.partition("=")
        if not name or not file:
            raise UserError(f"--ablation {text}: write NAME=FILE")
        networks.append(f"paper@{file}")
    for method in (*options.methods, *networks):
        Matcher.load(method)
    return tuple(networks)


def _tasks(options: Any, networks: tuple[str, ...], there: set[tuple[Any, ...]]) -> list["Task"]:
    from evaluation.matching_benchmark.pairs import SGSLAM
    from evaluation.matching_benchmark.tasks import key_of
    from evaluation.matching_benchmark.worker import Task
    from evaluation.published.pairs import SE2, MovedPair

    tasks = []
    for cell in _cells(options):
        for n, pair in enumerate(cell):
            plain = pair.regime == "paper"
            in_tables = pair.regime != "real" and not isinstance(pair, MovedPair)
            few = in_tables and (n < options.slow_pairs or pair.regime in (SE2, SGSLAM))
            wanted = [m for m in options.methods if m not in SLOW or few]
            wanted += networks if plain else ()
            missing = tuple(m for m in wanted if key_of(pair, m) not in there)
            if missing:
                tasks.append(Task(pair, missing))
    return tasks


def _cells(options: Any) -> list[list["Pair"]]:
    from evaluation.matching_benchmark.pairs import pairs_of_cell, slam_pairs
    from evaluation.published import pairs as of

    cells: list[list[Pair]] = []
    if options.msd is not None:
        drawn = pairs_of_cell(of.published_candidates(options.msd), "paper", None, options.pairs, options.seed)
        cells += [of.with_starts(drawn)]
        cells += [of.real_pairs(options.msd, [rooms], options.pairs, options.seed) for rooms in REAL_ROOMS]
    if options.generated:
        candidates = of.generated_candidates(options.generated)
        cells.append(list(pairs_of_cell(candidates, "paper", None, options.generated, options.seed)))
    if options.se2 is not None:
        cells.append(of.known_map_pairs(options.se2))
    if options.slam_graphs is not None:
        cells.append(list(slam_pairs(options.slam_graphs)))
    if not cells:
        raise UserError("nothing to match: give --msd, --generated, --se2 or --slam-graphs")
    return cells


def _remember(out: Path, given: list[str]) -> None:
    command = shlex.join(["python", "-m", "evaluation.published.tables", *given])
    path = out / COMMANDS
    before = path.read_text().splitlines(keepends=True) if path.exists() else []
    entry = json.dumps({"command": command, "machine": machine(), "date": date.today().isoformat()}) + "\n"
    out.mkdir(parents=True, exist_ok=True)
    if entry not in before:
        write_atomically(path, "".join([*before, entry]))


def _report(options: Any) -> None:
    from evaluation.matching_benchmark.rows import FILE, read_rows
    from evaluation.published.page import page_of

    rows = read_rows(options.out / FILE)
    if not rows:
        raise UserError(f"{options.out / FILE}: no rows; run it without --report-only first")
    networks = [(name, file) for name, _, file in (text.partition("=") for text in options.ablation)]
    names = {f"paper@{file}": name for name, file in networks}
    path = options.out / COMMANDS
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    made = "".join(f"\n- `{v['command']}` on {v['machine']}, {v['date']}" for v in lines)
    made += "".join(f"\n- {name}: `{_trained_by(Path(file))}`" for name, file in networks)
    text = page_of(rows, names, options.figure) + made + "\n"
    write_atomically(options.out / "tables.md", text)
    if options.figure is not None:
        from evaluation.published.plot import write_collapse

        write_collapse(rows, options.figure)
    if options.page is not None:
        write_section(options.page, "published", text)
    print(text)


def _trained_by(file: Path) -> str:
    """The training command in a network's model card."""
    card = file.with_name("model_card.json")
    return str(json.loads(card.read_text())["command"]) if card.exists() else file.name


if __name__ == "__main__":
    run_command(main)
