"""Tables of the study of real recordings."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from evaluation.harness import Claim
from evaluation.harness.tables import coverage, each, grouped, of, spread
from evaluation.studies.real.success import COARSE, FINE, Limits

_NAMES = {COARSE: "3 m, 5 deg", FINE: "0.3 m, 1 deg"}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each data set, for its pieces of each length, and for each recording."""
    whole, pieces = rows[rows.submap_m.isna()], rows[rows.submap_m.notna()]
    found = {
        "datasets": grouped(whole, ["dataset"], lambda own: {"recordings": str(len(own)), **_whole(own, spread)}),
        "sequences": grouped(whole, ["dataset", "sequence"], lambda own: _whole(own, each)),
    }
    if len(pieces):
        by_length = grouped(pieces, ["dataset", "submap_m"], _of_pieces)
        found["submaps"] = by_length.rename(columns={"submap_m": "length (m)"})
    return found


def _whole(own: pd.DataFrame, shown: Callable[["pd.Series[Any]", str], str]) -> dict[str, str]:
    """The cells of whole recordings; `shown` writes their values."""
    fields = zip(("coarse", "fine"), _NAMES.values(), strict=True)
    return {
        **_placed(own),
        **{f"scans within {name}": _share(own[field].sum(), own.true.sum()) for field, name in fields},
        "RMSE (m)": shown(own.rmse_m, ".3f"), "yaw RMSE (deg)": shown(own.yaw_rmse_deg, ".2f"),
        "coverage": coverage(own), **_ends(own, shown),
        "RMSE after alignment (m)": shown(own.aligned_rmse_m, ".3f"),
    }  # fmt: skip


def _of_pieces(own: pd.DataFrame) -> dict[str, str]:
    return {"pieces": f"{own.runs.sum()}", **_placed(own), **_ends(own, spread)}


def _placed(own: pd.DataFrame) -> dict[str, str]:
    """How many runs are anchored, and end within the limits; empty without true poses in the building."""
    runs = own.runs[own.true > 0].sum()
    within = {f"within {name}": of(successes(own, limits), runs) for limits, name in _NAMES.items()}
    return {"anchored": of(own.anchored.sum(), runs), **within}


def _ends(own: pd.DataFrame, shown: Callable[["pd.Series[Any]", str], str]) -> dict[str, str]:
    names = {"position_m": ("error at the end (m)", ".3f"), "yaw_deg": ("yaw error at the end (deg)", ".2f")}
    at = {name: pd.Series([end[name] for ends in own.ends for end in ends], dtype=float) for name in names}
    return {title: shown(at[name], form) for name, (title, form) in names.items()}


def successes(own: pd.DataFrame, limits: Limits) -> int:
    """How many runs are anchored and end within the limits."""
    return sum(
        end["position_m"] <= limits.position_m and np.radians(end["yaw_deg"]) <= limits.yaw_rad
        for ends in own.ends for end in ends
    )  # fmt: skip


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.1%}" if whole else ""


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How many recordings with a plan end at their place."""
    whole = rows[rows.submap_m.isna() & (rows.true > 0)]
    text = "real recordings that are anchored and end within 0.3 m and 1 degree of the truth"
    return [Claim(text, of(successes(whole, FINE), len(whole)), f"{len(whole)} recordings")] if len(whole) else []
