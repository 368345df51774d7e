"""The ablation's plots: the error over time, and the drift that the anchors remove."""

from pathlib import Path

import pandas as pd

from evaluation.harness.plots import COLOURS, new_figure, save
from evaluation.slam_ablation.tables import prepared

LEAST_M = 1e-4  # of the axis of errors
LEGEND = {"ncols": 5, "fontsize": 7, "loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "frameon": False}


def plots(rows: pd.DataFrame, folder: Path) -> None:
    """Writes `ablation-error-SEQUENCE-CONDITIONS.svg`, of the first seed, and `ablation-drift-reduction.svg`."""
    rows = prepared(rows)
    colours = {variant: COLOURS[k % len(COLOURS)] for k, variant in enumerate(reversed(rows.variant.unique()))}
    for (sequence, conditions), own in rows.groupby(["sequence.name", "conditions"], sort=False):
        name = f"ablation-error-{sequence}-{conditions}".replace(" ", "-")
        _errors_over_time(own[own.seed == own.seed.iloc[0]], colours, folder / f"{name}.svg")
    if rows.drift_reduction.notna().any():
        _drift_reduction(rows.dropna(subset="drift_reduction"), colours, folder / "ablation-drift-reduction.svg")


def _errors_over_time(rows: pd.DataFrame, colours: dict[str, str], path: Path) -> None:
    figure = new_figure(8.0, 3.2)
    axes = figure.subplots()
    for run in rows.itertuples():
        shown = [max(error, LEAST_M) for error in run.errors_m]
        line = "--" if run.variant == "oracle" else "-"
        axes.plot(run.times_s, shown, line, color=colours[run.variant], linewidth=1.0, label=run.variant)
    axes.set(xlabel="time (s)", ylabel="position error (m)", yscale="log")
    axes.grid(True, which="both", linewidth=0.3)
    axes.legend(**LEGEND)
    save(figure, path)


def _drift_reduction(rows: pd.DataFrame, colours: dict[str, str], path: Path) -> None:
    """Bars of the means over the seeds, with their standard deviations."""
    groups = rows.groupby(["sequence.name", "conditions", "variant"], sort=False).drift_reduction
    bars = groups.agg(["mean", "std"]).unstack("variant", sort=False)
    bars.index = ["\n".join(place) for place in bars.index]
    figure = new_figure(max(6.0, 1.4 * len(bars)), 3.2)
    axes = figure.subplots()
    of_each = [colours[variant] for variant in bars["mean"].columns]
    bars["mean"].plot.bar(ax=axes, yerr=bars["std"].fillna(0.0), color=of_each, width=0.8, rot=0, fontsize=7)
    axes.set(xlabel="", ylabel="drift reduction (%)", ylim=(-100.0, 100.0))
    axes.axhline(0.0, color="black", linewidth=0.5)
    axes.legend(**LEGEND)
    save(figure, path)
