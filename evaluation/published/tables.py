"""The published tables and ours, made from the rows. Rooms and wall surfaces are counted together."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from data.generation.buildings import KINDS
from evaluation.harness import Claim
from evaluation.harness.plots import COLOURS, new_figure, save
from evaluation.harness.tables import grouped, interval
from evaluation.matching_benchmark.plan_sets import name_of_set
from evaluation.matching_benchmark.scores import UNANSWERED, estimate, scores_of

LINES = ("pairs of", "method")
STARTS = (0.0, 1.0, 5.0, 20.0)  # metres, to within which the start is known
LIMIT_S = 60.0  # above, a pair is not completed, as in the paper
NAMES = {
    "combinatorial": "iS-Graphs' search, `combinatorial`", "paper@published": "the paper's matcher, `paper@published`",
    "paper@repository": "its repository's better parameters, `paper@repository`", "voting": "ours, `voting`",
    "learned": "ours, `learned`", "pca-gm": "PCA-GM on our features, `pca-gm`",
    "superglue": "SuperGlue on our features, `superglue`",
}  # fmt: skip
SETS = {"msd": "MSD apartments", "apartment": "generated apartments"}
MAPS = {
    "known_map": "parts of one map of the published SLAM, in its own frame",
    "known_map_moved": "the same parts, placed anywhere", "sgslam": "maps of our own SLAM, simulated drives",
}  # fmt: skip


# As printed in the paper, "Learning-Based Hierarchical Scene Graph Matching for Robot Localization Leveraging Prior
# Maps": the MSD test set and the real environment. The replicas are others' measurements on apartments that they drew.
PUBLISHED = (*LINES, "precision", "recall", "F1", "time (s)", "completed")
PERTURBED = (
    ("its MSD test set", "iS-Graphs, as published", "0.99", "0.92", "0.95", "7.66", "86 %"),
    ("its MSD test set", "the paper's matcher, as published", "0.85", "0.85", "0.85", "0.093", "100 %"),
    ("synthetic apartments", "a small replica of the paper's parameters", "0.683", "0.683", "0.683", "", "100 %"),
    ("synthetic apartments", "a small replica of the better parameters", "0.966", "0.966", "0.966", "", "100 %"),
)
SLAM_BUILT = (
    ("its real environment", "iS-Graphs, as published", "0.88", "0.53", "0.67", "0.191", "100 %"),
    ("its real environment", "the paper's matcher, as published", "0.80", "0.88", "0.84", "0.021", "100 %"),
)


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The published tables with ours below, F1 where the start is not known, and the contributions of the published
    matcher's parts."""
    own = _scored(rows)
    whole, networks = own[own.network.isna()], own[own.network.notna()]
    of_starts = _of_starts(own)
    found = {
        "perturbed": _below(PERTURBED, whole[whole.start_m == 0]),
        "slam_built": _below(SLAM_BUILT, whole[whole.regime.isin(MAPS)]),
        "unknown_start": grouped(of_starts.assign(method=of_starts.method.replace(NAMES)), ("method",), _unknown_start),
        "contributions": grouped(networks.assign(method=networks.network), LINES, _measures),
    }
    return {name: table for name, table in found.items() if len(table)}


def claims(rows: pd.DataFrame) -> list[Claim]:
    """F1 of the published matcher, and of ours, on apartments of the data set that it was published with."""
    own = _scored(rows)
    own = own[(own.start_m == 0) & ~own.plans.isin(KINDS)]
    found = []
    of = {
        "paper@published": "the published matcher, reimplemented (0.85 in its paper)",
        "paper@repository": "the same with its repository's parameters", "learned": "ours",
    }  # fmt: skip
    for method, whose in of.items():
        part = own[own.method == method]
        text = f"F1 on MSD apartments with the published perturbation: {whose}"
        found.append(Claim(text, interval(estimate(part, "node_f1")), f"{len(part)} pairs"))
    return found


def plots(rows: pd.DataFrame, folder: Path) -> None:
    """F1 against the uncertainty of the start and, in the regime `real`, against the rooms seen."""
    own = _of_starts(_scored(rows))
    figure = new_figure(7.4, 3.0)
    axes = figure.subplots(1, 2, sharey=True)
    for colour, (method, part) in zip(COLOURS, own.groupby("method", sort=False), strict=False):
        for ax, by in zip(axes, ("start_m", "rooms"), strict=True):
            f1 = part.groupby(by).node_f1.mean()
            ax.plot([_number(at) for at in f1.index], f1, color=colour, marker="o", ms=3, label=method)
    axes[0].set(title="published perturbation", xlabel="start known to within ± (m)", ylabel="F1", ylim=(0, 1.03))
    axes[1].set(title="maps as of real scans", xlabel="rooms seen")
    for ax in axes:
        ax.grid(alpha=0.3)
    axes[0].legend(fontsize=7, loc="lower left")
    save(figure, folder / "published-collapse.svg")


def _scored(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the pair's fields under their own names, and with scores of rooms and walls together."""
    own = rows.rename(columns=lambda name: name.removeprefix("pair."))
    sets = own.plans.map(name_of_set)
    own["building"] = sets + "/" + own.building
    own["pairs of"] = own.regime.map(MAPS).fillna(sets.map(SETS)).fillna(sets)
    own["rooms"] = own.rooms.astype(float).fillna(np.inf).where(own.regime == "real")
    own["completed"] = ~own.status.isin(UNANSWERED) & (own.seconds < LIMIT_S)
    for count in ("right", "answered", "true", "spare", "left", "bins"):
        own[f"node_tally.{count}"] = own[f"room_tally.{count}"] + own[f"wall_tally.{count}"]
    return own.assign(**scores_of(own, "node"))


def _below(published: Sequence[tuple[str, ...]], rows: pd.DataFrame) -> pd.DataFrame:
    """The published lines, and below them ours; empty without ours."""
    ours = grouped(rows.assign(method=rows.method.replace(NAMES)), LINES, _measures)
    if not len(ours):
        return ours
    theirs = pd.DataFrame(published, columns=list(PUBLISHED)).reindex(columns=ours.columns)
    return pd.concat([theirs, ours])


def _measures(own: pd.DataFrame) -> dict[str, str]:
    done = own[own.completed]
    nodes = {
        name: interval(estimate(own, f"node_{name.lower()}")) for name in ("precision", "recall", "F1", "accuracy")
    }
    return {
        "pairs": str(len(own)), **nodes, "time (s)": f"{own.seconds.mean():.3f}",
        "completed": f"{100 * own.completed.mean():.0f} %",
        "F1 of the completed": _f1(done) if len(done) < len(own) else "",
    }  # fmt: skip


def _of_starts(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of given plans with the published perturbation or in the regime `real`, of methods with all starts."""
    own = rows[rows.network.isna() & ~rows.plans.isin(KINDS) & (rows.start_m.notna() | rows.rooms.notna())]
    return own[own.method.isin(own[own.start_m == STARTS[-1]].method)]


def _unknown_start(own: pd.DataFrame) -> dict[str, str]:
    starts = {f"±{start:g} m": _f1(part) for start, part in own.groupby("start_m")}
    return starts | {f"`real`, {_number(rooms)} rooms": _f1(part) for rooms, part in own.groupby("rooms")}


def _f1(own: pd.DataFrame) -> str:
    return f"{own.node_f1.mean():.3f}" if len(own) else ""


def _number(value: float) -> str:
    return "all" if np.isinf(value) else f"{value:g}"
