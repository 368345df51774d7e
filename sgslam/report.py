"""`report.html`: one self-contained page that says what the run found, and shows it on the plan."""

import base64
import hashlib
import json
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from data.files import write_atomically
from sgslam.error_chart import chart_data, error_chart, error_lines
from sgslam.html_parts import card, count, metres, seconds
from sgslam.hypothesis_plans import hypothesis_plans
from sgslam.plan_drawing import PlanDrawing, plan_drawing
from sgslam.plan_svg import legend, plan_svg
from sgslam.report_data import ReportData
from sgslam.report_tables import tables
from sgslam.scene_view import scene_card, scene_data

SCRIPTS = ("report_plan.js", "report_scene.js", "report_chart.js")
HELP = {
    "ambiguous": "What helps: driving into more rooms; naming the storey (--storey NAME); telling roughly where the "
    "drive begins (--start X,Y,YAW).",
    "none": "What helps: checking that this is the model of the building that was scanned; driving into more rooms.",
}


def write_report(data: ReportData, path: Path | str) -> None:
    """Writes the page atomically; it opens from disk and loads nothing else."""
    write_atomically(path, report_html(data))


def report_html(data: ReportData) -> str:
    """The page: verdict, key numbers, plan, 3D view, errors, and tables. All strings from data are escaped."""
    drawing = plan_drawing(data)
    lines = error_lines(data)
    parts = [_verdict(data), _tiles(data), _hypotheses(data), _plan(drawing), card("In 3D", scene_card(drawing))]
    embedded = {"scene-data": scene_data(drawing)}
    if lines:
        parts.append(card("Error against the truth", error_chart(data, lines)))
        embedded["chart-data"] = chart_data(data, lines, drawing)
    parts.append(tables(data))
    return _page("\n".join(parts), embedded)


def _page(body: str, embedded: dict[str, Any]) -> str:
    """The document. The browser itself refuses whatever is not in it, and any script or style but these two."""
    css = _read("report.css")
    script = "\n" + "".join(_read(name) for name in SCRIPTS)
    policy = f"default-src 'none'; style-src '{_digest(css)}'; script-src '{_digest(script)}'"
    blocks = "".join(
        f'<script type="application/json" id="{name}">{_json(value)}</script>\n' for name, value in embedded.items()
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Run report</title>\n<style>{css}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n"
        f"{blocks}<script>{script}</script>\n</body>\n</html>\n"
    )


def _read(name: str) -> str:
    return files("sgslam").joinpath(name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _json(value: Any) -> str:
    """JSON that cannot end the script element that it stands in."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _verdict(data: ReportData) -> str:
    anchored = data.T_bim_map is not None
    look, verdict = ("good", "Anchored") if anchored else ("wait", "Not anchored")
    badge = f'<span class="badge {look}">{verdict}</span>'
    reason = escape(str(data.metrics.get("reason") or ""))
    head = f'<header><h1>Run report</h1>{badge}</header>\n<p class="{"muted" if anchored else "reason"}">{reason}</p>'
    status = str((data.matches or {}).get("status"))
    return head + (f'\n<p class="muted">{HELP[status]}</p>' if not anchored and data.a_graph and status in HELP else "")


def _tiles(data: ReportData) -> str:
    m, accuracy = data.metrics, data.metrics.get("accuracy") or {}
    tiles: list[tuple[str, str]] = []
    if accuracy.get("rmse_bim_m") is not None:
        tiles.append((metres(accuracy["rmse_bim_m"]), "RMSE in the BIM frame"))
    elif accuracy.get("rmse_odometry_aligned_m") is not None:
        tiles.append((metres(accuracy["rmse_odometry_aligned_m"]), "RMSE of the odometry, aligned"))
    if data.T_bim_map is not None:
        tiles.append((f"{data.matched_rooms()} of {count(m.get('rooms'))}", "rooms matched"))
    else:
        tiles.append((count(m.get("rooms")), "rooms"))
    if data.deviations:
        moved = sum(bool(d["significant"]) for d in data.deviations)
        tiles.append((f"{moved} of {len(data.deviations)}", "wall surfaces off the plan"))
    tiles += [
        (count(m.get("wall_surfaces")), "mapped wall surfaces"),
        (count(m.get("scans")), "scans"),
        (count(m.get("keyframes")), "keyframes"),
        (seconds((m.get("seconds") or {}).get("total")), "in all"),
    ]
    return '<div class="tiles">' + "".join(
        f'<div class="tile"><b>{escape(value)}</b><span>{name}</span></div>' for value, name in tiles
    ) + "</div>"  # fmt: skip


def _hypotheses(data: ReportData) -> str:
    plans = hypothesis_plans(data) if data.T_bim_map is None else ""
    note = "The map placed by each hypothesis, the best first; none of them was committed to."
    return card("Where the map might lie", plans, note) if plans else ""


def _plan(drawing: PlanDrawing) -> str:
    note = (
        "Scroll to zoom, drag to move, double click to see all of it again; point at a wall or a room for its name"
        f"{' and its deviation' if drawing.with_deviations else ''}."
    )
    return card(drawing.heading, plan_svg(drawing) + legend(drawing), note)
