"""`report.html`: one self-contained page that says what the run found, and shows it on the plan."""

import math
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from data.files import write_atomically
from data.poses import poses_to_xyzquat
from sgslam.plan_drawing import ReportData, plan_drawing
from sgslam.plan_svg import legend, plan_svg

NOTHING = "\N{EN DASH}"
# the browser itself refuses whatever is not in the page
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


def write_report(data: ReportData, path: Path | str) -> None:
    """Writes the page atomically; it opens from disk and loads nothing else."""
    write_atomically(path, report_html(data))


def report_html(data: ReportData) -> str:
    """The page: verdict, key numbers, the plan from above, and tables. All strings from data are escaped."""
    drawing = plan_drawing(data)
    css, js = (files("sgslam").joinpath(f"report.{kind}").read_text() for kind in ("css", "js"))
    plan = (
        f'<section class="card"><h2>{escape(drawing.heading)}</h2>{plan_svg(drawing)}{legend(drawing)}'
        '<p class="muted">Scroll to zoom, drag to move, double click to see all of it again; '
        "point at a wall or a room for its name.</p></section>"
    )
    tables = [_summary(data), _hypotheses(data), _rooms(data), _seconds(data)]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Run report</title>\n<style>\n{css}</style>\n</head>\n<body>\n<main>\n"
        f'{_verdict(data)}\n{_tiles(data)}\n{plan}\n<div class="columns">{"".join(tables)}</div>\n'
        f"</main>\n<script>\n{js}</script>\n</body>\n</html>\n"
    )


def _verdict(data: ReportData) -> str:
    anchored = bool(data.metrics.get("anchored"))
    look, verdict = ("good", "Anchored") if anchored else ("wait", "Not anchored")
    badge = f'<span class="badge {look}">{verdict}</span>'
    reason = escape(str(data.metrics.get("reason") or ""))
    return f'<header><h1>Run report</h1>{badge}</header>\n<p class="muted">{reason}</p>'


def _tiles(data: ReportData) -> str:
    m, accuracy = data.metrics, data.metrics.get("accuracy") or {}
    tiles: list[tuple[str, str]] = []
    if accuracy.get("rmse_bim_m") is not None:
        tiles.append((_metres(accuracy["rmse_bim_m"]), "RMSE in the BIM frame"))
    elif accuracy.get("rmse_odometry_aligned_m") is not None:
        tiles.append((_metres(accuracy["rmse_odometry_aligned_m"]), "RMSE of the odometry, aligned"))
    rooms = f"{len((data.matches or {}).get('rooms') or ())} of {_count(m.get('rooms'))}"
    tiles += [
        (rooms if data.matches else _count(m.get("rooms")), "rooms matched" if data.matches else "rooms"),
        (_count(m.get("wall_surfaces")), "wall surfaces"),
        (_count(m.get("scans")), "scans"),
        (_count(m.get("keyframes")), "keyframes"),
        (_seconds_text((m.get("seconds") or {}).get("total")), "in all"),
    ]
    return '<div class="tiles">' + "".join(
        f'<div class="tile"><b>{escape(value)}</b><span>{name}</span></div>' for value, name in tiles
    ) + "</div>"  # fmt: skip


def _summary(data: ReportData) -> str:
    m, accuracy = data.metrics, data.metrics.get("accuracy") or {}
    rows = [
        ("Scans", f"{_count(m.get('scans'))} ({_count(m.get('scans_skipped'))} skipped)"),
        ("Length of the way", f"{_length(data):.1f} m"),
        ("First anchored after", _seconds_text(m.get("first_anchor_s"))),
    ]
    if data.T_bim_map is not None:
        x, y, z, *quaternion = poses_to_xyzquat(data.T_bim_map)
        yaw = math.degrees(math.atan2(data.T_bim_map[1, 0], data.T_bim_map[0, 0]))
        rows += [
            ("T_bim_map: x, y, z", f"{x:.3f}, {y:.3f}, {z:.3f} m"),
            ("T_bim_map: heading", f"{yaw:.2f}°"),
            ("T_bim_map: qx, qy, qz, qw", ", ".join(f"{q:.6f}" for q in quaternion)),
        ]
    if accuracy:
        yaw_rmse = accuracy.get("yaw_rmse_bim_deg")
        rows += [
            ("RMSE in the BIM frame, not aligned", _metres(accuracy.get("rmse_bim_m"))),
            ("Largest error in the BIM frame", _metres(accuracy.get("max_bim_m"))),
            ("RMSE of the heading", NOTHING if yaw_rmse is None else f"{yaw_rmse:.2f}°"),
            ("RMSE of the odometry, aligned (SE(3))", _metres(accuracy.get("rmse_odometry_aligned_m"))),
            ("Poses with a true pose", f"{_count(accuracy.get('matched_poses'))} of "
                                       f"{_count(accuracy.get('total_poses'))}"),
        ]  # fmt: skip
    return _card("Summary", _table((), rows))


def _seconds(data: ReportData) -> str:
    seconds = {k: v for k, v in (data.metrics.get("seconds") or {}).items() if isinstance(v, (int, float))}
    if not seconds:
        return ""
    total = seconds.pop("total", None) or sum(seconds.values())
    rows = "".join(
        f'<tr><th>{escape(stage)}</th><td class="bar">'
        f'<i style="width:{min(100 * s / max(total, 1e-9), 100):.1f}%"></i></td>'
        f'<td class="number">{_seconds_text(s)}</td></tr>'
        for stage, s in seconds.items()
    )
    rows += f'<tr class="total"><th>total</th><td></td><td class="number">{_seconds_text(total)}</td></tr>'
    return _card("Seconds by stage", f"<table>{rows}</table>")


def _rooms(data: ReportData) -> str:
    pairs = (data.matches or {}).get("rooms") or ()
    if not pairs:
        return ""
    ours = data.s_graph.room_by_id
    planned = data.a_graph.room_by_id if data.a_graph else {}

    def name(rooms: dict[str, Any], room_id: str) -> str:
        return (rooms[room_id].name or room_id) if room_id in rooms else room_id

    rows = [(name(ours, s), name(planned, a), f"{c:.2f}") for s, a, c in pairs]
    return _card("Matched rooms", _table(("Room of the map", "Room of the BIM", "Confidence"), rows))


def _hypotheses(data: ReportData) -> str:
    matches = data.matches or {}
    found = matches.get("hypotheses") or ()
    if matches.get("status") == "unique" or not found:
        return ""
    storeys = {f.id: f.name or f.id for f in data.a_graph.floors} if data.a_graph else {}
    rows = []
    for h in found:
        yaw, x, y = h["T_a_s"]
        where = f"{x:.2f}, {y:.2f} m, {math.degrees(yaw):.1f}°"
        storey = storeys.get(h.get("floor"), h.get("floor")) or NOTHING
        rows.append((f"{h['score']:.2f}", str(storey), where, str(len(h.get("rooms") or ()))))
    head = ("Score", "Storey", "Place of the map", "Rooms")
    return _card("Hypotheses", _table(head, rows), str(matches.get("reason") or ""))


def _card(heading: str, content: str, note: str = "") -> str:
    below = f'<p class="muted">{escape(note)}</p>' if note else ""
    return f'<section class="card"><h2>{heading}</h2><div class="scroll">{content}</div>{below}</section>'


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """First cells are row headings where the table has none of its own; last cells stand to the right."""
    top = "".join(f"<th{_right(i, len(head))}>{escape(cell)}</th>" for i, cell in enumerate(head))
    first = "td" if head else "th"
    body = "".join(
        "<tr>" + "".join(
            f"<{first if i == 0 else 'td'}{_right(i, len(row))}>{escape(cell)}</{first if i == 0 else 'td'}>"
            for i, cell in enumerate(row)
        ) + "</tr>"
        for row in rows
    )  # fmt: skip
    return f"<table>{f'<thead><tr>{top}</tr></thead>' if head else ''}<tbody>{body}</tbody></table>"


def _right(index: int, count: int) -> str:
    return ' class="number"' if index == count - 1 else ""


def _length(data: ReportData) -> float:
    positions = data.trajectory_map.positions
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())


def _metres(value: float | None) -> str:
    if value is None:
        return NOTHING
    return f"{value * 100:.1f} cm" if abs(value) < 1 else f"{value:.2f} m"


def _count(value: int | None) -> str:
    return NOTHING if value is None else f"{value:,}"


def _seconds_text(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.1f} s" if abs(value) >= 1 else f"{value * 1000:.0f} ms"
