"""`report.html`: one self-contained page with the results of a run."""

from pathlib import Path

from data.common.files import write_atomically
from sgslam.as_built.deviation_bands import LIMITS_MM, MINUS, band_labels
from sgslam.report import tables
from sgslam.report.contents import ReportData, split_by_floor
from sgslam.report.elements import COLUMNS, VERDICTS, coverage, element_rows, planned_count, verdict_counts
from sgslam.report.error_chart import chart_data, error_chart, error_lines
from sgslam.report.html_page import TEMPLATES
from sgslam.report.hypothesis_plans import hypothesis_figures
from sgslam.report.plan_drawing import plan_drawing
from sgslam.report.plan_svg import plan_svg, present_layers
from sgslam.report.scene_3d import scene_data, scene_layers


def write_report(data: ReportData, path: Path | str) -> None:
    """Writes the page atomically; it loads no other files."""
    write_atomically(path, report_html(data))


def report_html(data: ReportData) -> str:
    """The page: status, key figures, plan, 3D view, errors and tables. All strings from data are escaped."""
    drawing, *others = drawings = [plan_drawing(part) for part in split_by_floor(data)]
    anchored, lines = data.T_bim_map is not None, error_lines(data)
    scene = scene_data(drawing)
    embedded = {"scene-data": scene}
    if lines:
        embedded["chart-data"] = chart_data(data, lines, drawing)
    deviation_rows, deviation_looks = tables.deviation_rows(data)
    return TEMPLATES.get_template("report/report.html").render(
        anchored=anchored, embedded=embedded, badge=tables.badge(data.metrics | {"anchored": anchored}),
        quality=tables.quality_rows(data.metrics),
        metrics=data.metrics, accuracy=data.metrics.get("accuracy") or {}, matched_rooms=data.matched_rooms(),
        figures=[] if anchored else hypothesis_figures(data), drawing=drawing, plan=plan_svg(drawing),
        layers=present_layers(drawings), with_deviations=any(one.with_deviations for one in drawings),
        bands=band_labels(), limits=[*(f"{MINUS}{mm}" for mm in reversed(LIMITS_MM)), *(f"+{mm}" for mm in LIMITS_MM)],
        verdict_labels={verdict: verdict for verdict in VERDICTS},
        scene_layers=scene_layers(drawing, scene), errors=error_chart(data, lines) if lines else "", error_lines=lines,
        other_floors=[(other.heading, plan_svg(other, f"plan-{k}")) for k, other in enumerate(others, 1)],
        deviations=data.deviations, significant=sum(bool(d["significant"]) for d in data.deviations),
        deviation_rows=deviation_rows, deviation_looks=deviation_looks, summary=tables.summary_rows(data),
        hypotheses=[] if anchored else tables.hypothesis_rows(data), rooms=tables.room_rows(data),
        stages=tables.stages_and_total(data.metrics), about=data.metrics.get("about") or {},
        elements=element_rows(data.elements), element_columns=COLUMNS, coverage=coverage(data.elements),
        verdicts=verdict_counts(data.elements), planned=planned_count(data.elements),
    )  # fmt: skip
