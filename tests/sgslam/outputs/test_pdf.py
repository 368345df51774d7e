"""The report on paper: each sheet has its head and number, nothing leaves the sheet, and the file is a PDF."""

import dataclasses
import re
from pathlib import Path

import pytest
from element_samples import entries
from report_samples import HOSTILE, not_anchored, sample

from data.common.errors import UserError
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from sgslam.report import ReportData, RunFolder
from sgslam.report.pdf import report_data, sheets, write_pdf
from sgslam.report.pdf.document import MOST_ROWS
from sgslam.report.pdf.sheet import BOTTOM, HEIGHT, MARGIN, WIDTH, Sheet, text_width, wrapped

ABOUT = {"Building": "block.ifc", "Measured": "2026-11-25 09:12 UTC", "Tolerance": "10 mm", "Version": "sgslam 1.2.3"}
LONG = "Basic Wall:Interior - 135mm Partition (2-hr):346701 " * 3 + "W" * 200


def with_elements(copies: int = 1, **changed: str) -> ReportData:
    data = sample()
    assert data.a_graph is not None
    found = [
        entry | changed | {"global_id": f"{k}-{entry['global_id']}"}
        for k in range(copies) for entry in entries(data.a_graph)
    ]  # fmt: skip
    return dataclasses.replace(data, elements=found, metrics=data.metrics | {"about": ABOUT})


def texts(sheet: Sheet) -> list[str]:
    return [text.get_text() for text in sheet.figure.texts]


def test_each_sheet_has_its_head_and_number() -> None:
    made = sheets(with_elements())
    for number, sheet in enumerate(made, 1):
        assert {"block.ifc", ABOUT["Measured"], "sgslam 1.2.3", f"page {number} of {len(made)}"} <= set(texts(sheet))
    said = {text for sheet in made for text in texts(sheet)}
    assert {"As built against as planned", "67 %", "Storey 1", "Wall 30", "Wall without a name", "10 mm"} <= said
    assert any("4 elements that were not seen are not listed" in text for text in said)
    assert "Wall 41" not in said  # it was not seen


@pytest.mark.parametrize("name", [LONG, HOSTILE, ""])
def test_nothing_leaves_its_sheet(name: str) -> None:
    data = with_elements(3, name=name, reason=name, storey="Storey 1")
    data.metrics["about"] = ABOUT | {"Building": name, "Scans": name}
    data.metrics["reason"] = name
    for sheet in sheets(data):
        renderer = sheet.figure.canvas.get_renderer()  # type: ignore[attr-defined]
        scale = 72 / sheet.figure.dpi
        for text in sheet.figure.texts:
            box = text.get_window_extent(renderer)
            assert scale * box.x0 > MARGIN - 2 and scale * box.x1 < WIDTH - MARGIN + 4, text
            assert scale * box.y0 > 0 and scale * box.y1 < HEIGHT, text
            is_foot = scale * box.y0 < HEIGHT - BOTTOM - 4
            assert not is_foot or text.get_text().startswith(("page", "sgslam")), text


def test_long_tables_go_on_with_their_head_and_end_somewhere() -> None:
    made = sheets(with_elements(100))  # 1,200 elements, of which 800 were seen
    pages = [texts(sheet) for sheet in made if any(t.startswith("Planned elements") for t in texts(sheet))]
    assert len(pages) > 10 and all("DIN 18202" in page for page in pages)
    numbers = [text for page in pages for text in page if text.isdecimal()]
    assert [int(number) for number in numbers] == list(range(1, MOST_ROWS + 1))
    assert any(f"The first {MOST_ROWS} of 800" in text for text in pages[0])


def test_lines_are_as_wide_as_they_may_be() -> None:
    """A word that is too wide is broken; none is lost."""
    lines = wrapped(LONG, 100.0, 7.0)
    assert "".join("".join(lines).split()) == "".join(LONG.split())
    assert all(text_width(line, 7.0) <= 100.0 for line in lines) and wrapped("", 10.0, 7.0) == [""]


def test_the_file_is_a_pdf_and_the_same_each_time(tmp_path: Path) -> None:
    count = write_pdf(with_elements(), tmp_path / "report.pdf")
    first = (tmp_path / "report.pdf").read_bytes()
    assert first.startswith(b"%PDF-") and first.rstrip().endswith(b"%%EOF")
    assert len(re.findall(rb"/Type /Page\b", first)) == count > 3
    write_pdf(with_elements(), tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").read_bytes() == first


def test_runs_without_elements_or_a_place_have_sheets_too() -> None:
    guess = sheets(not_anchored("ambiguous"))
    assert any("Not anchored" in text for text in texts(guess[0]))
    standing = Trajectory(sample().trajectory_map.stamps_ns[:1], sample().trajectory_map.poses[:1])
    told = {"reason": "no plan was given"}
    empty = ReportData(None, SceneGraph("map"), standing, standing, None, None, None, told, [])
    assert len(sheets(empty)) == 2  # cover and map
    deviations = texts(sheets(sample())[-1])
    assert "Wall surfaces that deviate significantly" in deviations and "guid-5" in deviations


def test_a_damaged_table_of_elements_is_told_in_one_line(tmp_path: Path) -> None:
    data = sample()
    for name in ("map", "odometry"):
        data.trajectory_map.write_tum(tmp_path / f"trajectory_{name}.tum")
    run = RunFolder(tmp_path, data.s_graph, data.a_graph, data.T_bim_map, {}, [], data.metrics)
    assert report_data(run).elements == []
    (tmp_path / "elements.json").write_text('{"elements": [{"name": "of an older version"}]}')
    with pytest.raises(UserError, match=r"elements\.json: is damaged or of an older version"):
        report_data(run)
