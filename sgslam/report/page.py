"""`report.html`: one self-contained page that says what the run found, and shows it on the plan."""

from html import escape
from pathlib import Path

from data.common.files import write_atomically
from sgslam.report.contents import ReportData, floor_by_floor
from sgslam.report.error_chart import chart_data, error_chart, error_lines
from sgslam.report.html_page import page
from sgslam.report.html_parts import card, count, metres, seconds
from sgslam.report.hypothesis_plans import hypothesis_plans
from sgslam.report.plan_drawing import PlanDrawing, plan_drawing
from sgslam.report.plan_svg import legend, plan_svg
from sgslam.report.scene_3d import scene_card, scene_data
from sgslam.report.tables import tables

STYLES = ("report.css",)
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
    drawing, *others = (plan_drawing(part) for part in floor_by_floor(data))
    lines = error_lines(data)
    parts = [_verdict(data), _tiles(data), _hypotheses(data), _plan(drawing)]
    parts += [card(other.heading, plan_svg(other, f"plan-{k}")) for k, other in enumerate(others, 1)]
    parts.append(card("In 3D", scene_card(drawing)))
    embedded = {"scene-data": scene_data(drawing)}
    if lines:
        parts.append(card("Error against the truth", error_chart(data, lines)))
        embedded["chart-data"] = chart_data(data, lines, drawing)
    parts.append(tables(data))
    return page("Run report", "\n".join(parts), STYLES, SCRIPTS, embedded)


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
