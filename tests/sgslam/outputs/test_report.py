"""The report's page: it says what the files say, names are escaped, and nothing is loaded from elsewhere."""

import base64
import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import chromium
import numpy as np
import pytest
from chromium import Chromium
from report_samples import HOSTILE, Page, anchor, not_anchored, on_two_floors, sample, with_lost_scans, without_plan

from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from sgslam.report import ReportData
from sgslam.report.number_formats import signal_texts
from sgslam.report.page import report_html, write_report
from sgslam.report.plan_png import write_plan_png
from sgslam.report.tables import known_rows, relocalised


def nothing_seen() -> ReportData:
    """A run of one scan that saw nothing."""
    standing = Trajectory(np.array([0]), np.eye(4)[None])
    told = {"anchored": False, "reason": "no plan was given"}
    return ReportData(None, SceneGraph("map"), standing, standing, None, None, None, told, [])


def all_lost() -> ReportData:
    data = sample()
    assert data.scans is not None
    return replace(data, scans=replace(data.scans, lost=np.ones(500, bool)), truth=None)


def withdrawn() -> ReportData:
    """A run that lost its place: what its anchors stood on."""
    data = not_anchored("ambiguous")
    return replace(data, anchors=[anchor(own["wall"], own["a_id"], "no longer agrees") for own in data.anchors])


RUNS: dict[str, Callable[[], ReportData]] = {
    "anchored": sample,
    "ambiguous": lambda: not_anchored("ambiguous"),
    "not matched": lambda: not_anchored("none"),
    "without a plan": without_plan,
    "lost for a while": lambda: with_lost_scans(sample()),
    "lost throughout": all_lost,
    "two floors": lambda: on_two_floors(placed=True),
    "a floor that has no place": lambda: on_two_floors(placed=False),
    "nothing seen": nothing_seen,
    "withdrawn": withdrawn,
}


@pytest.mark.parametrize("kind", RUNS)
def test_the_page_needs_nothing_but_itself(kind: str, tmp_path: Path) -> None:
    data = RUNS[kind]()
    html = report_html(data)
    assert not re.search(r"(?i)https?:|//[a-z]|url\(|@import|\bsrc=|\bhref=|fetch\(|XMLHttpRequest", html)
    page = Page(html)
    assert not re.search(r"\bnan\b|\binf\b|None|\[\]|undefined", page.text)
    assert data.metrics["reason"] in page.text
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None and "unsafe" not in policy[1] and "default-src 'none'" in policy[1]
    for tag in ("script", "style"):
        (content,) = re.findall(f"<{tag}>(.*?)</{tag}>", html, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy[1]
    assert not re.search(r"<[^>]* (style|on\w+)=", html)  # neither would work under it
    write_plan_png(data, tmp_path / "plan.png")
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
    assert f"{1000 * abs(moved['offset_m']):.1f} mm" in page.text
    for name, signal in metrics["quality"].items():  # each has a phrase and a unit
        texts = signal_texts(name, signal)
        assert not any("_" in text for text in texts) and set(texts) <= lines
    for line in metrics["advice"]:
        assert line in page.text
    scene = json.loads(page.inside["scene-data"])
    assert len(scene["keyframes"]) == 3 * metrics["keyframes"]


def test_elements_and_deviations_that_need_a_look_come_first() -> None:
    text = Page(report_html(sample())).text
    table = text[text.index("Planned elements") :]
    order = ["Wall 30\n", "Wall without a name\n", "Wall 12\n", "Door 7\n", "Wall 3\n", "Wall 0\n"]
    assert [table.index(name) for name in order] == sorted(table.index(name) for name in order)
    plain = Page(report_html(replace(sample(), elements=[]))).text
    assert plain.index("guid-5\n") < plain.index("guid-7\n") < plain.index("guid-0\n")
    assert "guid-absent" in plain and "guid-absent" not in text  # it is Wall 12


def test_hostile_names_are_text() -> None:
    def renamed(data: ReportData, name: str) -> ReportData:
        """Every name in the run."""
        assert data.a_graph is not None
        a, s = data.a_graph, data.s_graph
        a = replace(
            a,
            rooms=tuple(replace(own, name=name) for own in a.rooms),
            wall_surfaces=tuple(replace(own, source=name) for own in a.wall_surfaces),
            floors=tuple(replace(own, name=name) for own in a.floors),
        )
        return replace(
            data,
            a_graph=a,
            s_graph=replace(s, rooms=tuple(replace(own, name=name) for own in s.rooms)),
            matches={**(data.matches or {}), "reason": name},
            metrics=data.metrics | {"reason": name, "seconds": {name: 1.0}},
            deviations=[own | {"source": name} for own in data.deviations],
            elements=[own | {"name": name, "reason": name} for own in data.elements],
        )

    for data in (sample(), not_anchored("ambiguous")):
        hostile, plain = (Page(report_html(renamed(data, name))) for name in (HOSTILE, "plain"))
        assert hostile.tags == plain.tags
        assert hostile.text.count(HOSTILE) > 15


def test_each_hypothesis_of_an_ambiguous_match_has_its_picture_up_to_four() -> None:
    data = not_anchored("ambiguous")
    page = Page(report_html(data))
    assert page.tags["figure"] == 2 and {"31.5", "30.9"} <= set(page.text.split())
    five = [{"score": -k, "T_a_s": [0.1 * k, 0, 0], "floor": None, "rooms": []} for k in range(5)]
    page = Page(report_html(replace(data, matches={**(data.matches or {}), "hypotheses": five})))
    assert page.tags["figure"] == 4


def test_what_is_not_anchored_or_not_sound_is_shown() -> None:
    data, signal = sample(), {"value": 7.0, "limit": 1, "ok": False}
    within = {"value": 0.0134, "limit": 0.05, "ok": True}
    found = {"anchored_share": 0.925, "quality": {"planned_walls_crossed": signal, "lost_scans": within}}
    text = Page(report_html(replace(data, metrics=data.metrics | found))).text
    assert "92.5 %" in text and "\n7\nat most 1\n" in text and "\n1.34 %\nat most 5 %\n" in text
    assert text.count("outside its limit") == 1
    lost = Page(report_html(with_lost_scans(data))).text
    assert "Lost scans\n30\n" in lost and "Lost scans" not in Page(report_html(data)).text
    for placed, times in ((True, 0), (False, 1)):
        assert Page(report_html(on_two_floors(placed))).text.count("floor-1 of the map") == times


@pytest.mark.parametrize("found", [True, False])
def test_it_is_said_when_the_last_part_was_placed_or_why_not(found: bool) -> None:
    data = with_lost_scans(sample())
    outcome = {"found": found, "found_s": 9.04 if found else None, "reason": "the plan does not explain the map"}
    page = Page(report_html(replace(data, metrics=data.metrics | {"returned": outcome})))
    assert (outcome["reason"] in page.text) == (not found)
    assert ("9.0 s" in relocalised(outcome)) == found and outcome["reason"] in relocalised(outcome)
    sigma = {"position_sigma_m": {"value": 0.0194, "limit": 0.2, "ok": True}}
    ((whose, said),) = known_rows({"anchored": found, "quality": sigma})
    assert ("anchored" in whose) == found and "19.4 mm" in said


def test_long_runs_in_large_buildings_stay_small() -> None:
    data = sample(count=36_000, rooms_a_side=30)
    assert data.scans is not None
    sigma = np.random.default_rng(0).uniform(0.005, 0.3, (36_000, 2))
    html = report_html(replace(data, scans=replace(data.scans, sigma=sigma)))
    assert len(html) < 1_000_000
    numbers = json.loads(Page(html).inside["scene-data"])["keyframes"]
    assert all(isinstance(v, int) and abs(v) < 1_000_000 for v in numbers)  # millimetres from the building's middle


@pytest.mark.skipif(chromium.COMMAND is None, reason="chromium is not installed")
def test_a_browser_runs_the_page_and_nothing_else(tmp_path: Path) -> None:
    write_report(sample(), tmp_path / "report.html")
    rows = "[...document.querySelectorAll('#elements tbody tr')].filter((row) => !row.hidden).length"
    with Chromium(tmp_path / "report.html", tmp_path / "profile") as browser:
        assert browser.evaluate(rows) == 9
        browser.evaluate("document.querySelector('[data-verdict=moved]').click()")
        assert browser.evaluate(rows) == 2
        browser.evaluate("document.querySelectorAll('input, button').forEach((own) => own.click())")
        assert browser.complaints == []
        browser.evaluate(
            "(() => { const s = document.createElement('script');"
            " s.textContent = 'window.broken = 1'; document.body.append(s); })()"
        )
        assert browser.evaluate("window.broken === undefined")
