"""`python -m evaluation.studies.growth --out DIR`: growth of time and memory with the length of a drive.

Drives of increasing length through one storey, each run in a process of its own: seconds by stage and peak memory
against scans, keyframes and rooms. Like the ablation, it can be interrupted and repeated.
"""

import io
from pathlib import Path
from typing import Any

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically
from evaluation.harness import SequenceSpec
from evaluation.harness.benchmark_page import made_by, wall_clock, write_section
from evaluation.slam_ablation.rows import Records
from evaluation.slam_ablation.run import ablate

STAGES = ("reading", "odometry", "surfaces", "rooms", "matching", "optimisation")
LENGTHS = (30.0, 60.0, 120.0, 240.0)
PICTURE = "growth.svg"


def measure(bim: str, storey: str | None, lengths: list[float], out: Path) -> Records:
    """The records of the drives, shortest first. Raises UserError for lengths that are not positive, and as the
    ablation does."""
    if not all(length > 0 for length in lengths):
        raise UserError(f"--lengths {' '.join(f'{length:g}' for length in lengths)}: give metres above 0")
    specs = [SequenceSpec(f"{m:g}m", bim, storey, min_rooms=1, min_length=m) for m in sorted(set(lengths))]
    names = {spec.name for spec in specs}
    return [r for r in ablate(specs, [0], ["anchored"], out) if r["sequence"] in names]


def table(records: Records) -> str:
    """Markdown table: a line for each drive."""
    counted = ["drive", "scans", "keyframes", "rooms", "wall surfaces"]
    head = [*counted, "seconds", "ms a scan", *STAGES, "peak memory (MB)"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for r in records:
        seconds = float(r["seconds"])
        stages = [f"{float(r[f'seconds_{stage}']):.2f}" for stage in STAGES]
        counts = [r["sequence"], r["scans"], r["keyframes"], r["rooms"], r["wall_surfaces"]]
        cost = [f"{seconds:.1f}", f"{1000 * seconds / int(r['scans']):.1f}", *stages]
        lines.append("| " + " | ".join([*counts, *cost, f"{float(r['peak_memory_mb']):.0f}"]) + " |")
    return "\n".join(lines) + "\n"


def picture(records: Records, path: Path) -> None:
    """Plots seconds by stage against scans, keyframes and rooms, and memory against scans, as SVG."""
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 3.0), layout="constrained")
    for axes, against in zip(panels := figure.subplots(1, 4), ("scans", "keyframes", "rooms", "scans"), strict=True):
        axes.set_xlabel(against)
        axes.grid(True, linewidth=0.3)
    for axes, against in zip(panels[:3], ("scans", "keyframes", "rooms"), strict=True):
        _stages(axes, records, against)
        axes.set_ylabel("seconds")
    panels[0].legend(fontsize=7)
    panels[3].plot(_numbers(records, "scans"), _numbers(records, "peak_memory_mb"), "o-", color="black")
    panels[3].set(ylabel="peak memory (MB)", ylim=(0.0, None))
    drawn = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": path.name}):
        figure.savefig(drawn, format="svg", metadata={"Date": None})
    write_atomically(path, drawn.getvalue())


def _stages(axes: Any, records: Records, against: str) -> None:
    x = _numbers(records, against)
    order = np.argsort(x, kind="stable")
    for stage in STAGES:
        axes.plot(x[order], _numbers(records, f"seconds_{stage}")[order], "o-", markersize=3, label=stage)


def _numbers(records: Records, column: str) -> Any:
    return np.array([float(r[column]) for r in records])


def main() -> int:
    """The command line."""
    parser = Parser(
        prog="python -m evaluation.studies.growth",
        description="Measure how time and memory grow with the length of a drive.",
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for runs.csv, growth.md, the plot and drives")
    add("--bim", default="demo", metavar="FILE", help="IFC file or mesh (default: the demo building)")
    add("--storey", metavar="NAME", help="storey to drive through; needed for an IFC file")
    add("--lengths", nargs="+", type=float, default=list(LENGTHS), metavar="M", help="least lengths of the drives (m)")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'growth' is written")
    options = parser.parse_args()
    records = measure(options.bim, options.storey, options.lengths, options.out)
    text = table(records)
    picture(records, options.out / PICTURE)
    write_atomically(options.out / "growth.md", f"# Growth\n\n{text}\n![growth]({PICTURE})\n")
    if options.benchmarks is not None:
        docs = options.benchmarks.parent / "docs"
        docs.mkdir(exist_ok=True)
        picture(records, docs / PICTURE)
        command = f"python -m evaluation.studies.growth --out {options.out.name} --benchmarks {options.benchmarks.name}"
        section = f"{wall_clock()}\n\n{text}\n![Growth](docs/{PICTURE})\n\nBy {made_by(command)}."
        write_section(options.benchmarks, "growth", f"## Growth with scans, keyframes and rooms\n\n{section}")
    print(text)
    return 0


if __name__ == "__main__":
    run_command(main)
