"""Ablation of the SLAM system: sequences x seeds x variants, with tables and plots.

    python -m evaluation.slam_ablation.run --out DIR

Each run is a row of a CSV. Rows that exist already are skipped, so that an interrupted command can be repeated.
"""

import argparse
import shlex
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from data.common.cli import Parser, run_command
from data.common.cluster import add_options
from data.common.errors import UserError
from data.common.files import write_atomically
from evaluation.harness import (
    Conditions,
    SequenceSpec,
    prepare,
    read_records,
    read_specs,
    select_sequences,
    write_records,
)
from evaluation.drives.conditions import NORMAL
from evaluation.slam_ablation.rows import COLUMNS, KEY, Record, Records
from evaluation.slam_ablation.variants import VARIANTS, WITHOUT_BIM, check_variant
from evaluation.slam_ablation.worker import Answer, Task, run_in_process, run_on_worker

DEMO = [SequenceSpec("demo", "demo", min_rooms=6, min_length=50.0)]


def ablate(
    specs: list[SequenceSpec], seeds: list[int], variants: list[str], out: Path, conditions: Conditions = NORMAL,
    jobs: int = 1, listed_in: Path | None = None, scheduler: str | None = None,
) -> Records:  # fmt: skip
    """Runs what `out`/runs.csv lacks and returns all of its records.

    Each run has a process of its own, here or on the workers of the cluster `scheduler`. `listed_in` is the file that
    lists the sequences, for the rows' commands. Raises UserError as a run and `data.common.cluster` do.
    """
    (out / "errors").mkdir(parents=True, exist_ok=True)
    (out / "configs").mkdir(exist_ok=True)
    path = out / "runs.csv"
    records = read_records(path, COLUMNS)
    planned = list(_tasks(specs, seeds, variants, conditions))
    order = {task.key(variant): k for k, (task, variant) in enumerate((t, a) for t in planned for a in t.variants)}
    known = {_key(r) for r in records}
    todo = [task for task in planned if any(task.key(variant) not in known for variant in task.variants)]
    began = perf_counter()
    answers = _run_here(todo, out, jobs) if scheduler is None else _run_on_cluster(todo, scheduler)
    for done, (task, answer) in enumerate(answers, 1):
        for name, text in answer.files.items():
            write_atomically(out / name, text)
        new = [r | {"command": _command(task, out, r["arm"], listed_in)} for r in answer.records]
        records = [r for r in records if _key(r) not in {_key(n) for n in new}] + new
        records.sort(key=lambda r: order.get(_key(r), -1))
        write_records(path, COLUMNS, _with_drift_reduction(records))
        left = (perf_counter() - began) / done * (len(todo) - done)
        errors = ", ".join(f"{r['arm']} {_metres(r)}" for r in new)
        where = f"{done}/{len(todo)} {task.spec.name} {task.conditions.name} seed {task.seed}"
        print(f"{where}: {errors}; about {left / 60:.0f} min left", flush=True)
    return _with_drift_reduction(records)


def _tasks(specs: list[SequenceSpec], seeds: list[int], variants: list[str], conditions: Conditions) -> Iterator[Task]:
    """The tasks; a recorded drive is the same for every seed and is run with the first one only."""
    units = [tuple(v for v in variants if v in WITHOUT_BIM), *((v,) for v in variants if v not in WITHOUT_BIM)]
    for spec in specs:
        for seed in seeds if spec.simulated else seeds[:1]:
            yield from (Task(spec, seed, unit, conditions) for unit in units if unit)


def _run_here(tasks: list[Task], out: Path, jobs: int) -> Iterator[tuple[Task, Answer]]:
    """Simulates one drive at a time and runs its tasks, `jobs` in parallel."""
    for group in _by_drive(tasks):
        first = group[0]
        prepare(first.spec, first.seed, out, first.conditions)
        with ThreadPoolExecutor(jobs) as pool:
            running = {pool.submit(run_in_process, task, out): task for task in group}
            for future in as_completed(running):
                yield running[future], future.result()


def _run_on_cluster(tasks: list[Task], scheduler: str) -> Iterator[tuple[Task, Answer]]:
    """Runs the tasks on a cluster; workers simulate drives themselves and need access to recorded ones."""
    from data.common.cluster import connected

    own = {task: replace(task, spec=task.spec.absolute()) for task in tasks}
    weights = {file for task in tasks for variant in task.variants if Path(file := variant.partition("@")[2]).is_file()}
    files = weights.union(*(task.spec.files() for task in own.values()))
    given = {mine: task for task, mine in own.items()}
    with connected(scheduler) as cluster:
        for mine, answer in cluster.over(own.values(), run_on_worker, Task.describe, sorted(files)):
            yield given[mine], answer


def _by_drive(tasks: list[Task]) -> list[list[Task]]:
    groups: dict[tuple[str, int], list[Task]] = {}
    for task in tasks:
        groups.setdefault((task.spec.name, task.seed), []).append(task)
    return list(groups.values())


def _command(task: Task, out: Path, variant: str, listed_in: Path | None) -> str:
    """The command that reproduces a row; an anchored variant needs the graph for its drift reduction."""
    variants = [variant] if variant in WITHOUT_BIM else ["graph", variant]
    words = ["python", "-m", "evaluation.slam_ablation.run", "--out", str(out)]
    words += [] if listed_in is None else ["--list", str(listed_in)]
    words += ["--sequences", task.spec.name, "--seeds", str(task.seed), "--variants", *variants]
    return shlex.join([*words, *" ".join(task.conditions.options()).split()])


def _with_drift_reduction(records: Records) -> Records:
    """The records with their drift reduction, where the graph without anchors has been run."""
    drifted = {_key(r)[:3]: float(r["rmse_bim_m"]) for r in records if r["arm"] == "graph" and r["rmse_bim_m"]}

    def reduction(record: Record) -> str:
        reference = drifted.get(_key(record)[:3])
        if record["arm"] in WITHOUT_BIM or not record["rmse_bim_m"] or not reference:
            return ""
        from evaluation.metrics.trajectories import drift_reduction

        return str(drift_reduction(float(record["rmse_bim_m"]), reference))

    return [r | {"drift_reduction": reduction(r)} for r in records]


def _metres(record: Record) -> str:
    return f"{float(record['rmse_bim_m']):.4f} m" if record["rmse_bim_m"] else "not anchored"


def _key(record: Record) -> tuple[str, ...]:
    return tuple(record[name] for name in KEY)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="python -m evaluation.slam_ablation.run", description="Measure the system with parts of it left out."
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for runs.csv, tables, plots and drives")
    add("--list", type=Path, metavar="FILE", help="YAML list of sequences (default: the demo building)")
    add("--sequences", nargs="+", metavar="NAME", help="only these of the list")
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="seeds of the drives (default 0 1 2)")
    add("--variants", nargs="+", default=list(VARIANTS), metavar="NAME", help=f"{', '.join(VARIANTS)}, anchored:METHOD")
    add("--weaken", action="store_true", help="degrade range and odometry until its error exceeds 0.5 m")
    add("--moved-walls", type=float, default=0.0, metavar="SHARE", help="share of walls built 10 to 30 cm off the plan")
    add("--wrong-matches", type=int, default=0, metavar="N", help="number of rooms that are matched wrongly")
    add("--loops", action="store_true", help="drive the whole path back again")
    add_options(parser, "--jobs", "runs at a time (default 1)")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'ablation' is written")
    return parser


def main() -> int:
    """The command line."""
    from evaluation.slam_ablation.page import write_page

    options = _parser().parse_args()
    specs = select_sequences(DEMO if options.list is None else read_specs(options.list), options.sequences)
    if options.jobs < 1:
        raise UserError(f"--jobs {options.jobs}: must be at least 1")
    variants = list(dict.fromkeys(check_variant(variant) for variant in options.variants))
    conditions = Conditions(options.weaken, options.moved_walls, options.wrong_matches, options.loops)
    records = ablate(
        specs, options.seeds, variants, options.out, conditions, options.jobs, options.list, options.scheduler
    )
    print(write_page(records, options.out, options.benchmarks))
    return 0


if __name__ == "__main__":
    run_command(main)
