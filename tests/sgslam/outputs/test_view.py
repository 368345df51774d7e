"""A run as a page in the browser: what it shows is where it belongs, and the run is the same as without it."""

import json
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import chromium
import numpy as np
import pytest
from chromium import Chromium
from commands import refused
from drives import small_drive, small_run

from data.scene_graph import Floor, SceneGraph
from data.trajectory import Trajectory
from sgslam.slam import SceneGraphSlam
from sgslam.viewer import live as live_view
from sgslam.viewer.finished import FinishedRun, FinishedView
from sgslam.viewer.live import LiveView
from sgslam.viewer.page import Page
from sgslam.viewer.panel import hypothesis_table

pytestmark = pytest.mark.skipif(find_spec("viser") is None, reason="viser is not installed (extra view)")
ANY = ("127.0.0.1", 0)


@pytest.fixture
def page() -> Iterator[Page]:
    opened = Page(ANY)
    yield opened
    opened.close()


@pytest.fixture
def two_storeys(anchored_run: Path, tmp_path: Path) -> Path:
    """The folder of an anchored run, in whose plan there is one more storey; it may be changed."""
    folder = Path(shutil.copytree(anchored_run / "out", tmp_path / "out"))
    plan = SceneGraph.load(folder / "a_graph.json")
    attic, upper = replace(plan.rooms[0], id="attic", floor="upper"), Floor("upper", "Upper", 46.0)
    replace(plan, rooms=(*plan.rooms, attic), floors=(*plan.floors, upper)).save(folder / "a_graph.json")
    return folder


@pytest.mark.slow
def test_the_page_follows_the_run_which_is_the_same_and_draws_matched_walls_at_planned_ones(
    page: Page, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    vt = pytest.importorskip("viser.transforms")
    monkeypatch.setattr(live_view, "EVERY_S", 0.0)
    monkeypatch.setattr(live_view, "SHARE", 0.5)
    drive, headings = small_drive(), []
    view, slam = LiveView(page, drive.bim.graph, drive.truth), SceneGraphSlam(drive.bim)
    for k, (stamp_ns, points) in enumerate(drive.scans):
        update = slam.add_scan(stamp_ns, points, np.zeros(len(points)))
        view.add_scan(slam, update, points)
        if k % 20 == 0:
            headings.append(str(view.panel.status.content))
    seen, alone = slam.finish(), small_run(with_bim=True)[1]
    assert seen.trajectory.poses.tobytes() == alone.trajectory.poses.tobytes()
    assert seen.s_graph == alone.s_graph and seen.deviations == alone.deviations and seen.anchors == alone.anchors
    assert "Not anchored yet" in headings[0] and any("Anchored, on Ground" in heading for heading in headings)
    assert {"/plan/Ground/plan/walls", "/matches/floor-0", "/map/scan", "/map/sensor", "/truth"} <= page.names
    feet = page["/map/floor-0/walls/matched-feet"].points
    turn = vt.SO3(page["/map"].wxyz).as_matrix()
    walls = feet @ turn.T + page["/map"].position + page.origin
    planes = np.array([(*w.normal, -np.dot(w.normal, w.centroid)) for w in drive.bim.graph.wall_surfaces])
    off = np.abs(walls[:, :, :2] @ planes[:, :2].T + planes[:, 2])
    assert len(walls) > 6 and off.max(axis=1).min(axis=1).max() < 0.1
    assert np.abs(walls[..., 2] - 43.0).max() < 0.2  # the floor's height
    monkeypatch.setattr(page, "lines", lambda *_, **__: 1 / 0)
    failing = LiveView(page)
    failing.add_scan(slam, update, points)
    assert "no longer updated: ZeroDivisionError" in caplog.text


def test_a_finished_run_is_played(page: Page, anchored_run: Path) -> None:
    run = FinishedRun(anchored_run / "out", Trajectory.read_tum(anchored_run / "truth.tum"))
    view = FinishedView(page, [run])
    clouds = [name for name in page.names if "/scans/k" in name]
    assert clouds and all(page[name].visible for name in clouds)
    view.go_to(5.0)
    scan = int(np.searchsorted(run.trajectory_map.stamps_ns - run.trajectory_map.stamps_ns[0], 5e9))
    assert np.allclose(page["/map/sensor"].position, run.trajectory_map.positions[scan], atol=0.05)
    assert 0 < sum(page[name].visible for name in clouds) < len(clouds)


def test_storeys_layers_runs_and_the_lift_are_switched(page: Page, two_storeys: Path, anchored_run: Path) -> None:
    view = FinishedView(page, [FinishedRun(two_storeys), FinishedRun(anchored_run / "out")])
    for storey, ground in (("upper", False), (view.runs[0].folder.matches["floor"], True)):
        view.scene.show_storey(storey)
        assert page["/plan/Upper"].visible is not ground and page["/plan/Ground"].visible is ground
        assert page["/map/floor-0"].visible is page["/matches/floor-0"].visible is ground
    view.scene.show_layer("rooms", False)
    assert not page["/map/floor-0/rooms"].visible and page["/map/floor-0/walls"].visible
    flat = page["/matches/floor-0"].points.copy()
    view.panel.lift_map(3.0)
    lifted = page["/matches/floor-0"].points
    assert np.allclose(lifted[:, 0] - flat[:, 0], [0, 0, 3], atol=1e-4) and np.array_equal(lifted[:, 1], flat[:, 1])
    view.show(view.runs[1])
    assert "/plan/Ground" in page.names and "/plan/Upper" not in page.names


def test_places_that_are_possible_are_listed_with_their_probabilities(page: Page, two_storeys: Path) -> None:
    matches = json.loads((two_storeys / "matches.json").read_text())
    best, other = dict(matches["hypotheses"][0], probability=0.61), matches["hypotheses"][1]
    matches |= {"status": "ambiguous", "hypotheses": [best, dict(other, probability=0.3, floor="upper")]}
    metrics = json.loads((two_storeys / "metrics.json").read_text()) | {"T_bim_map": None}
    for name, told in (("matches", matches), ("metrics", metrics)):
        (two_storeys / f"{name}.json").write_text(json.dumps(told))
    run = FinishedRun(two_storeys)
    FinishedView(page, [run])
    table = hypothesis_table(run.now, {matches["floor"]: "Ground", "upper": "Upper"})
    assert "| 61.0 % | Ground |" in table and "| 30.0 % | Upper |" in table
    assert {"/hypotheses/1", "/hypotheses/2"} <= page.names and "/hypotheses/3" not in page.names


@pytest.mark.skipif(chromium.COMMAND is None, reason="chromium is not installed")
def test_the_page_in_a_browser(anchored_run: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sgslam.cli.view", str(anchored_run / "out"), "--at", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            with Chromium(process.stdout.readline().split()[1], tmp_path / "profile", (900, 600)) as browser:
                browser.wait_for("document.body.innerText.includes('Anchored')")
                assert not [c for c in browser.complaints if '"error"' in c or "exceptionDetails" in c]
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0
        finally:
            process.kill()


def test_what_a_page_needs_is_told_in_one_line(anchored_run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as taken:
        taken.bind(ANY)
        taken.listen()
        words = ("sgslam.cli.view", anchored_run / "out", "--at", taken.getsockname()[1])
        assert "cannot listen on" in refused(*words)
    monkeypatch.setitem(sys.modules, "viser", None)
    assert "pip install 'sgslam[view]'" in refused(*words)
