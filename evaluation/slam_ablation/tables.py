"""The ablation's tables in Markdown and LaTeX: mean and standard deviation over the seeds."""

import statistics
from collections.abc import Callable

from evaluation.slam_ablation.rows import Records

Columns = dict[str, tuple[str, float]]  # of the CSV: heading, factor

ACCURACY: Columns = {
    "rmse_bim_m": ("RMSE (m)", 1.0), "max_bim_m": ("max (m)", 1.0), "yaw_rmse_deg": ("yaw (deg)", 1.0),
    "drift_reduction": ("drift reduction (%)", 100.0), "rpe_1m_m": ("RPE 1 m (m)", 1.0),
    "drift_percent": ("drift (%)", 1.0), "first_anchor_s": ("first anchor (s)", 1.0),
}  # fmt: skip
MAP: Columns = {
    "wall_precision": ("wall P", 1.0), "wall_recall": ("wall R", 1.0), "wall_offset_mm": ("offset (mm)", 1.0),
    "wall_angle_deg": ("angle (deg)", 1.0), "room_precision": ("room P", 1.0), "room_recall": ("room R", 1.0),
    "room_centroid_m": ("centroid (m)", 1.0), "match_precision": ("match P", 1.0), "match_recall": ("match R", 1.0),
    "match_f1": ("match F1", 1.0),
}  # fmt: skip
COST: Columns = {
    "scans": ("scans", 1.0), "keyframes": ("keyframes", 1.0), "rooms": ("rooms", 1.0),
    "wall_surfaces": ("wall surfaces", 1.0), "seconds": ("seconds", 1.0), "seconds_reading": ("reading", 1.0),
    "seconds_odometry": ("odometry", 1.0), "seconds_surfaces": ("surfaces", 1.0), "seconds_rooms": ("rooms cut", 1.0),
    "seconds_matching": ("matching", 1.0), "seconds_optimisation": ("optimisation", 1.0),
    "peak_memory_mb": ("peak memory (MB)", 1.0),
}  # fmt: skip


def groups(records: Records) -> dict[tuple[str, str, str], Records]:
    """The runs by (sequence, conditions, variant), in the records' order."""
    found: dict[tuple[str, str, str], Records] = {}
    for record in records:
        found.setdefault((record["sequence"], record["conditions"], record["arm"]), []).append(record)
    return found


def values(records: Records, column: str) -> list[float]:
    """The numbers of a column, without empty cells."""
    return [float(r[column]) for r in records if r[column]]


def markdown(records: Records, columns: Columns) -> str:
    """Markdown table with a line for each sequence, condition and variant."""
    head = ["sequence", "conditions", "variant", "runs", "anchored", "poses matched", *(h for h, _ in columns.values())]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in _rows(records, columns, _mean_and_deviation)]
    return "\n".join(lines) + "\n"


def latex(records: Records, columns: Columns) -> str:
    r"""The same as a `tabular` with booktabs' rules; needs \usepackage{booktabs}."""
    head = ["sequence", "conditions", "variant", "runs", "anchored", "poses matched", *(h for h, _ in columns.values())]
    lines = [rf"\begin{{tabular}}{{lll{'r' * (len(head) - 3)}}}", r"\toprule"]
    lines += [" & ".join(map(_escaped, head)) + r" \\", r"\midrule"]
    lines += [" & ".join(map(_escaped, row)) + r" \\" for row in _rows(records, columns, _mean_and_deviation)]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def against_oracle(records: Records) -> str:
    """Markdown table of each anchored variant's RMSE against the oracle's; empty without an oracle."""
    found = groups(records)
    lines = []
    for (sequence, conditions, variant), own in found.items():
        best = values(found.get((sequence, conditions, "oracle"), []), "rmse_bim_m")
        mine = values(own, "rmse_bim_m")
        if variant.startswith("anchored") and best and mine:
            oracle, error = statistics.mean(best), statistics.mean(mine)
            behind = f"{100 * (error / oracle - 1):+.0f} %"
            lines.append(f"| {sequence} | {conditions} | {variant} | {error:.4f} | {oracle:.4f} | {behind} |")
    if not lines:
        return ""
    head = "| sequence | conditions | variant | RMSE (m) | oracle's RMSE (m) | behind the oracle |"
    return "\n".join([head, "|---|---|---|---|---|---|", *lines]) + "\n"


def _rows(records: Records, columns: Columns, format_cell: Callable[[list[float]], str]) -> list[list[str]]:
    rows = []
    for key, own in groups(records).items():
        anchored = sum(r["anchored"] == "True" for r in own)
        poses = f"{sum(int(r['matched_poses']) for r in own)} of {sum(int(r['total_poses']) for r in own)}"
        cells = [format_cell([factor * v for v in values(own, c)]) for c, (_, factor) in columns.items()]
        rows.append([*key, str(len(own)), str(anchored), poses, *cells])
    return rows


def _mean_and_deviation(numbers: list[float]) -> str:
    if not numbers:
        return ""
    spread = f" ± {statistics.stdev(numbers):.2g}" if len(numbers) > 1 else ""
    return f"{_short(statistics.mean(numbers))}{spread}"


def _short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _escaped(text: str) -> str:
    for plain, written in (("%", r"\%"), ("_", r"\_"), ("&", r"\&"), ("±", r"$\pm$")):
        text = text.replace(plain, written)
    return text
