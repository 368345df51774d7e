"""The report on paper: each sheet has its head and number, nothing leaves the sheet, and the file is a PDF."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from report_samples import HOSTILE, not_anchored, sample, without_plan

from data.common.errors import UserError
from sgslam.report import ReportData, RunFolder
from sgslam.report.pdf import report_data, sheets, write_pdf
from sgslam.report.pdf.document import MOST_ROWS
from sgslam.report.pdf.sheet import HEIGHT, WIDTH, Sheet, text_width, wrapped

LONG = "Basic Wall:Interior - 135mm Partition (2-hr):346701 " * 3 + "W" * 200


def with_elements(copies: int, **changed: str) -> ReportData:
    data = sample()
    found = [own | changed | {"global_id": f"{k} {own['global_id']}"} for k in range(copies) for own in data.elements]
    return replace(data, elements=found)


def texts(sheet: Sheet) -> list[str]:
    return [text.get_text() for text in sheet.figure.texts]


def test_each_sheet_has_its_head_and_number() -> None:
    made = sheets(sample())
    for number, sheet in enumerate(made, 1):
        assert {"block.ifc", "sgslam 1.2.3", f"page {number} of {len(made)}"} <= set(texts(sheet))
    said = {text for sheet in made for text in texts(sheet)}
    assert {"Storey 1", "Wall 30", "Wall without a name", "30 mm"} <= said
    assert "Wall 41" not in said  # it was not seen
    for data, reason in ((not_anchored("ambiguous"), "two places fit alike"), (without_plan(), "no plan was given")):
        assert any(reason in text for text in texts(sheets(data)[0]))
    assert "guid-5" in texts(
        sheets(replace(sample(), elements=[]))[-1]
    )  # deviations of walls, where no element is known


@pytest.mark.parametrize("name", [LONG, HOSTILE, ""])
def test_nothing_leaves_its_sheet(name: str) -> None:
    data = with_elements(3, name=name, reason=name)
    about = {"Building": name, "Scans": name, "Version": "sgslam"}
    for sheet in sheets(replace(data, metrics=data.metrics | {"about": about, "reason": name})):
        renderer, scale = sheet.figure.canvas.get_renderer(), 72 / sheet.figure.dpi  # type: ignore[attr-defined]
        boxes = [text.get_window_extent(renderer) for text in sheet.figure.texts]
        assert min(scale * box.x0 for box in boxes) > 0 and max(scale * box.x1 for box in boxes) < WIDTH
        assert min(scale * box.y0 for box in boxes) > 0 and max(scale * box.y1 for box in boxes) < HEIGHT


def test_long_tables_go_on_with_their_head_and_end_somewhere() -> None:
    made = sheets(with_elements(100))  # 900 elements, of which 800 were seen
    pages = [texts(sheet) for sheet in made[1:] if "DIN 18202" in texts(sheet)]
    assert len(pages) > 10
    numbers = [int(text) for page in pages for text in page if text.isdecimal()]
    assert numbers == list(range(1, MOST_ROWS + 1)) and any("800" in text for text in pages[0])


def test_a_word_that_is_too_wide_is_broken_and_none_is_lost() -> None:
    lines = wrapped(LONG, 100.0, 7.0)
    assert "".join("".join(lines).split()) == "".join(LONG.split())
    assert all(text_width(line, 7.0) <= 100.0 for line in lines) and wrapped("", 10.0, 7.0) == [""]


def test_the_file_is_a_pdf_and_the_same_each_time(tmp_path: Path) -> None:
    count = write_pdf(sample(), tmp_path / "report.pdf")
    first = (tmp_path / "report.pdf").read_bytes()
    assert first.startswith(b"%PDF-") and len(re.findall(rb"/Type /Page\b", first)) == count > 3
    write_pdf(sample(), tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").read_bytes() == first


def test_a_damaged_table_of_elements_is_refused(tmp_path: Path) -> None:
    data = sample()
    for name in ("map", "odometry"):
        data.trajectory_map.write_tum(tmp_path / f"trajectory_{name}.tum")
    run = RunFolder(tmp_path, data.s_graph, data.a_graph, data.T_bim_map, {}, [], data.metrics)
    assert report_data(run).elements == []
    (tmp_path / "elements.json").write_text('{"elements": [{"name": "of an older version"}]}')
    with pytest.raises(UserError, match=r"elements\.json: is damaged"):
        report_data(run)
