"""Tables of the tracking with any carrier: each cell of the design, with all methods side by side, and what our tracker
says of itself."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from evaluation.harness import Claim
from evaluation.harness.tables import each, grouped, of, rare, spread

METHODS = {"sgslam": "sgslam", "kiss_icp": "KISS-ICP", "small_gicp": "small_gicp"}
OURS, PEERS = "sgslam", ["kiss_icp", "small_gicp"]
TRACKED_M = 0.1  # ATE up to which a drive of a minute counts as tracked
WORSE_M = 0.02  # ATE by which ours may be worse than another's
LEVEL, NO_EFFECT = "0, 0, 0", "none"
RELIABILITY = "reliability."  # of ours
HEALTH = ("good", "degraded", "lost")
_DRIVE = [  # what distinguishes one row from another
    "sequence.name", "seed", "carrier", "pace", "backwards", "mount_deg", "sensor", "effects", "times", "seconds",
]  # fmt: skip


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The ATE in each cell of carrier, effect and sensor; by carrier and sensor, by effect, by mount, and of the
    recorded motion; then all errors by method, and whether what our tracker says of its poses is true. A part of the
    design without rows has no table."""
    rows = _by_drive_and_method(rows)
    parts = {name: (own, by) for name, (own, by) in _parts(rows).items() if len(own)}
    found = {name: grouped(own, [*by, "seconds"], _cell) for name, (own, by) in parts.items()}
    found = {"cells": _side_by_side(rows), **found}
    ratios = [{"part": name, **_compared(own)} for name, (own, _) in parts.items()]
    errors = grouped(rows, ["method"], _errors).replace({"method": METHODS})
    made = {**found, "ratios": pd.DataFrame(ratios), "errors": errors}
    if RELIABILITY + "good" not in rows:
        return made
    known = rows[rows[RELIABILITY + "good"].notna()]
    known = known.rename(columns=lambda name: name.removeprefix(RELIABILITY))
    return {**made, "reliability": grouped(known, ["carrier", "mount", "effects"], _reliability)}


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How the error without a plan compares with that of the better odometry, and false kidnappings."""
    rows = _by_drive_and_method(rows)
    both = _by_method(rows).dropna()
    drives = f"{len(both)} drives, {rows.building.nunique()} buildings"
    text = "ATE without a plan, relative to the better of KISS-ICP and small_gicp (median, least, most)"
    ours = rows[rows.method == OURS]
    return [
        Claim(text, spread(both[OURS] / both.peer, ".2f"), drives),
        Claim("Drives without a kidnapping in which one is reported", rare(int((ours.kidnaps > 0).sum()), len(ours)),
              f"{len(ours)} drives, {ours.building.nunique()} buildings"),
    ]  # fmt: skip


def _by_drive_and_method(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each drive and method that tracked it: the drive in words, and the errors. Methods may have tracked a
    drive in rows of their own: it is the same one, since its seed is. The newest row of a method counts."""
    whole, lines = named(rows), []
    for method in METHODS:
        before = f"found.{method}."
        if any(name.startswith(before) for name in rows):
            own = {name: name.removeprefix(before) for name in whole} | {f"scans_per_s.{method}": "scans_per_s"}
            lines.append(whole.rename(columns=own).assign(method=method))
    found = pd.concat(lines, ignore_index=True).dropna(subset="second_m")
    found = found.assign(ate_m=found.ate_m.astype(float).fillna(np.inf))  # lost: hardly a motion was found to align
    newest = found.sort_values("made.date", kind="stable").drop_duplicates(["drive", "method"], keep="last")
    return newest.sort_index()


def named(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the drive in words, and as `drive` all that tells one from another."""
    carriers = zip(rows.carrier, rows.pace, rows.backwards, strict=True)
    drive = rows[[name for name in _DRIVE if name in rows]]
    return rows.assign(
        drive=drive.astype(str).agg("; ".join, axis=1), building=rows["sequence.name"],
        recorded=rows.carrier.str.endswith(".tum"), carrier=[_carrier(*carrier) for carrier in carriers],
        mount=[", ".join(f"{angle:g}" for angle in mount) for mount in rows.mount_deg],
        effects=[" + ".join(own) or NO_EFFECT for own in rows.effects],
        times=rows.times.map({True: "given", False: "not given"}), seconds=rows.seconds.map("{:g}".format),
    )  # fmt: skip


def _carrier(name: str, pace: float, backwards: bool) -> str:
    if not name.endswith(".tum"):
        return name
    return "recording" + (", backwards" if backwards else "") + (f", pace {pace:g}" if pace != 1 else "")


def _parts(rows: pd.DataFrame) -> dict[str, tuple[pd.DataFrame, list[str]]]:
    """The rows of each part of the design, and the columns of its cells; effects and mounts beside the same without."""
    level, plain = rows["mount"] == LEVEL, rows.effects == NO_EFFECT
    varied = ["carrier", "sensor"]
    same = [*varied, "building", "seconds"]
    tried = rows.merge(rows[~plain][same].drop_duplicates(), on=same).sort_values(["seconds", "sensor"], kind="stable")
    mounted = rows.merge(rows[~level][same].drop_duplicates(), on=same)
    return {
        "carriers": (rows[~rows.recorded & level & plain], varied),
        "effects": (tried[tried["mount"] == LEVEL], ["effects", "sensor"]),
        "mounts": (mounted[mounted.effects == NO_EFFECT], ["mount", *varied]),
        "recording": (rows[rows.recorded & plain], [*varied, "times"]),
    }


def _side_by_side(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each carrier and effect, a column for each sensor: the median ATE (m) of ours, in brackets relative to
    that of the better of the others in the same drives, and a star where ours is worse by more than `WORSE_M`. Drives
    without others are left out."""
    given = rows[(rows["mount"] == LEVEL) & (rows.times == "given")]
    given = given[given.drive.isin(given.drive[given.method != OURS])]
    lines: list[dict[str, str]] = [
        {"carrier": carrier, "effects": effects, **{name: _against_peer(own) for name, own in line.groupby("sensor")}}
        for (carrier, effects), line in given.groupby(["carrier", "effects"], sort=False)
    ]
    return pd.DataFrame(lines).fillna("")


def _against_peer(own: pd.DataFrame) -> str:
    both = _by_method(own).dropna()
    if both.empty:
        return ""
    ours, peer = both[OURS].median(), both.peer.median()
    return f"{ours:.3f} ({(both[OURS] / both.peer).median():.2f})" + ("*" if ours > peer + WORSE_M else "")


def _cell(own: pd.DataFrame) -> dict[str, str]:
    """Median, least and largest ATE of each method, and the ratio of ours to the better of the others."""
    ate = {f"{label}: ATE (m)": _several(own[own.method == name].ate_m, ".3f") for name, label in METHODS.items()}
    both = _by_method(own)
    return {"drives": str(len(both)), **ate, "ratio": _several(both[OURS] / both.peer, ".2f")}


def _several(values: "pd.Series[Any]", form: str) -> str:
    """As `spread`; a single value alone."""
    return spread(values, form) if values.notna().sum() > 1 else each(values, form)


def _compared(own: pd.DataFrame) -> dict[str, str]:
    """Ours against the better of the others, drive by drive."""
    both = _by_method(own).dropna()
    found, worse = both[OURS] / both.peer, both[OURS] > both.peer + WORSE_M
    return {
        "drives": str(len(both)), "ATE relative to the better peer's": spread(found, ".2f"),
        "no worse": of((found <= 1).sum(), len(both)), "worse by 2 cm": of(worse.sum(), len(both)),
        "tracked": of((both[OURS] <= TRACKED_M).sum(), len(both)),
        "tracked by the better peer": of((both.peer <= TRACKED_M).sum(), len(both)),
    }  # fmt: skip


def _by_method(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each drive: the ATE of ours, and as `peer` that of the better of the others."""
    wide = rows.pivot(index=["building", "drive"], columns="method", values="ate_m").astype(float)
    wide = wide.reindex(columns=[OURS, *PEERS])
    return wide[[OURS]].assign(peer=wide[PEERS].min(axis=1))


def _errors(own: pd.DataFrame) -> dict[str, str]:
    """All errors of one method."""
    known = own.kidnaps.dropna()
    return {
        "drives": str(len(own)), "ATE (m)": spread(own.ate_m, ".3f"),
        "tracked": of((own.ate_m <= TRACKED_M).sum(), len(own)),
        "1-s error (m)": spread(own.second_m, ".3f"), "its 95 %": spread(own.second_95_m, ".3f"),
        "1-s error (deg)": spread(own.second_deg, ".2f"), "its 95 % (deg)": spread(own.second_95_deg, ".2f"),
        "worst step (m)": spread(own.worst_step_m, ".2f"), "poses missing": of(own.missing.sum(), own.scans.sum()),
        "false kidnappings": str(int(known.sum())) if len(known) else "", "scans a second": spread(own.scans_per_s),
    }  # fmt: skip


def _reliability(own: pd.DataFrame) -> dict[str, str]:
    """How reliable our tracker is: shares of all scans, and of all motions over a second between good ones."""
    motions = own.motions.sum()
    inside = (own.inside_95.astype(float).fillna(0.0) * own.motions).sum()
    shares = {f"{health} (%)": f"{100 * (own[health] * own.scans).sum() / own.scans.sum():.1f}" for health in HEALTH}
    return {
        "drives": str(len(own)), **shares,
        "inside the 95 % region (%)": f"{100 * inside / motions:.1f}" if motions else "",
        "wrongly good": of(own.wrongly_good.sum(), own.scans.sum()), "error of up (deg)": _several(own.up_deg, ".2f"),
    }  # fmt: skip
