"""Tables of the study of other SLAM systems."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from evaluation.harness import Claim
from evaluation.harness.tables import coverage, grouped, of, spread
from evaluation.studies.carried.carriers_tables import named

LABELS = {
    "kiss_slam": "KISS-SLAM, with scans", "kiss_slam_maps": "KISS-SLAM, local maps", "rko_lio": "RKO-LIO, with scans",
    "small_gicp": "small_gicp, with scans",
}  # fmt: skip
CLAIMED = 0.8  # of the other system's error, which anchoring should remove


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The gain by output and sensor; each drive; and why the others are not anchored."""
    rows = named(rows)
    known = [output for output in LABELS if f"found.{output}.anchored" in rows]
    longer = pd.concat([_of_output(rows, output) for output in known])
    lost = longer[~longer.anchored.astype(bool)]
    return {
        "gain": grouped(longer, ["output"], _gain), "by_sensor": grouped(longer, ["output", "sensor"], _gain),
        "drives": pd.DataFrame([_drive(row) for _, row in longer.iterrows()]),
        "not_anchored": lost[["output", "building", "seed", "sensor", "reason"]],
    }  # fmt: skip


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How often anchoring with the scans removes most of another system's error."""
    known = [output for output in LABELS if f"found.{output}.anchored" in rows and output != "kiss_slam_maps"]
    removed = pd.concat([_of_output(rows, output) for output in known]).removed
    text = f"Outputs of other SLAM systems of whose error anchoring with the scans removes {CLAIMED:.0%} or more"
    return [Claim(text.replace("%", " %"), of((removed >= CLAIMED).sum(), len(removed)), f"{len(known)} systems")]


def _of_output(rows: pd.DataFrame, output: str) -> pd.DataFrame:
    """A line for each drive from which there is this output, with the part of its error that anchoring removes."""
    own = rows[rows[f"found.{output}.anchored"].notna()]
    own = own.rename(columns=lambda name: name.removeprefix(f"found.{output}."))
    removed = 1 - own.rmse_m.astype(float) / own.alone_m.astype(float)
    covered = (own.poses / own.scans).clip(upper=1.0)  # KISS-SLAM also reads the scans after the drive's end
    covered = covered.where(own.rmse_m.notna())
    return own.assign(output=LABELS[output], removed=removed, coverage=covered, cpu=own[f"cpu_s.{output}"])


def _gain(own: pd.DataFrame) -> dict[str, str]:
    return {
        "anchored": of(own.anchored.sum(), len(own)), "alone: ATE (m)": spread(own.alone_m, ".3f"),
        "anchored: RMSE (m)": spread(own.rmse_m, ".3f"), "coverage": coverage(own),
        "worst (m)": spread(own.worst_m, ".2f"),
        "error removed (%)": spread(100 * own.removed),
        f"at least {CLAIMED:.0%}".replace("%", " %"): of((own.removed >= CLAIMED).sum(), len(own)),
        "poses wrong": of(own.wrong.sum(), own.poses[own.anchored.astype(bool)].sum()),
        "CPU time of the command (s)": spread(own.cpu),
    }  # fmt: skip


def _drive(row: "pd.Series[float]") -> dict[str, str]:
    def known(name: str, form: str, factor: float = 1.0) -> str:
        return "" if row[name] is None or np.isnan(row[name]) else format(factor * row[name], form)

    return {
        "output": str(row.output), "building": str(row.building), "sensor": str(row.sensor), "seed": str(row.seed),
        "alone: ATE (m)": known("alone_m", ".3f"), "anchored: RMSE (m)": known("rmse_m", ".3f"),
        "coverage": known("coverage", ".1f", 100.0) + " %" * bool(row.anchored),
        "error removed (%)": known("removed", ".0f", 100.0), "worst (m)": known("worst_m", ".2f"),
        "poses wrong": f"{row.wrong:.0f}" if row.anchored else "",
    }  # fmt: skip
