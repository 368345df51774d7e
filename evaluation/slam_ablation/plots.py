"""The ablation's plots: errors over time, drift reduction, time to the first anchor. SVG files."""

import io
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from data.common.files import write_atomically
from evaluation.slam_ablation.rows import Record, Records
from evaluation.slam_ablation.tables import groups, values

COLOURS = {
    "odometry": "#999999", "icp-to-bim": "#e69f00", "graph": "#56b4e9", "planes": "#009e73", "rooms": "#cc79a7",
    "anchored": "#0072b2", "oracle": "#222222",
}  # fmt: skip  # Okabe and Ito's palette for colour-blind readers
MOST_POINTS = 600  # per line
OTHERS = ("#d55e00", "#f0e442")  # variants with other matchers


def plots(records: Records, errors_of: Callable[[Record], Path], folder: Path) -> list[tuple[str, Path]]:
    """Writes the plots to `folder`; returns (caption, file) of each. `errors_of` gives a record's file of errors."""
    drawn = []
    for sequence, conditions in dict.fromkeys((r["sequence"], r["conditions"]) for r in records):
        own = [r for r in records if (r["sequence"], r["conditions"]) == (sequence, conditions)]
        seed = own[0]["seed"]
        lines = [(r["arm"], errors_of(r)) for r in own if r["seed"] == seed]
        name = f"error-{sequence}-{conditions}".replace(" ", "-")
        caption = f"{sequence}, {conditions}, seed {seed}: position error in the BIM frame against time"
        drawn.append((caption, _errors_over_time([line for line in lines if line[1].exists()], folder / f"{name}.svg")))
    for column, label, factor in (
        ("drift_reduction", "drift reduction (%)", 100.0), ("first_anchor_s", "time to the first anchor (s)", 1.0)
    ):  # fmt: skip
        if any(r[column] for r in records):
            path = _bars(records, column, label, factor, folder / f"{column.replace('_', '-')}.svg")
            drawn.append((f"{label}, mean over the seeds", path))
    return drawn


def _errors_over_time(lines: list[tuple[str, Path]], path: Path) -> Path:
    figure, axes = _figure(8.0, 3.2)
    for variant, file in lines:
        whole = np.loadtxt(file, delimiter=",", skiprows=1, ndmin=2)
        seconds, error = whole[:: max(1, len(whole) // MOST_POINTS)].T
        axes.plot(seconds, np.maximum(error, 1e-4), color=_colour(variant), linewidth=1.0, label=variant)
    axes.set(xlabel="time (s)", ylabel="position error (m)", yscale="log")
    axes.grid(True, which="both", linewidth=0.3)
    if lines:
        _legend(axes)
    return _saved(figure, path)


def _bars(records: Records, column: str, label: str, factor: float, path: Path) -> Path:
    found = groups(records)
    places = list(dict.fromkeys((sequence, conditions) for sequence, conditions, _ in found))
    variants = list(dict.fromkeys(variant for (_, _, variant), own in found.items() if values(own, column)))
    figure, axes = _figure(max(6.0, 1.4 * len(places)), 3.2)
    width = 0.8 / max(1, len(variants))
    for j, variant in enumerate(variants):
        here = [(i, values(found.get((*place, variant), []), column)) for i, place in enumerate(places)]
        here = [(i, [factor * v for v in numbers]) for i, numbers in here if numbers]
        axes.bar(
            [i + (j + 0.5) * width - 0.4 for i, _ in here], [statistics.mean(n) for _, n in here], width, label=variant,
            yerr=[statistics.stdev(n) if len(n) > 1 else 0.0 for _, n in here], color=_colour(variant),
            error_kw={"linewidth": 0.7},
        )  # fmt: skip
    axes.set_xticks(range(len(places)), ["\n".join(p) for p in places], fontsize=7)
    axes.set_ylabel(label)
    if column == "drift_reduction":
        axes.set_ylim(-100.0, 100.0)
        axes.axhline(0.0, color="black", linewidth=0.5)
    _legend(axes)
    return _saved(figure, path)


def _legend(axes: Any) -> None:
    axes.legend(ncols=7, fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)


def _colour(variant: str) -> str:
    return COLOURS.get(variant) or OTHERS[sum(map(ord, variant)) % len(OTHERS)]


def _figure(width: float, height: float) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def _saved(figure: Any, path: Path) -> Path:
    import matplotlib

    picture = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": path.name}):  # the same bytes for the same numbers
        figure.savefig(picture, format="svg", metadata={"Date": None})
    write_atomically(path, picture.getvalue())
    return path
