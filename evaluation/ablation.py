"""`python -m evaluation.ablation --out DIR`: sequences x seeds x arms, a CSV row a run, a table of means.

What is in the CSV already is skipped, so that a run that was killed goes on where it was.
"""

import csv
import io
import statistics
from pathlib import Path
from time import perf_counter

from data.cli import Parser, run_command
from data.errors import UserError
from data.files import write_atomically
from evaluation.arms import ARMS, Row, as_record, run_arm
from evaluation.sequences import SequenceSpec, prepare, read_specs

DEMO = [SequenceSpec("demo", "demo", min_rooms=6, min_length=50.0)]
Records = list[dict[str, str]]


def ablate(specs: list[SequenceSpec], seeds: list[int], arms: list[str], out: Path) -> Records:
    """Runs what is not in `out`/runs.csv yet and returns all of its records."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / "runs.csv"
    records = _read(path)
    every = [(spec, seed, arm) for spec in specs for seed in seeds for arm in arms]
    todo = [(spec, seed, arm) for spec, seed, arm in every if _find(records, spec.name, seed, arm) is None]
    began = perf_counter()
    for done, (spec, seed, arm) in enumerate(todo):
        sequence = prepare(spec, seed, out)
        graph = _find(records, spec.name, seed, "graph")
        row = run_arm(arm, sequence, float(graph["rmse_bim_m"]) if graph is not None else None)
        command = f"python -m evaluation.ablation --sequences {spec.name} --seeds {seed} --arms {arm}"
        records.append({name: str(value) for name, value in as_record(row).items()} | {"command": command})
        _write(path, records)
        left = (perf_counter() - began) / (done + 1) * (len(todo) - done - 1)
        error = "not anchored" if row.rmse_bim_m is None else f"{row.rmse_bim_m:.4f} m"
        told = f"{done + 1}/{len(todo)} {spec.name} seed {seed} {arm}: {error}"
        print(f"{told}; about {left / 60:.0f} min left", flush=True)
    return records


def table(records: Records) -> str:
    """Markdown: mean and standard deviation over the seeds, for each sequence and arm."""
    columns = ("rmse_bim_m", "max_bim_m", "yaw_rmse_deg", "drift_reduction", "first_anchor_s", "wall_offset_mm")
    lines = ["| sequence | arm | runs | anchored | " + " | ".join(columns) + " |"]
    lines.append("|" + "---|" * (4 + len(columns)))
    for key in dict.fromkeys((r["sequence"], r["arm"]) for r in records):
        own = [r for r in records if (r["sequence"], r["arm"]) == key]
        anchored = sum(r["anchored"] == "True" for r in own)
        cells = [_mean([float(r[c]) for r in own if r[c]]) for c in columns]
        lines.append(f"| {key[0]} | {key[1]} | {len(own)} | {anchored} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _mean(values: list[float]) -> str:
    if not values:
        return ""
    spread = f" ± {statistics.stdev(values):.2g}" if len(values) > 1 else ""
    return f"{statistics.mean(values):.3g}{spread}"


def _find(records: Records, sequence: str, seed: int, arm: str) -> dict[str, str] | None:
    key = (sequence, str(seed), arm)
    return next((r for r in records if (r["sequence"], r["seed"], r["arm"]) == key), None)


def _read(path: Path) -> Records:
    if not path.exists():
        return []
    with path.open(newline="") as file:
        records = list(csv.DictReader(file))
    if records and set(records[0]) != {*Row.__dataclass_fields__, "command"}:
        raise UserError(f"{path}: has other columns than this version writes; give another --out")
    return records


def _write(path: Path, records: Records) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, [*Row.__dataclass_fields__, "command"], lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    write_atomically(path, text.getvalue())


def main() -> int:
    """The command line."""
    parser = Parser(prog="python -m evaluation.ablation", description="The system with parts of it left out, measured.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="for runs.csv, table.md and drives")
    parser.add_argument("--list", type=Path, metavar="FILE", help="YAML list of sequences (default: the demo building)")
    parser.add_argument("--sequences", nargs="+", metavar="NAME", help="only these of the list")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N")
    parser.add_argument("--arms", nargs="+", default=list(ARMS), choices=ARMS, metavar="ARM", help=", ".join(ARMS))
    options = parser.parse_args()
    specs = DEMO if options.list is None else read_specs(options.list)
    if options.sequences is not None:
        unknown = set(options.sequences) - {spec.name for spec in specs}
        if unknown:
            names = ", ".join(spec.name for spec in specs)
            raise UserError(f"--sequences {' '.join(sorted(unknown))}: not in the list; there are: {names}")
        specs = [spec for spec in specs if spec.name in options.sequences]
    # the graph without anchors comes first, because the others' drift reduction is against it
    arms = sorted(options.arms, key=list(ARMS).index)
    records = ablate(specs, options.seeds, arms, options.out)
    text = table(records)
    write_atomically(options.out / "table.md", text)
    print(text)
    return 0


if __name__ == "__main__":
    run_command(main)
