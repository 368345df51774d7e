"""The report: it says what the files say, names are escaped, nothing is loaded."""

import base64
import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import chromium
import numpy as np
import pytest
from chromium import Chromium
from report_samples import Page, anchor, not_anchored, on_two_floors, reported, verdict, with_lost_scans, without_plan

from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from sgslam.as_built.elements.likelihoods import judged
from sgslam.report import ReportData
from sgslam.report.elements import VERDICTS
from sgslam.report.number_formats import signal_texts
from sgslam.report.page import report_html
from sgslam.report.plan_png import write_plan_png

HOSTILE = "<script>alert('x')</script> & \"Söhne\" $\\frac$ " + "W" * 200


@pytest.fixture(scope="module")
def data(anchored_run: Path) -> ReportData:
    return reported(anchored_run)


def nothing_seen(_: ReportData) -> ReportData:
    """A run of one scan."""
    standing = Trajectory(np.array([0]), np.eye(4)[None])
    told = {"anchored": False, "reason": "no plan was given"}
    return ReportData(None, SceneGraph("map"), standing, standing, None, None, None, told, [])


def withdrawn(data: ReportData) -> ReportData:
    """It lost its place, and what its anchors stood on; a signal is outside its limit."""
    anchors = [anchor(own["wall"], own["a_id"], "no longer agrees") for own in data.anchors]
    run = replace(with_lost_scans(not_anchored(data, "ambiguous")), anchors=anchors)
    quality = {"place_probability": {"value": 0.77, "limit": 0.9, "ok": False}}
    return replace(run, metrics=run.metrics | {"quality": quality})


def less_than_sure(data: ReportData) -> ReportData:
    """It is anchored, but what it saw speaks against its map."""
    signals = {"plan_tilt_deg": {"value": 0.1, "nats": 1.3}, "walls_looked_through": {"value": 0.2, "nats": -2.0}}
    place = data.metrics["place"] | {"probability": 0.958, "sound": 0.959, "signals": signals}
    return replace(data, metrics=data.metrics | {"place": place})


RUNS: dict[str, tuple[Callable[[ReportData], ReportData], tuple[str, ...]]] = {
    "withdrawn": (
        withdrawn,
        ("no longer agrees", "Lost scans\n30\n", "\n77 %\nat least 90 %\n", "outside its limit"),
    ),
    "less than sure": (less_than_sure, ("not certain: that the map is not sound 4.1 %, by walls looked through",)),
    "without a plan": (without_plan, ()),
    "lost": (lambda data: replace(with_lost_scans(data), truth=None), ("Lost scans\n30\n",)),
    "two floors": (lambda data: on_two_floors(data, placed=False), ("floor-1 of the map",)),
    "nothing seen": (nothing_seen, ()),
}


@pytest.mark.parametrize("kind", RUNS)
def test_any_run_has_a_page_that_needs_nothing_but_itself(kind: str, data: ReportData, tmp_path: Path) -> None:
    change, said = RUNS[kind]
    run = change(data)
    html = report_html(run)
    assert not re.search(r"(?i)https?:|//[a-z]|url\(|@import|\bsrc=|\bhref=|fetch\(|XMLHttpRequest", html)
    page = Page(html)
    assert not re.search(r"\bnan\b|\binf\b|None|\[\]|undefined", page.text)
    assert all(text in page.text for text in (*said, run.metrics["reason"]))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None and "unsafe" not in policy[1] and "default-src 'none'" in policy[1]
    for tag in ("script", "style"):
        (content,) = re.findall(f"<{tag}>(.*?)</{tag}>", html, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy[1]
    assert not re.search(r"<[^>]* (style|on\w+)=", html)  # neither would work under it
    write_plan_png(run, tmp_path / "plan.png")
    assert (tmp_path / "plan.png").stat().st_size > 1000


def test_the_page_says_what_the_files_say(anchored_run: Path) -> None:
    out = anchored_run / "out"
    page = Page((out / "report.html").read_text())
    metrics, elements, matches = (
        json.loads((out / f"{name}.json").read_text()) for name in ("metrics", "elements", "matches")
    )
    planned = SceneGraph.load(out / "a_graph.json")
    lines = set(page.text.splitlines())
    assert {f"{1000 * metrics['accuracy'][name]:.1f} mm" for name in ("rmse_bim_m", "max_bim_m")} <= lines
    assert {str(metrics[name]) for name in ("scans", "keyframes")} <= lines
    assert {planned.room_by_id[a_id].name for _, a_id, _ in matches["rooms"]} <= lines
    assert metrics["reason"] in page.text and "small.ifc" in page.text
    seen = [own for own in elements["elements"] if own["verdict"] != "not seen"]
    assert len(seen) > 5 and {own["name"] for own in seen} <= lines
    (moved,) = (own for own in seen if own["verdict"] == "moved")
    table = page.text[page.text.index("Planned elements") :]
    assert f"{1000 * abs(moved['offset_m']):.1f} mm" in table
    assert all(table.index(f"{moved['name']}\n") <= table.index(f"{own['name']}\n") for own in seen)  # it comes first
    for name, signal in metrics["quality"].items():  # each has a phrase and a unit
        found = signal_texts(name, signal)
        assert not any("_" in text for text in found) and set(found) <= lines
    assert "outside its limit" not in page.text


def test_hostile_names_are_text(data: ReportData) -> None:
    assert data.a_graph is not None
    runs = {}
    for name in (HOSTILE, "plain"):
        metrics = data.metrics | {"reason": name, "about": {"Building": name, "Version": "sgslam"}}
        elements = [own | {"name": name, "reason": name} for own in data.elements]
        rooms = tuple(replace(own, name=name) for own in data.a_graph.rooms)
        runs[name] = replace(data, metrics=metrics, elements=elements), replace(data.a_graph, rooms=rooms)
    hostile, plain = (Page(report_html(replace(run, a_graph=a_graph))) for run, a_graph in runs.values())
    assert hostile.tags == plain.tags and hostile.text.count(HOSTILE) > 10


@pytest.mark.skipif(chromium.COMMAND is None, reason="chromium is not installed")
def test_a_browser_runs_the_page_and_nothing_else(anchored_run: Path, tmp_path: Path) -> None:
    rows = "[...document.querySelectorAll('#elements tbody tr')].filter((row) => !row.hidden).length"
    with Chromium(anchored_run / "out/report.html", tmp_path / "profile") as browser:
        before = browser.evaluate(rows)
        browser.evaluate("document.querySelector('[data-verdict=moved]').click()")
        assert browser.evaluate(rows) == 1 < before
        browser.evaluate("document.querySelectorAll('input, button').forEach((own) => own.click())")
        assert browser.complaints == []
        browser.evaluate(
            "(() => { const s = document.createElement('script');"
            " s.textContent = 'window.broken = 1'; document.body.append(s); })()"
        )
        assert browser.evaluate("window.broken === undefined")


@pytest.mark.skipif(chromium.COMMAND is None, reason="chromium is not installed")
def test_the_page_judges_by_any_tolerance_as_python_does_and_keeps_it_in_its_address(
    data: ReportData, tmp_path: Path
) -> None:
    assert data.a_graph is not None
    offsets, sigmas, limits = (-0.2, -0.04, -0.03, 0.0, 0.016, 0.029, 0.05), (0.001, 0.008, 0.04), (0.03, 0.016, 0.2)
    cases = [(offset, sigma, doubt) for offset in offsets for sigma in sigmas for doubt in (False, True)]
    elements = []
    for k, case in enumerate(cases):
        told, kept = judged(*case, 0.03)
        of = {"tolerance": kept, "doubt": case[2], "sigma_m": case[1], "storey": data.a_graph.floors[0].name}
        elements.append(asdict(verdict(f"W{k}", told, case[0], **of)))
    page = tmp_path / "report.html"
    page.write_text(report_html(replace(data, elements=elements, tolerance=0.03)))
    shown = """[...document.querySelectorAll("#elements tbody tr")].map((row) => [Number(row.dataset.id.slice(1)),
        row.cells[4].textContent, row.cells[6].textContent]).sort((a, b) => a[0] - b[0])"""
    outlines = "[...document.querySelectorAll('polygon[data-element=W1]')].map((own) => own.className.baseVal)"
    counts = "[...document.querySelectorAll('[data-verdict]')].map((own) => own.innerText.split(/\\s+/, 1)[0])"
    hidden = "document.querySelectorAll('#elements tbody tr[hidden]').length"
    with Chromium(page, tmp_path / "profile") as browser:
        for limit in limits:
            browser.evaluate(
                f"document.getElementById('tolerance').value = {1000 * limit:g};"
                "document.getElementById('tolerance').dispatchEvent(new Event('input'))"
            )
            expected = [judged(*case, limit) for case in cases]
            assert browser.evaluate(shown) == [[k, *own] for k, own in enumerate(expected)]
            assert browser.evaluate(outlines) == [f"verdict-{expected[1][0].replace(' ', '-')}"]
            told = [verdict for verdict, _ in expected]
            assert browser.evaluate(counts) == [str(told.count(name)) for name in VERDICTS]
        browser.evaluate("document.querySelector('[data-verdict=uncertain]').click()")
        browser.evaluate("document.querySelectorAll('#elements th button')[7].click()")  # by offset
        address, *seen = (browser.evaluate(own) for own in ("location.href", shown, hidden))
        assert browser.complaints == []
    assert address.endswith("#wall=200&slab=200&opening=200&verdict=uncertain&sort=Offset&order=ascending")
    with Chromium(address, tmp_path / "another") as browser:
        assert [browser.evaluate(own) for own in (shown, hidden)] == seen
        assert browser.evaluate("document.querySelector('[aria-sort=ascending]').textContent") == "Offset"
        browser.evaluate("document.querySelectorAll('.tolerance button')[1].click()")  # DIN 18202
        assert browser.evaluate("location.hash").startswith("#wall=16&slab=16&opening=12&")
        assert browser.evaluate(shown) == [[k, *judged(*case, 0.016)] for k, case in enumerate(cases)]
