"""The page in a real browser: nothing to complain about, and what moves, moves."""

import dataclasses
from collections.abc import Iterator

import chromium
import numpy as np
import pytest
from chromium import Chromium
from report_samples import sample

from data.trajectory import Trajectory
from sgslam.report.page import write_report

pytestmark = pytest.mark.skipif(chromium.COMMAND is None, reason="chromium is not installed")
VIEW = "document.querySelector('#scene').dataset.view.split(' ').map(Number)"  # yaw, pitch, zoom, x, y
BOX = "document.querySelector('#plan').getAttribute('viewBox').split(' ').map(Number)"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    folder = tmp_path_factory.mktemp("page")
    data = sample()
    poses = data.trajectory_map.poses.copy()
    poses[:, 0, 3] += 0.02
    data = dataclasses.replace(data, trajectory_map=Trajectory(data.trajectory_map.stamps_ns, poses))
    write_report(data, folder / "report.html")
    with Chromium(folder / "report.html", folder / "profile") as opened:
        yield opened


def colours(browser: Chromium) -> int:
    """How many colours the 3D view shows."""
    return int(browser.evaluate(
        "(() => { const c = document.querySelector('#scene');"
        " const o = new OffscreenCanvas(c.width, c.height).getContext('2d', {willReadFrequently: true});"
        " o.drawImage(c, 0, 0);"
        " return new Set(new Uint32Array(o.getImageData(0, 0, c.width, c.height).data.buffer)).size; })()"
    ))  # fmt: skip


def test_nothing_to_complain_about(browser: Chromium) -> None:
    assert browser.complaints == []
    assert browser.evaluate("document.querySelectorAll('.layer-bim-walls polyline').length") > 36
    assert colours(browser) > 20


def test_the_policy_stops_scripts_that_are_not_the_pages(browser: Chromium) -> None:
    browser.evaluate(
        "(() => { const s = document.createElement('script');"
        " s.textContent = 'window.broken = 1'; document.body.append(s);"
        " const e = document.createElement('b'); e.innerHTML = '<img src=x onerror=\"window.broken = 1\">';"
        " document.body.append(e); })()"
    )
    browser.settle()
    assert browser.evaluate("window.broken === undefined")
    assert browser.complaints and all("Content Security Policy" in c for c in browser.complaints)
    browser.complaints.clear()


def test_the_scene_turns_moves_and_zooms(browser: Chromium) -> None:
    at = browser.middle_of("#scene")
    first = np.array(browser.evaluate(VIEW))
    before = browser.evaluate("document.querySelector('#scene').toDataURL()")
    browser.drag(at, (100, 40))
    turned = np.array(browser.evaluate(VIEW))
    assert turned[0] < first[0] - 0.5 and turned[1] > first[1] + 0.2 and np.array_equal(turned[2:], first[2:])
    assert browser.evaluate("document.querySelector('#scene').toDataURL()") != before
    browser.drag(at, (0, 2000))
    assert browser.evaluate(VIEW)[1] == pytest.approx(np.pi / 2, abs=1e-3)  # from above, no further
    browser.drag(at, (60, 0), modifiers=8)
    moved = np.array(browser.evaluate(VIEW))
    assert np.hypot(*moved[3:]) > 0.5 and moved[0] == turned[0]
    browser.evaluate("new Promise((go) => setTimeout(go, 450))")  # the page was being scrolled until now
    x, y = at
    browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-300)
    browser.settle()
    assert browser.evaluate(VIEW)[2] > 1.4
    browser.evaluate("document.querySelector('#scene').dispatchEvent(new MouseEvent('dblclick'))")
    browser.settle()
    assert np.array_equal(browser.evaluate(VIEW), first)


def test_two_fingers_zoom(browser: Chromium) -> None:
    x, y = browser.middle_of("#scene")
    first = browser.evaluate(VIEW)[2]
    for kind, half in (("touchStart", 40), ("touchMove", 60), ("touchMove", 80), ("touchEnd", 0)):
        points = [{"x": x - half, "y": y, "id": 0}, {"x": x + half, "y": y, "id": 1}] if half else []
        browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
    browser.settle()
    assert browser.evaluate(VIEW)[2] == pytest.approx(2 * first, rel=0.1)


def test_layers_are_switched_off(browser: Chromium) -> None:
    many = colours(browser)
    for name in ("walls-matched", "trajectory", "keyframes"):
        browser.evaluate(f"document.querySelector('[data-solid={name}]').click()")
    browser.settle()
    assert colours(browser) < many
    hidden = "getComputedStyle(document.querySelector('#plan .layer-truth')).display"
    assert browser.evaluate(hidden) != "none"
    browser.evaluate("document.querySelector('[data-layer=truth]').click()")
    assert browser.evaluate(hidden) == "none"


def test_the_plan_moves_and_tables_point_at_walls(browser: Chromium) -> None:
    at = browser.middle_of("#plan")
    before = np.array(browser.evaluate(BOX))
    browser.drag(at, (50, 0))
    after = np.array(browser.evaluate(BOX))
    assert after[0] < before[0] - 0.3 and np.allclose(after[1:], before[1:])
    x, y = browser.middle_of("[data-shows]")
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    shown = browser.evaluate("[...document.querySelectorAll('#plan .shown')].map((e) => e.dataset.wall)")
    assert shown == [browser.evaluate("document.querySelector('[data-shows]').dataset.shows")]


def test_pointing_at_the_chart_tells_time_error_and_place(browser: Chromium) -> None:
    x, y = browser.middle_of("#errors")
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    browser.settle()
    text = browser.evaluate("document.querySelector('#readout').textContent")
    assert text.startswith("After 2") and "2.0 cm" in text and "odometry" in text
    assert browser.evaluate("getComputedStyle(document.querySelector('#marker')).visibility") == "visible"


def test_both_colour_schemes_have_every_colour(browser: Chromium) -> None:
    def palette(scheme: str) -> list[str]:
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        browser.settle()
        return list(browser.evaluate(
            "[...document.querySelectorAll('.deviation-scale rect')].map((e) => getComputedStyle(e).fill)"
        ))  # fmt: skip

    light, dark = palette("light"), palette("dark")
    assert len(set(light)) == len(set(dark)) == 7 and not set(light) & set(dark)
    assert browser.complaints == []
