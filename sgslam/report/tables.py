"""The report's tables: summary, deviations, matched rooms, hypotheses, seconds."""

import math
from html import escape
from typing import Any

import numpy as np

from data.geometry.poses import poses_to_xyzquat
from sgslam.as_built.deviation_bands import degrees, signed_mm
from sgslam.report.contents import ReportData, entered_unmatched, floor_by_floor
from sgslam.report.html_parts import NOTHING, card, count, metres, seconds, table
from sgslam.report.hypothesis_plans import hypothesis_texts

LARGEST = 30  # deviations in the table


def tables(data: ReportData) -> str:
    """All cards that have something to say."""
    parts = [_summary(data), _hypotheses(data), _rooms(data), _seconds(data)]
    return f'{_deviations(data)}\n<div class="columns">{"".join(parts)}</div>'


def _summary(data: ReportData) -> str:
    m = data.metrics
    rows = [
        ("Scans", f"{count(m.get('scans'))} ({count(m.get('scans_skipped'))} skipped)"),
        ("Length of the way", f"{_length(data):.1f} m"),
    ]
    if data.T_bim_map is not None:
        x, y, z, *quaternion = poses_to_xyzquat(data.T_bim_map)
        yaw = math.degrees(math.atan2(data.T_bim_map[1, 0], data.T_bim_map[0, 0]))
        rows += [
            ("First anchored after", seconds(m.get("first_anchor_s"))),
            ("T_bim_map: x, y, z", f"{x:.3f}, {y:.3f}, {z:.3f} m"),
            ("T_bim_map: heading", f"{yaw:.2f}°"),
            ("T_bim_map: qx, qy, qz, qw", ", ".join(f"{q:.6f}" for q in quaternion)),
        ]
    return card("Summary", table((), rows + _accuracy(m.get("accuracy") or {})))


def _accuracy(accuracy: dict[str, Any]) -> list[tuple[str, str]]:
    if not accuracy:
        return []
    yaw = accuracy.get("yaw_rmse_bim_deg")
    told = [
        ("RMSE in the BIM frame, not aligned", metres(accuracy.get("rmse_bim_m"))),
        ("Largest error in the BIM frame", metres(accuracy.get("max_bim_m"))),
        ("RMSE of the heading", NOTHING if yaw is None else f"{yaw:.2f}°"),
        ("RMSE of the odometry, aligned (SE(3))", metres(accuracy.get("rmse_odometry_aligned_m"))),
        ("Poses with a true pose", f"{count(accuracy.get('matched_poses'))} of {count(accuracy.get('total_poses'))}"),
        ("Note on the accuracy", str(accuracy.get("note") or NOTHING)),
    ]
    return [(name, text) for name, text in told if text != NOTHING]


def _deviations(data: ReportData) -> str:
    if not data.deviations:
        return ""
    ranked = sorted(data.deviations, key=lambda d: (not d["significant"], -abs(d["offset_m"] or 0.0)))
    planned = {w.id: w.room for w in data.a_graph.wall_surfaces} if data.a_graph else {}
    rooms = data.a_graph.room_by_id if data.a_graph else {}
    rows, looks = [], []
    for d in ranked[:LARGEST]:
        room = rooms.get(planned.get(d["a_id"]) or "")
        offset = signed_mm(d["offset_m"]) if d["kind"] == "moved" else str(d["kind"])
        sigma = NOTHING if d["sigma_m"] is None else f"{d['sigma_m'] * 1000:.1f} mm"
        rows.append((
            str(d["source"] or d["a_id"] or NOTHING), (room.name or room.id) if room else NOTHING, offset or NOTHING,
            sigma, degrees(d["tilt_rad"]) or NOTHING, "yes" if d["significant"] else "no", str(d.get("reason") or ""),
        ))  # fmt: skip
        looks.append(f'{" class=marked" if d["significant"] else ""} data-shows="{escape(str(d["s_id"] or ""))}"')
    significant = sum(bool(d["significant"]) for d in data.deviations)
    note = f"{significant} of {len(data.deviations)} wall surfaces deviate significantly."
    note += f" The {LARGEST} largest are shown." if len(ranked) > LARGEST else ""
    note += " Offsets are along the plan's inward normal: above 0 the wall stands into the room."
    note += " Point at a row to see the wall in the plan."
    head = ("Wall (source)", "Room", "Offset", "Sigma", "Tilt", "Significant", "Why")
    return card("Largest deviations", table(head, rows, 2, looks), note)


def _rooms(data: ReportData) -> str:
    pairs = (data.matches or {}).get("rooms") or ()
    if not pairs:
        return ""
    ours = data.s_graph.room_by_id
    planned = data.a_graph.room_by_id if data.a_graph else {}

    def name(rooms: dict[str, Any], room_id: str) -> str:
        return (rooms[room_id].name or room_id) if room_id in rooms else room_id

    rows = [(name(ours, s), name(planned, a), f"{c:.2f}") for s, a, c in pairs]
    rows += [(f"none of its own; in {name(ours, s)}" if s else "none", name(planned, a), "entered, not matched")
             for part in floor_by_floor(data) for s, a in entered_unmatched(part)]  # fmt: skip
    heading = "Matched rooms" if data.T_bim_map is not None else "Rooms by the best guess"
    return card(heading, table(("Room of the map", "Room of the BIM", "Confidence"), rows))


def _hypotheses(data: ReportData) -> str:
    found = data.hypotheses
    if data.T_bim_map is not None or not found:
        return ""
    rows = []
    for h in found:
        storey, score, place = hypothesis_texts(data, h)
        rows.append((storey, score, place, str(len(h.get("rooms") or ()))))
    note = "A higher score is better; the first ones are drawn above."
    return card("Hypotheses", table(("Storey", "Score", "Place of the map's origin", "Rooms"), rows), note)


def _seconds(data: ReportData) -> str:
    by_stage = {k: v for k, v in (data.metrics.get("seconds") or {}).items() if isinstance(v, (int, float))}
    if not by_stage:
        return ""
    total = by_stage.pop("total", None) or sum(by_stage.values())
    rows = "".join(
        f'<tr><th>{escape(stage)}</th><td class="bar"><svg viewBox="0 0 100 8" preserveAspectRatio="none">'
        f'<rect width="{min(100 * s / max(total, 1e-9), 100):.1f}" height="8"/></svg></td>'
        f'<td class="number">{seconds(s)}</td></tr>'
        for stage, s in by_stage.items()
    )
    rows += f'<tr class="total"><th>total</th><td></td><td class="number">{seconds(total)}</td></tr>'
    return card("Seconds by stage", f"<table>{rows}</table>")


def _length(data: ReportData) -> float:
    steps = np.diff(data.trajectory_map.positions, axis=0)
    return float(np.linalg.norm(steps, axis=1).sum())
