"""Robustness to wrong matches: runs with corrupted matches against clean runs.

    python -m evaluation.studies.wrong_matches --out DIR --list FILE

In every unique answer of the matcher, some rooms with all their walls are assigned to wrong planned rooms. The final
trajectory is measured: wrong matches must be withdrawn or outvoted.
"""

from pathlib import Path

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically
from evaluation.harness import Conditions, SequenceSpec, read_specs, select_sequences
from evaluation.drives.conditions import NORMAL
from evaluation.slam_ablation.rows import Record, Records
from evaluation.slam_ablation.run import ablate

VARIANT = "anchored"


def compare(specs: list[SequenceSpec], seeds: list[int], rooms: int, out: Path, list_: Path) -> Records:
    """The records of all runs, clean and corrupted; runs that exist in `out` are not repeated."""
    records: Records = []
    names = {spec.name for spec in specs}
    for conditions in (NORMAL, Conditions(wrong_matches=rooms)):
        made = ablate(specs, seeds, [VARIANT], out, conditions, listed_in=list_)
        records += [
            r for r in made if r["conditions"] == conditions.name and r["sequence"] in names and r["arm"] == VARIANT
            and int(r["seed"]) in seeds
        ]  # fmt: skip
    return records


def table(records: Records) -> str:
    """Markdown table: a line for each drive, and for each building over its drives."""
    anchors = ("first anchor, clean (s)", "first anchor, corrupted (s)")
    head = ("drive", "seed", "clean (m)", "corrupted (m)", "ratio", *anchors)
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    pairs: dict[str, list[tuple[Record, Record]]] = {}
    clean = {(r["sequence"], r["seed"]): r for r in records if r["conditions"] == NORMAL.name}
    for r in records:
        if r["conditions"] != NORMAL.name:
            pairs.setdefault(r["sequence"], []).append((clean[r["sequence"], r["seed"]], r))
    for name, both in pairs.items():
        lines += [_line(name, a["seed"], [(a, b)]) for a, b in both]
        if len(both) > 1:
            lines.append(_line(f"**{name}**", "all", both))
    return "\n".join(lines) + "\n"


def _line(name: str, seed: str, both: list[tuple[Record, Record]]) -> str:
    cells = [name, seed]
    errors = [_mean([pair[k]["rmse_bim_m"] for pair in both]) for k in (0, 1)]
    cells += ["not anchored" if error is None else f"{error:.4f}" for error in errors]
    cells.append("" if errors[0] is None or errors[1] is None else f"{errors[1] / errors[0]:.2f}")
    anchored = [_mean([pair[k]["first_anchor_s"] for pair in both]) for k in (0, 1)]
    cells += ["" if seconds is None else f"{seconds:.0f}" for seconds in anchored]
    return f"| {' | '.join(cells)} |"


def _mean(numbers: list[str]) -> float | None:
    return float(np.mean([float(n) for n in numbers])) if all(numbers) else None


def main() -> int:
    """The command line."""
    parser = Parser(prog="python -m evaluation.studies.wrong_matches", description="Runs with wrongly matched rooms.")
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for wrong_matches.md and the runs")
    add("--list", type=Path, required=True, metavar="FILE", help="YAML list of sequences")
    add("--sequences", nargs="+", metavar="NAME", help="only these of the list")
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="seeds of the drives (default 0 1 2)")
    add("--rooms", type=int, default=5, metavar="N", help="wrongly matched rooms (default 5)")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'wrong-matches' is written")
    options = parser.parse_args()
    specs = select_sequences(read_specs(options.list), options.sequences)
    if options.rooms < 1:
        raise UserError(f"--rooms {options.rooms}: must be at least 1")
    text = table(compare(specs, options.seeds, options.rooms, options.out, options.list))
    write_atomically(options.out / "wrong_matches.md", f"# Wrong matches\n\n{text}")
    print(text, end="")
    if options.benchmarks is not None:
        from evaluation.harness.benchmark_page import made_by, write_section

        names = f" --sequences {' '.join(options.sequences)}" if options.sequences else ""
        command = f"python -m evaluation.studies.wrong_matches --out {options.out.name} --list {options.list}{names}"
        section = f"{ABOUT.format(options.rooms)}\n\n{text}\nBy {made_by(f'{command} --rooms {options.rooms}')}."
        write_section(options.benchmarks, "wrong-matches", f"## Wrong matches\n\n{section}")
    return 0


ABOUT = (
    "RMSE in building coordinates over all scans, without alignment. Corrupted: in every unique answer of the matcher, "
    "{} rooms with all their walls are assigned to wrong planned rooms."
)

if __name__ == "__main__":
    run_command(main)
