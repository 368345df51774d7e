"""The plots of the matching benchmark, made from its rows, as SVG."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.matching_benchmark.cells import SIZES, measure, size_of
from evaluation.matching_benchmark.rows import Row
from evaluation.matching_benchmark.tables import in_order
from evaluation.metrics.calibration import merged

ALL = 24  # position of "all" on the axis of rooms


def write_plots(rows: Sequence[Row], out: Path) -> list[Path]:
    """Plots wall F1 against rooms seen, the reliability diagram and time against plan size; returns the files."""
    import matplotlib  # slow to import

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "sgslam"  # the same rows make the same file
    methods = list(dict.fromkeys(r.method for r in rows))
    colour = {m: f"C{k}" for k, m in enumerate(methods)}
    figures = {"f1": _f1(rows, colour), "reliability": _reliability(rows, colour), "time": _time(rows, colour)}
    paths = []
    for name, figure in figures.items():
        if figure is not None:
            paths.append(out / f"{name}.svg")
            figure.savefig(paths[-1], metadata={"Date": None}, bbox_inches="tight")
    matplotlib.pyplot.close("all")
    return paths


def _f1(rows: Sequence[Row], colour: dict[str, str]) -> Any:
    from matplotlib import pyplot as plt

    to_find = [r for r in rows if r.regime != "negative"]
    groups = [g for g in SIZES if any(size_of(r.size) == g for r in to_find)]
    regimes = in_order(to_find)
    if not to_find:
        return None
    figure, axes = plt.subplots(
        len(groups), len(regimes), figsize=(3.2 * len(regimes), 2.8 * len(groups)), sharey=True, squeeze=False
    )
    for line, group in zip(axes, groups, strict=True):
        for ax, regime in zip(line, regimes, strict=True):
            for method in colour:
                own = [r for r in to_find if (size_of(r.size), r.regime, r.method) == (group, regime, method)]
                _curve(ax, own, colour[method], method)
            ax.set_title(f"{regime}, {group} plans", fontsize=9)
            ax.set_xscale("log")
            ticks = [1, 2, 4, 9, ALL]
            ax.set_xticks(ticks, [*map(str, ticks[:-1]), "all"])
            ax.minorticks_off()
            ax.set_ylim(0, 1.02)
            ax.grid(alpha=0.3)
    for ax in axes[-1]:
        ax.set_xlabel("rooms seen")
    axes[0, 0].set_ylabel("wall F1")
    axes[0, 0].legend(fontsize=8)
    return figure


def _curve(ax: Any, rows: Sequence[Row], colour: str, label: str) -> None:
    points = []
    for rooms in sorted({r.rooms or ALL for r in rows}):
        f1 = measure([r for r in rows if (r.rooms or ALL) == rooms]).walls.f1
        if f1 is not None:
            points.append((rooms, f1.value, f1.value - f1.low, f1.high - f1.value))
    if points:
        x, y, below, above = np.array(points).T
        ax.errorbar(x, y, np.clip((below, above), 0, None), color=colour, label=label, marker="o", ms=3, capsize=2)


def _reliability(rows: Sequence[Row], colour: dict[str, str]) -> Any:
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(7, 3.2), sharey=True)
    for ax, what, of in zip(axes, ("wall surfaces", "rooms"), ("wall_tally", "room_tally"), strict=True):
        ax.plot([0, 1], [0, 1], color="0.7", lw=1)
        for method, shade in colour.items():
            bins = merged(getattr(r, of).bins for r in rows if r.method == method)
            if bins:
                ax.plot([b.mean for b in bins], [b.share for b in bins], color=shade, marker="o", ms=3, label=method)
        ax.set_title(what, fontsize=9)
        ax.set_xlabel("confidence")
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("share that is right")
    axes[0].legend(fontsize=8)
    return figure


def _time(rows: Sequence[Row], colour: dict[str, str]) -> Any:
    from matplotlib import pyplot as plt

    figure, ax = plt.subplots(figsize=(5, 3.2))
    for method, shade in colour.items():
        own = [r for r in rows if r.method == method]
        ax.plot([r.size for r in own], [r.seconds for r in own], ".", color=shade, ms=3, alpha=0.5, label=method)
    ax.set_xlabel("rooms of the plan")
    ax.set_ylabel("seconds")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    return figure
