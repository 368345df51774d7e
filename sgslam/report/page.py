"""`report.html`: one self-contained page with the results of a run."""

from collections.abc import Iterator
from dataclasses import replace

from sgslam.as_built.deviation_bands import LIMITS_MM, MINUS, UNPLANNED, band_labels
from sgslam.report import tables
from sgslam.report.contents import DRAWN_HYPOTHESES, ReportData, split_by_floor
from sgslam.report.elements import COLUMNS, NUMBERS, VERDICTS, element_rows, tolerance_presets, verdict_counts
from sgslam.report.error_chart import error_chart, error_lines
from sgslam.report.html_page import TEMPLATES
from sgslam.report.plan_drawing import plan_drawing
from sgslam.report.plan_svg import plan_svg

_DRAWN = ("rooms-matched", "bim-walls", "walls-unmatched", "walls-matched")  # of each


def report_html(data: ReportData) -> str:
    """The page: status, key figures, plan, errors and tables. All strings from data are escaped; it loads no files."""
    drawing, *others = drawings = [plan_drawing(part) for part in split_by_floor(data)]
    anchored, lines = data.T_bim_map is not None, error_lines(data)
    verdicts = verdict_counts(data.elements)
    storeys = {floor.id: floor.name or floor.id for floor in (data.a_graph.floors if data.a_graph else ())}
    return TEMPLATES.get_template("report/report.html").render(
        anchored=anchored,
        badge=tables.badge(data.metrics | {"anchored": anchored}),
        quality=tables.quality_rows(data.metrics),
        metrics=data.metrics,
        accuracy=data.metrics.get("accuracy") or {},
        # the map may have a room in several pieces
        matched_rooms=len({a for s, (a, _) in data.pairs("rooms").items() if s in data.s_graph.room_by_id}),
        figures=[] if anchored else list(_hypothesis_figures(data)),
        drawing=drawing,
        plan=plan_svg(drawing, 'id="plan" class="plan"'),
        layers={name: text for name, text in drawing.labels.items() if any(own.layers[name] for own in drawings)},
        with_deviations=any(own.with_deviations for own in drawings),
        bands=band_labels(),
        limits=[*(f"{MINUS}{mm}" for mm in reversed(LIMITS_MM)), *(f"+{mm}" for mm in LIMITS_MM)],
        verdict_labels={verdict: verdict for verdict in VERDICTS},
        errors=error_chart(data, lines) if lines else "",
        error_lines=lines,
        other_floors=[(other.heading, plan_svg(other)) for other in others],
        summary=tables.summary_rows(data),
        control=tables.control_rows(data.metrics),
        hypotheses=[] if anchored else tables.hypothesis_rows(data.hypotheses, storeys),
        about=data.metrics.get("about") or {},
        elements=element_rows(data.elements),
        element_columns=COLUMNS,
        element_numbers=NUMBERS,
        presets=tolerance_presets(data.tolerance),
        verdicts=verdicts,
        planned=len(data.elements) - verdicts[UNPLANNED],
    )


def _hypothesis_figures(data: ReportData) -> Iterator[str]:
    """The SVG of each of the best hypotheses: the storey with the map on it, a wall counting as matched if its room
    is. None without a BIM."""
    for hypothesis in data.hypotheses[:DRAWN_HYPOTHESES] if data.a_graph is not None else ():
        pairs = [(s, a, 1.0) for s, a in hypothesis.get("rooms") or ()]
        seen = {s for s, _, _ in pairs}
        walls = [(wall.id, "", 1.0) for wall in data.s_graph.wall_surfaces if wall.room in seen]
        drawing = plan_drawing(replace(data, matches={**hypothesis, "rooms": pairs, "wall_surfaces": walls}))
        yield plan_svg(replace(drawing, layers={layer: drawing.layers[layer] for layer in _DRAWN}, names=()))
