"""The page of the ablation's results (tables, plots, conditions) and its section of BENCHMARKS.md."""

import shutil
from pathlib import Path

from data.common.files import write_atomically
from evaluation.harness.benchmark_page import machine, made_by, wall_clock, write_section
from evaluation.slam_ablation.plots import plots
from evaluation.slam_ablation.rows import Records, errors_file
from evaluation.slam_ablation.tables import ACCURACY, COST, MAP, against_oracle, latex, markdown
from evaluation.slam_ablation.variants import VARIANTS

FIGURES = "docs"  # folder next to the page of results


def write_page(records: Records, out: Path, benchmarks: Path | None = None) -> str:
    """Writes table.md, table.tex, plots/*.svg and ablation.md into `out`, and the page's section; returns the table."""
    records = _in_order(records)
    accuracy = markdown(records, ACCURACY)
    write_atomically(out / "table.md", accuracy)
    tables = [latex(records, columns) for columns in (ACCURACY, MAP, COST)]
    write_atomically(out / "table.tex", "\n".join(tables))
    (out / "plots").mkdir(exist_ok=True)
    drawn = plots(records, lambda record: errors_file(out, record), out / "plots")
    sections = _sections(records, accuracy)
    pictures = [f"![{caption}](plots/{path.name})\n\n{caption}\n" for caption, path in drawn]
    page = ["# Ablation\n", f"On {machine()}.\n", *sections, "## Plots\n", *pictures, _commands(records)]
    write_atomically(out / "ablation.md", "\n".join(page))
    if benchmarks is not None:
        write_section(benchmarks, "ablation", _benchmark(sections, drawn, out, benchmarks))
    return accuracy


def _in_order(records: Records) -> Records:
    """Sorted by conditions, normal ones first, sequence, variant and seed."""
    conditions = ["normal", *dict.fromkeys(r["conditions"] for r in records)]
    sequences = list(dict.fromkeys(r["sequence"] for r in records))
    variants = [*VARIANTS, *dict.fromkeys(r["arm"] for r in records)]

    def key(record: dict[str, str]) -> tuple[int, int, int, int]:
        places = conditions.index(record["conditions"]), sequences.index(record["sequence"])
        return (*places, variants.index(record["arm"]), int(record["seed"]))

    return sorted(records, key=key)


def _sections(records: Records, accuracy: str) -> list[str]:
    variants = "\n".join(f"- `{variant}`: {what}" for variant, what in VARIANTS.items())
    oracle = against_oracle(records)
    return [
        f"Variants:\n\n{variants}\n",
        "Errors are in the BIM frame, without alignment, over all scans; mean ± standard deviation over the seeds. "
        "Drift reduction: 1 - RMSE / RMSE of the same graph without anchors, its first pose set to the truth.\n",
        "### Trajectory\n", accuracy, *(["### Against the oracle\n", oracle] if oracle else []),
        "### Map and matches\n",
        "S-graph against the storey's A-graph; recall over the rooms that were entered.\n",
        markdown([r for r in records if r["arm"] not in ("odometry", "icp-to-bim")], MAP),
        "### Seconds by stage, memory\n", f"{wall_clock()}\n", markdown(records, COST), _weakening_lines(records),
    ]  # fmt: skip


def _weakening_lines(records: Records) -> str:
    weak = [r for r in records if r["weakening"] and r["arm"] != "icp-to-bim"]
    lines = dict.fromkeys(f"- {r['sequence']}, seed {r['seed']}: {r['weakening']}" for r in weak)
    return "### How the front end was weakened\n\n" + "\n".join(lines) + "\n" if lines else ""


def _commands(records: Records) -> str:
    return "## Commands\n\nEach reproduces one row:\n\n```\n" + "\n".join(r["command"] for r in records) + "\n```\n"


def _benchmark(sections: list[str], drawn: list[tuple[str, Path]], out: Path, benchmarks: Path) -> str:
    """The section with tables and bar charts; copies the charts next to the page."""
    folder = benchmarks.parent / FIGURES
    folder.mkdir(parents=True, exist_ok=True)
    pictures = []
    for caption, path in drawn:
        if not path.name.startswith("error-"):
            shutil.copyfile(path, folder / f"ablation-{path.name}")
            pictures.append(f"![{caption}]({FIGURES}/ablation-{path.name})\n")
    command = made_by(f"python -m evaluation.slam_ablation.run --out {out.name} --benchmarks {benchmarks.name}")
    return "\n".join(["## Accuracy\n", *sections, *pictures, f"By {command}.\n"])
