"""The ablation's tables, over the seeds of each sequence, and its claims."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from evaluation.drives import Conditions
from evaluation.harness import Claim
from evaluation.harness.tables import bootstrapped, grouped, interval, mean, of, often
from evaluation.metrics.bootstrap import ratio
from evaluation.metrics.regions import pooled
from evaluation.slam_ablation.variants import WITHOUT_ANCHORS, WITHOUT_PLAN

NORMAL = Conditions().name
KEY = ["sequence.name", "conditions", "variant"]
DRIVE = ["sequence.name", "conditions", "seed"]
DRIVES = {
    "demo": "demo building, ground floor", "institute": "an institute of 5 storeys, ground floor",
    "office": "an office of 2 storeys", "basement": "a basement, its plan cut from a mesh",
}  # fmt: skip
README = {
    "kiss-icp": "KISS-ICP alone", "small_gicp": "small_gicp alone", "icp-to-bim": "each scan to the BIM by ICP",
    "multi-scale-icp-to-bim": "each scan to the BIM by ICP of several scales",
    "graph": "ours without the plan", "anchored:voting": "ours, matched by voting",
    "anchored": "**ours, anchored**", "oracle": "ours, true matches",
}  # fmt: skip
ACCURACY = {
    "rmse_m": "RMSE (m)", "max_m": "max (m)", "yaw_rmse_deg": "yaw (deg)", "drift_reduction": "drift reduction (%)",
    "rpe_1m_m": "RPE 1 m (m)", "drift_percent": "drift (%)", "first_anchor_s": "first anchor (s)",
}  # fmt: skip
MAP = {
    "wall_precision": "wall P", "wall_recall": "wall R", "wall_offset_mm": "offset (mm)",
    "wall_angle_deg": "angle (deg)", "room_precision": "room P", "room_recall": "room R",
    "room_centroid_m": "centroid (m)", "match_precision": "match P", "match_recall": "match R", "match_f1": "match F1",
}  # fmt: skip
COST = {
    "poses": "scans", "keyframes": "keyframes", "rooms": "rooms", "wall_surfaces": "wall surfaces",
    "seconds": "seconds", "seconds_reading": "reading", "seconds_odometry": "odometry", "seconds_surfaces": "surfaces",
    "seconds_rooms": "segmentation", "seconds_loops": "loops", "seconds_matching": "matching",
    "seconds_optimisation": "optimisation", "peak_memory_mb": "peak memory (MB)",
}  # fmt: skip


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame | str]:
    """README's table, those of accuracy, map, cost, the oracle, errors in their regions, and the weakened front ends;
    the least and the largest length of a drive (m)."""
    rows = prepared(rows)
    normal = rows[rows.conditions == NORMAL]
    regions = rows[rows["inside.poses"].notna()] if "inside.poses" in rows else rows[:0]
    weakened = rows[rows.weakening != ""].drop_duplicates(DRIVE)
    return {
        "readme": _readme(normal), "accuracy": _means(rows, ACCURACY),
        "map": _means(rows[rows.keyframes.notna()], MAP), "cost": _means(rows, COST), "oracle": _behind_oracle(rows),
        "regions": grouped(regions, KEY, pooled).rename(columns={"sequence.name": "sequence"}),
        "weakened": weakened[["sequence.name", "seed", "weakening"]],
        "lengths": f"{normal.driven_m.min():.0f} to {normal.driven_m.max():.0f}", **_texts(rows),
    }  # fmt: skip


def _texts(rows: pd.DataFrame) -> dict[str, str]:
    """RMSE (m) and peak memory (MB) of the anchored runs: `rmse-SEQUENCE-CONDITIONS`, `memory-SEQUENCE-CONDITIONS`."""
    found = {}
    for (sequence, conditions), own in rows[rows.variant == "anchored"].groupby(["sequence.name", "conditions"]):
        found[f"rmse-{sequence}-{conditions}"] = mean(own.rmse_m, ".4f")
        found[f"memory-{sequence}-{conditions}"] = mean(own.peak_memory_mb, ".0f")
    return found


def prepared(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the name of their `conditions`, and with `drift_reduction`: the percentage of the drift that the
    anchors remove, 1 - RMSE / RMSE of the graph without anchors on the same drive."""
    fields = [*Conditions.model_fields]
    chosen = rows[[f"conditions.{name}" for name in fields]].set_axis(fields, axis=1).to_dict("records")
    rows = rows.assign(conditions=[Conditions.model_validate(own).name for own in chosen])
    graph = rows[rows.variant == "graph"][[*DRIVE, "rmse_m"]]
    rows = rows.merge(graph, on=DRIVE, how="left", suffixes=("", "_graph"))
    reduction = 100 * (1 - rows.rmse_m.astype(float) / rows.rmse_m_graph.astype(float))
    return rows.assign(drift_reduction=reduction.mask(rows.variant.isin(WITHOUT_PLAN)))


def claims(rows: pd.DataFrame) -> list[Claim]:
    """The error of the anchored runs, how many there are, and their error relative to each scan's ICP to the BIM."""
    rows = prepared(rows)
    rows = rows[rows.conditions == NORMAL]
    own, peer = (rows[rows.variant == variant] for variant in ("anchored", "icp-to-bim"))
    both = own.merge(peer, on=DRIVE, suffixes=("", "_peer")).dropna(subset="rmse_m")
    if own.empty:
        return []
    rmse, missed = bootstrapped(own.rmse_m, own["sequence.bim"]), int((~own.anchored).sum())
    anchored = often(len(own) - missed, len(own))
    relative = ratio(both.rmse_m, both.rmse_m_peer, both["sequence.bim"].tolist())
    cases, compared = (f"{len(drives)} drives, {drives['sequence.bim'].nunique()} buildings" for drives in (own, both))
    covered = f"{cases}, {_covered(own)} scans"
    return [
        Claim("On a level robot, from an unknown start: drives anchored", anchored, cases),
        Claim("On a level robot: RMSE in building coordinates (mm)", interval(rmse, ".1f", 1000), covered),
        Claim("The same, relative to ICP of each scan to the plan, from the true start", interval(relative), compared),
    ]


def _readme(rows: pd.DataFrame) -> pd.DataFrame:
    there = {variant: heading for variant, heading in README.items() if variant in set(rows.variant)}

    def cells(own: pd.DataFrame) -> dict[str, str]:
        name = own["sequence.name"].iloc[0]
        errors = {heading: _error(own[own.variant == variant]) for variant, heading in there.items()}
        return {"drives": DRIVES.get(name, name)} | errors

    return grouped(rows, ["sequence.name"], cells).drop(columns="sequence.name", errors="ignore")


def _error(own: pd.DataFrame) -> str:
    """The mean RMSE; the scans that it is over, and how many runs are anchored, if not all of them are."""
    known, there = own.rmse_m.dropna().astype(float), own[own.rmse_m.notna()]
    error = f"{known.mean():.3f} m" if len(known) else ""
    if there.matched_poses.sum() < there.poses.sum():
        error += f" over {_covered(own)} scans"
    return error if len(known) == len(own) else f"{error} ({len(known)} of {len(own)} anchored)".strip()


def _covered(own: pd.DataFrame) -> str:
    """How many of the scans the errors are over, in the runs that have an error."""
    there = own[own.rmse_m.notna()]
    return of(there.matched_poses.sum(), there.poses.sum())


def _means(rows: pd.DataFrame, columns: Mapping[str, str]) -> pd.DataFrame:
    def cells(own: pd.DataFrame) -> dict[str, str]:
        anchored = "" if own.variant.iloc[0] in WITHOUT_ANCHORS else of(own.anchored.sum(), len(own))
        counts = {"runs": str(len(own)), "anchored": anchored, "coverage": _covered(own)}
        return counts | {heading: _mean(own[column]) for column, heading in columns.items()}

    return grouped(rows, KEY, cells).rename(columns={"sequence.name": "sequence"})


def _mean(values: "pd.Series[Any]") -> str:
    return mean(values, ".0f" if values.astype(float).abs().max() >= 100 else ".3g")


def _behind_oracle(rows: pd.DataFrame) -> pd.DataFrame:
    """The RMSE of each anchored variant against the oracle's, means over the seeds."""
    errors = rows.rmse_m.astype(float).groupby([rows[name] for name in KEY], sort=False).mean()
    lines = []
    for (sequence, conditions, variant), error in errors.items():
        oracle = errors.get((sequence, conditions, "oracle"))
        if variant.startswith("anchored") and oracle is not None:
            behind = f"{100 * (error / oracle - 1):+.0f} %"
            lines.append((sequence, conditions, variant, f"{error:.4f}", f"{oracle:.4f}", behind))
    return pd.DataFrame(lines, columns=["sequence", "conditions", "variant", "RMSE (m)", "oracle's RMSE (m)", "behind"])
