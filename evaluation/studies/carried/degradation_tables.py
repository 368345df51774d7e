"""The degradation matrix as tables and as a figure."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from evaluation.drives.perturbations import PERTURBATIONS, SEVERITIES, Perturbation
from evaluation.harness import Claim
from evaluation.harness.plots import COLOURS, new_figure, save
from evaluation.harness.tables import coverage, grouped, of, rare
from evaluation.studies.carried.carriers_tables import METHODS, TRACKED_M

UNITS: dict[Perturbation, str] = {
    "dropout": "of the returns lost", "field of view": "degrees left", "noise": "m", "occlusion": "of directions",
    "sparsity": "of the beams left", "motion distortion": "times the pace", "people": "people",
    "vibration": "degrees", "gaps": "gaps of 2 s",
}  # fmt: skip
LOST_M = 10.0  # the top of the figure's axis; what is worse or lost is drawn there
CENTIMETRES = 0.01


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The whole matrix, a line for each perturbation and severity; and how many drives each method tracks."""
    rows = _with_clean(rows)
    worse = rows[rows.severity > 0]
    return {
        "matrix": grouped(rows, ["perturbation", "severity", "amount"], _line),
        "methods": grouped(worse, ["perturbation"], _counted),
        "severities": grouped(worse, ["severity"], _counted),
    }


def _with_clean(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, with the amount in words; the clean drives first, as a perturbation of their own. Lost: infinite."""
    ate = rows.reindex(columns=[f"found.{name}.ate_m" for name in METHODS]).astype(float).fillna(np.inf)
    rows = rows.assign(**dict(zip(METHODS, ate.to_numpy().T, strict=True)))
    rows["coverage"] = (rows.anchored / rows.scans).where(rows.rmse_m.notna())
    clean = rows.severity == 0
    amounts = zip(rows.perturbation, rows.severity, strict=True)
    rows = rows.assign(amount=[f"{SEVERITIES[what][k - 1]:g} {UNITS[what]}" if k else "" for what, k in amounts])
    rows.loc[clean, "perturbation"] = "none"
    order = {name: k for k, name in enumerate(("none", *PERTURBATIONS))}
    return rows.assign(order=rows.perturbation.map(order)).sort_values(["order", "severity"], kind="stable")


def _line(own: pd.DataFrame) -> dict[str, str]:
    """For each sensor the median ATE of ours and, in brackets, of the others; how many drives are anchored, their
    median RMSE, and the share of their scans that it is over."""
    cells = {"drives": str(len(own))}
    for sensor, by in own.groupby("sensor", sort=False):
        ate = [_metres(by[name].median()) for name in METHODS]
        cells[f"{sensor}: ATE (m)"] = f"{ate[0]} ({', '.join(ate[1:])})"
        cells[f"{sensor}: anchored"] = of((by.anchored > 0).sum(), len(by))
        cells[f"{sensor}: RMSE (m)"] = "" if by.rmse_m.isna().all() else _metres(by.rmse_m.median())
        cells[f"{sensor}: coverage"] = coverage(by)
    return cells


def _metres(value: float) -> str:
    return "lost" if np.isinf(value) else f"{value:.3f}"


def _counted(own: pd.DataFrame) -> dict[str, str]:
    tracked = {f"tracked by {label}": of((own[name] <= TRACKED_M).sum(), len(own)) for name, label in METHODS.items()}
    return {
        "drives": str(len(own)), **tracked, "anchored": of((own.anchored > 0).sum(), len(own)),
        "to 0.1 m": of((own.rmse_m <= TRACKED_M).sum(), len(own)),
        "drives wrong": of((own.wrong > 0).sum(), len(own)), "scans wrong": of(own.wrong.sum(), own.scans.sum()),
    }  # fmt: skip


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How often scans that were made worse are anchored wrongly."""
    text = "Runs on degraded scans with a scan that is called anchored and is wrong by over 0.5 m or 5 degrees"
    worse = rows[rows.severity > 0]
    return [Claim(text, rare(int((worse.wrong > 0).sum()), len(worse)), f"{worse.perturbation.nunique()} kinds")]


def plots(rows: pd.DataFrame, folder: Path) -> None:
    """Writes `degradation.svg`: for each perturbation the median error over severity, of each method and with the
    plan."""
    rows = _with_clean(rows).assign(anchored_m=lambda own: own.rmse_m.astype(float).fillna(np.inf))
    names = {**METHODS, "anchored_m": "sgslam with the plan"}
    shown = [name for name in PERTURBATIONS if name in set(rows.perturbation)]
    figure = new_figure(9.0, 2.4 * -(-len(shown) // 3))
    axes = figure.subplots(-(-len(shown) // 3), 3, squeeze=False, sharey=True)
    for panel, what in zip(axes.flat, shown, strict=False):
        own = rows[rows.perturbation.isin(["none", what])]
        for colour, (name, label) in zip(COLOURS, names.items(), strict=False):
            ate = own.groupby("severity")[name].median().clip(upper=LOST_M)
            panel.plot(ate.index, ate, "o-", color=colour, linewidth=1.0, markersize=3, label=label)
        panel.set(title=what, yscale="log", ylim=(CENTIMETRES / 4, LOST_M * 1.2), xticks=range(5))
        panel.grid(visible=True, linewidth=0.3)
    for panel in axes.flat[len(shown) :]:
        panel.set_axis_off()
    figure.supylabel("error (m), median")
    figure.supxlabel("severity")
    figure.legend(*axes.flat[0].get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    save(figure, folder / "degradation.svg")
