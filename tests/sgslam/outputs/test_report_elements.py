"""The planned elements in the report: counts, table, outlines in the plan, and what a browser does with them."""

import dataclasses
from collections.abc import Iterator

import chromium
import pytest
from chromium import Chromium
from element_samples import NAMELESS, entries
from report_samples import HOSTILE, Page, sample

from sgslam.report import ReportData
from sgslam.report.elements import drawn_elements
from sgslam.report.elements.labels import kind
from sgslam.report.page import report_html, write_report

NAMES = "[...document.querySelectorAll('#elements tbody tr')].filter((r) => !r.hidden).map((r) => r.cells[0].innerText)"
in_browser = pytest.mark.skipif(chromium.COMMAND is None, reason="chromium is not installed")


def with_elements() -> ReportData:
    data = sample()
    assert data.a_graph is not None
    about = {"Building": "block.ifc", "Tolerance": "30 mm"}
    return dataclasses.replace(data, elements=entries(data.a_graph), metrics=data.metrics | {"about": about})


def test_what_needs_a_look_comes_first_and_has_a_name() -> None:
    page = Page(report_html(with_elements()))
    assert not page.open
    table = page.text[page.text.index("Planned elements") :]
    order = ["Wall 30\n", "Wall without a name\n", "Wall 12\n", "Door 7\n", "Wall 3\n", "Wall 0\n", "Slab\n"]
    assert [table.index(name) for name in order] == sorted(table.index(name) for name in order)
    for text in ("67 %", "of 12 planned elements seen", "\N{MINUS SIGN}123.4 mm", "exceeded", "LOA30", "within 30 mm"):
        assert text in page.text, text
    assert NAMELESS not in page.text  # names, not GlobalIds


def test_each_element_of_the_storey_has_an_outline() -> None:
    data = with_elements()
    page = Page(report_html(data))
    drawn = [value for key, value in page.attributes if key == "data-element"]
    rows = [value for key, value in page.attributes if key == "data-id"]
    assert len(drawn) == len(rows) == 12 and set(drawn) == set(rows)
    assert page.layers["layer-elements", "polygon"] == 12
    assert data.a_graph is not None
    lower = next(floor for floor in data.a_graph.floors if floor.id == "F0")
    assert drawn_elements(data.elements, lower) == ()


def test_walls_of_the_deviations_have_their_names() -> None:
    """guid-absent is Wall 12."""
    plain, named = Page(report_html(sample())), Page(report_html(with_elements()))
    assert "guid-absent" in plain.text and "guid-absent" not in named.text


def test_hostile_names_of_elements_are_text() -> None:
    data = with_elements()
    hostile = [dict(e) | {"name": HOSTILE, "reason": HOSTILE, "global_id": HOSTILE} for e in data.elements]
    page, plain = Page(report_html(dataclasses.replace(data, elements=hostile))), Page(report_html(data))
    assert page.tags == plain.tags and page.text.count(HOSTILE) >= 36


def test_kinds_are_words() -> None:
    assert [kind(name) for name in ("IfcWallStandardCase", "IfcCurtainWall", "IfcDoor")] == [
        "Wall", "Curtain wall", "Door",
    ]  # fmt: skip


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    folder = tmp_path_factory.mktemp("page")
    write_report(with_elements(), folder / "report.html")
    with Chromium(folder / "report.html", folder / "profile", (1200, 900)) as opened:
        yield opened


def _head(name: str) -> str:
    return f"[...document.querySelectorAll('#elements thead button')].find((b) => b.innerText.startsWith('{name}'))"


@in_browser
def test_columns_sort_by_numbers_and_what_has_none_comes_last(browser: Chromium) -> None:
    browser.evaluate(f"{_head('Offset')}.click()")
    assert browser.evaluate(NAMES)[:6] == ["Wall 0", "Wall 1", "Wall 2", "Wall 3", "Wall without a name", "Wall 30"]
    browser.evaluate(f"{_head('Offset')}.click()")
    assert browser.evaluate(NAMES)[:2] == ["Wall 30", "Wall without a name"]
    browser.evaluate(f"{_head('Element')}.click()")
    names = browser.evaluate(NAMES)
    assert names[:3] == ["Door 7", "Slab", "Wall 0"] and names.index("Wall 3") < names.index("Wall 12")
    assert browser.evaluate("document.querySelectorAll('[aria-sort=ascending]').length") == 1


@in_browser
def test_words_and_counts_filter_the_table(browser: Chromium) -> None:
    browser.evaluate("document.querySelector('[data-verdict=moved]').click()")
    assert sorted(browser.evaluate(NAMES)) == ["Wall 30", "Wall without a name"]
    type_ = "(() => {{ const s = document.querySelector('#element-search'); s.value = '{}';" \
            " s.dispatchEvent(new Event('input')); }})()"  # fmt: skip
    browser.evaluate(type_.format(f"{NAMELESS[:9]} corridor"))  # by its GlobalId, of those that moved
    assert browser.evaluate(NAMES) == ["Wall without a name"]
    assert browser.evaluate("document.querySelector('#element-count').innerText") == "1 of 12"
    browser.evaluate(type_.format(""))
    browser.evaluate("document.querySelector('[data-verdict=moved]').click()")
    assert len(browser.evaluate(NAMES)) == 12


@in_browser
def test_rows_and_outlines_find_one_another(browser: Chromium) -> None:
    chosen = "[...document.querySelectorAll('.plan .chosen')].map((o) => o.dataset.element)"
    browser.evaluate(f"document.querySelector('[data-id=\"{NAMELESS}\"] button').click()")
    assert browser.evaluate(chosen) == [NAMELESS]
    browser.evaluate("document.querySelector('[data-verdict=absent]').click()")  # its row is hidden now
    other = "1moved000000000000Wall"
    x, y = browser.middle_of(f".plan [data-element='{other}']")
    browser.drag((x, y), (0, 0))
    assert browser.evaluate(chosen) == [other]
    row = browser.evaluate(
        f"(() => {{ const r = document.querySelector('[data-id=\"{other}\"]'); const b = r.getBoundingClientRect();"
        " return [r.className, b.top >= 0 && b.bottom <= innerHeight && b.height > 0]; })()"
    )
    assert row == ["chosen", True]
    assert browser.complaints == []


@in_browser
@pytest.mark.parametrize("width", [1200, 1600])
def test_nothing_is_cut_off(browser: Chromium, width: int) -> None:
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
    browser.settle()
    over = "[...document.querySelectorAll('html, .scroll, .tile, .card')].filter((e) => e.scrollWidth > e.clientWidth)"
    assert browser.evaluate(f"{over}.map((e) => e.className || e.tagName)") == []
