"""Growth of time and memory with the length of a drive."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from pydantic import PositiveFloat

from data.common.errors import UserError
from evaluation.drives.conditions import NORMAL
from evaluation.drives.sequences import DriveOptions
from evaluation.harness import Study
from evaluation.harness.plots import new_figure, save
from evaluation.slam_ablation.scores import Scores
from evaluation.slam_ablation.study import Run, measure

STAGES = ("reading", "odometry", "surfaces", "rooms", "matching", "optimisation")


class Choice(DriveOptions):
    """The storeys and seeds, and the least lengths (m) of the drives."""

    sequences: tuple[str, ...] = ("demo",)
    seeds: tuple[int, ...] = (0,)
    lengths: tuple[PositiveFloat, ...] = (30.0, 60.0, 120.0, 240.0)


def cases(options: Choice) -> list[Run]:
    """Drives of each length. Raises UserError for a recorded sequence."""
    runs = []
    for spec, seed in options.drives():
        if not spec.simulated:
            raise UserError(f"'{spec.name}': recorded, so its length cannot be chosen; leave it out")
        for metres in options.lengths:
            chosen = {"name": f"{spec.name}-{metres:g}m", "min_rooms": 1, "min_length": metres}
            own = spec.model_copy(update=chosen)
            runs.append(Run(sequence=own, seed=seed, conditions=NORMAL, variant="anchored"))
    return runs


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each drive."""
    counts = rows[["sequence.name", "poses", "keyframes", "rooms", "wall_surfaces"]]
    table = counts.set_axis(["drive", "scans", "keyframes", "rooms", "wall surfaces"], axis=1).astype(str)
    table["seconds"] = rows.seconds.map("{:.1f}".format)
    table["ms a scan"] = (1000 * rows.seconds / rows.poses).map("{:.1f}".format)
    for stage in STAGES:
        table[f"{stage} (s)"] = rows[f"seconds_{stage}"].map("{:.2f}".format)
    return {"drives": table.assign(**{"peak memory (MB)": rows.peak_memory_mb.map("{:.0f}".format)})}


def plots(rows: pd.DataFrame, folder: Path) -> None:
    """Writes `growth.svg`: seconds by stage against scans, keyframes and rooms, and memory against scans."""
    figure = new_figure(12.0, 3.0)
    panels = figure.subplots(1, 4)
    for axes, against in zip(panels, ("poses", "keyframes", "rooms"), strict=False):
        own = rows.sort_values(against, kind="stable")
        for stage in STAGES:
            axes.plot(own[against], own[f"seconds_{stage}"], "o-", markersize=3, label=stage)
        axes.set(xlabel="scans" if against == "poses" else against, ylabel="seconds")
    panels[0].legend(fontsize=7)
    panels[3].plot(rows.poses, rows.peak_memory_mb, "o-", color="black")
    panels[3].set(xlabel="scans", ylabel="peak memory (MB)", ylim=(0.0, None))
    for axes in panels:
        axes.grid(True, linewidth=0.3)
    save(figure, folder / "growth.svg")


STUDY = Study(
    "growth", "how time and memory grow with the length of a drive", Choice, Choice(lengths=(30.0, 60.0)), Run, Scores,
    cases, measure, tables, plots=plots, timed=True,
)  # fmt: skip
