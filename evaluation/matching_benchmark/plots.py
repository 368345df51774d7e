"""The plots of the matching benchmark, made from its rows."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from evaluation.harness.plots import COLOURS, new_figure, save
from evaluation.matching_benchmark.pairs import NEGATIVE
from evaluation.matching_benchmark.scores import TALLIES, bins_of, estimate, scored

ALL = 24  # position of "all" on the axis of rooms
TICKS = {1: "1", 2: "2", 4: "4", 9: "9", ALL: "all"}
CLASSES = 8  # of plan sizes


def plots(rows: pd.DataFrame, folder: Path) -> None:
    """Wall F1 against rooms seen, the reliability diagram, and time against plan size, of the test plans."""
    own = scored(rows)
    own = own[own.split == "test"]
    colours = dict(zip(own.method.unique(), COLOURS, strict=False))
    for name, drawn in (("f1", _f1), ("reliability", _reliability), ("time", _time)):
        save(drawn(own, colours), folder / f"matching-{name}.svg")


def _f1(rows: pd.DataFrame, colours: dict[str, str]) -> Any:
    to_find = rows[rows.regime != NEGATIVE]
    sizes, regimes = sorted(to_find.size_class.unique(), reverse=True), to_find.regime.unique()
    figure = new_figure(2.6 * len(regimes), 2.6 * len(sizes))
    axes = figure.subplots(len(sizes), len(regimes), sharey=True, squeeze=False)
    for (size, regime, method), own in to_find.groupby(["size_class", "regime", "method"]):
        ax = axes[sizes.index(size), list(regimes).index(regime)]
        points = [
            (min(rooms, ALL), f1.value, f1.value - f1.low, f1.high - f1.value)
            for rooms, part in own.groupby("rooms") if (f1 := estimate(part, "wall_f1")) is not None
        ]  # fmt: skip
        x, y, below, above = np.array(points).T
        errors = np.clip((below, above), 0, None)
        ax.errorbar(x, y, errors, color=colours[method], label=method, marker="o", ms=3, capsize=2)
        ax.set_title(f"{regime}, {size} plans", fontsize=9)
        ax.set_xscale("log")
        ax.set_xticks(list(TICKS), list(TICKS.values()))
        ax.minorticks_off()
        ax.set_ylim(0, 1.02)
        ax.grid(alpha=0.3)
    figure.supxlabel("rooms seen", fontsize=9)
    axes[0, 0].set_ylabel("wall F1")
    axes[0, 0].legend(fontsize=7)
    return figure


def _reliability(rows: pd.DataFrame, colours: dict[str, str]) -> Any:
    figure = new_figure(7, 3.2)
    axes = figure.subplots(1, 2, sharey=True)
    for ax, kind in zip(axes, TALLIES, strict=True):
        ax.plot([0, 1], [0, 1], color="0.7", lw=1)
        for method, colour in colours.items():
            bins = bins_of(rows[rows.method == method], kind)
            ax.plot([b.mean for b in bins], [b.share for b in bins], color=colour, marker="o", ms=3, label=method)
        ax.set_title(f"{kind}s", fontsize=9)
        ax.set_xlabel("confidence")
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("share that is right")
    axes[0].legend(fontsize=8)
    return figure


def _time(rows: pd.DataFrame, colours: dict[str, str]) -> Any:
    """Medians, and bands from the 5th to the 95th percentile, of plans of similar size."""
    figure = new_figure(5, 3.2)
    ax = figure.subplots()
    limits = np.geomspace(rows["size"].min(), rows["size"].max() + 1, CLASSES + 1)
    for method, colour in colours.items():
        own = rows[rows.method == method]
        groups = own.groupby(np.digitize(own["size"], limits))
        size, seconds = groups["size"].median(), groups.seconds
        ax.plot(size, seconds.median(), color=colour, marker="o", ms=3, label=method)
        ax.fill_between(size, seconds.quantile(0.05), seconds.quantile(0.95), color=colour, alpha=0.15, lw=0)
    ax.set_xlabel("rooms of the plan")
    ax.set_ylabel("seconds")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    return figure
