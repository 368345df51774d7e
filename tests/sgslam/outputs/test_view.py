"""A run as a page in the browser: what it shows is where it belongs, and the run is the same as without it."""

import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import chromium
import numpy as np
import pytest
from boxes import Array
from chromium import Chromium
from commands import refused
from drives import small_drive, small_run
from report_samples import sample

from data.trajectory import Trajectory
from sgslam.geometry.frames import transform_points
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam
from sgslam.viewer import live as live_view
from sgslam.viewer.finished import FinishedRun, FinishedView
from sgslam.viewer.live import LiveView
from sgslam.viewer.page import Page, parse_address
from sgslam.viewer.panel import hypothesis_table

pytestmark = pytest.mark.skipif(find_spec("viser") is None, reason="viser is not installed (extra view)")
ANY = ("127.0.0.1", 0)
Looked = tuple[Result, list[str], LiveView, Page]


@pytest.fixture
def page() -> Iterator[Page]:
    opened = Page(ANY)
    yield opened
    opened.close()


@pytest.fixture
def out(anchored_run: Path) -> Path:
    return anchored_run / "out"


@pytest.fixture
def sampled(tmp_path: Path) -> Path:
    """The folder of an anchored run on the upper of two storeys, as far as it is read."""
    data, folder = sample(), tmp_path / "sampled"
    folder.mkdir()
    assert data.a_graph is not None
    for graph, name in ((data.a_graph, "a_graph"), (data.s_graph, "s_graph")):
        graph.save(folder / f"{name}.json")
    for name in ("trajectory_map", "trajectory_odometry"):
        getattr(data, name).write_tum(folder / f"{name}.tum")
    for name in ("matches", "metrics", "deviations"):
        (folder / f"{name}.json").write_text(json.dumps(getattr(data, name)))
    return folder


@pytest.fixture(scope="module")
def looked() -> Iterator[Looked]:
    """A run that was looked at: its result, what the page said on the way, and what it shows at the end."""
    drive, opened, patch = small_drive(), Page(ANY), pytest.MonkeyPatch()
    patch.setattr(live_view, "EVERY_S", 0.0)
    patch.setattr(live_view, "SHARE", 0.5)
    view = LiveView(opened, drive.bim.graph, drive.truth)
    slam, headings = SceneGraphSlam(drive.bim), []
    for k, (stamp_ns, points) in enumerate(drive.scans):
        view.add_scan(slam, slam.add_scan(stamp_ns, points, np.zeros(len(points))), points)
        if k % 20 == 0:
            view.wait()
            headings.append(str(view.panel.status.content))
    view.stop()
    yield slam.finish(), headings, view, opened
    opened.close()
    patch.undo()


def pose_of(handle: Any) -> Array:
    import viser.transforms as vt

    return np.asarray(vt.SE3.from_rotation_and_translation(vt.SO3(handle.wxyz), handle.position).as_matrix())


@pytest.mark.slow
def test_a_run_that_is_looked_at_is_the_same(looked: Looked) -> None:
    seen, alone = looked[0], small_run(with_bim=True)[1]
    for name in ("trajectory", "trajectory_map", "trajectory_odometry"):
        assert getattr(seen, name).poses.tobytes() == getattr(alone, name).poses.tobytes()
    assert seen.s_graph == alone.s_graph and seen.deviations == alone.deviations and seen.anchors == alone.anchors


@pytest.mark.slow
def test_the_page_follows_the_run_and_draws_matched_walls_at_planned_ones(looked: Looked) -> None:
    _, headings, view, page = looked
    assert "Not anchored yet" in headings[0] and any("Anchored, on Ground" in heading for heading in headings)
    assert {"/plan/Ground/plan/walls", "/matches/floor-0", "/map/scan", "/map/sensor", "/truth"} <= page.names
    assert sum(name.startswith("/map/floor-0/scans/k") for name in page.names) > 5
    feet = page["/map/floor-0/walls/matched-feet"].points
    walls = transform_points(pose_of(page["/map"]), feet) + page.origin
    planes = np.array([(*w.normal, -np.dot(w.normal, w.centroid)) for w in small_drive().bim.graph.wall_surfaces])
    off = np.abs(walls[:, :, :2] @ planes[:, :2].T + planes[:, 2])
    assert len(walls) > 6 and off.max(axis=1).min(axis=1).max() < 0.1
    assert np.abs(walls[..., 2] - 43.0).max() < 0.2  # the floor's height
    seconds, came, known = view.panel.chart.data  # the error falls once the map has its place
    assert np.all(np.diff(seconds) > 0) and np.nanmax(came) < 0.5 and np.sqrt(np.nanmean(known**2)) < 0.02


def test_a_page_that_cannot_be_drawn_does_not_end_the_run(
    page: Page, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Until then a map without a plan is shown as it grows."""
    monkeypatch.setattr(live_view, "EVERY_S", 0.0)
    monkeypatch.setattr(live_view, "SHARE", 1.0)
    view, slam = LiveView(page), SceneGraphSlam()
    for k, (stamp_ns, points) in enumerate(small_drive().scans[:45]):  # they wait until it is known where up is
        if k == 40:
            assert "No plan" in view.panel.status.content
            assert {"/map/floor-0/walls/unmatched", "/map/floor-0/scans/k0"} <= page.names
            monkeypatch.setattr(page, "lines", lambda *_, **__: 1 / 0)
        view.add_scan(slam, slam.add_scan(stamp_ns, points, np.zeros(len(points))), points)
        view.wait()
    view.stop()
    assert "no longer updated: ZeroDivisionError" in caplog.text


def test_a_finished_run_is_played(page: Page, anchored_run: Path) -> None:
    run = FinishedRun(anchored_run / "out", Trajectory.read_tum(anchored_run / "truth.tum"))
    view = FinishedView(page, [run])
    clouds = [name for name in page.names if "/scans/k" in name]
    assert clouds and all(page[name].visible for name in clouds)
    end = np.array(page["/map/sensor"].position)
    view.go_to(5.0)
    scan = int(np.searchsorted(run.trajectory_map.stamps_ns - run.trajectory_map.stamps_ns[0], 5e9))
    assert np.allclose(page["/map/sensor"].position, run.trajectory_map.positions[scan], atol=0.05)
    assert not np.allclose(page["/map/sensor"].position, end, atol=0.05)
    assert 0 < sum(page[name].visible for name in clouds) < len(clouds)
    T = pose_of(page["/map"])
    T[:3, 3] += page.origin
    assert np.allclose(T, run.folder.T_bim_map, atol=1e-3)


def test_storeys_layers_and_runs_are_switched(page: Page, sampled: Path, out: Path) -> None:
    view = FinishedView(page, [FinishedRun(sampled), FinishedRun(out)])
    for storey, upper in (("F0", False), ("F1", True)):
        view.scene.show_storey(storey)
        assert page["/plan/Storey 0"].visible is not upper and page["/plan/Storey 1"].visible is upper
        assert page["/map/floor-0"].visible is page["/matches/floor-0"].visible is upper
    view.scene.show_layer("rooms", False)
    assert not page["/map/floor-0/rooms"].visible and not page["/plan/Storey 1/rooms"].visible
    assert page["/map/floor-0/walls"].visible
    view.show(view.runs[1])
    assert "/plan/Ground" in page.names and "/plan/Storey 0" not in page.names


def test_a_matched_room_has_one_colour_and_lines_lead_to_the_plan(page: Page, sampled: Path) -> None:
    run = FinishedRun(sampled)
    view = FinishedView(page, [run])
    mapped, planned = (
        sorted(tuple(page[n].color) for n in page.names if n.startswith(f"{start}/rooms/areas"))
        for start in ("/map/floor-0", "/plan/Storey 1")
    )
    assert mapped == planned and len(set(mapped)) > 4
    flat = page["/matches/floor-0"].points.copy()
    assert len(flat) == len(run.folder.matches["wall_surfaces"])
    view.panel.lift_map(3.0)
    lifted = page["/matches/floor-0"].points
    assert np.allclose(lifted[:, 0] - flat[:, 0], [0, 0, 3], atol=1e-4) and np.array_equal(lifted[:, 1], flat[:, 1])


def test_places_that_are_possible_are_listed_with_their_shares(page: Page, sampled: Path) -> None:
    for name, value in (("metrics", {"T_bim_map": None}), ("matches", {"status": "ambiguous"})):
        told = json.loads((sampled / f"{name}.json").read_text())
        (sampled / f"{name}.json").write_text(json.dumps(told | value))
    run = FinishedRun(sampled)
    FinishedView(page, [run])
    table = hypothesis_table(run.now, {"F0": "Storey 0", "F1": "Storey 1"})
    assert "| 65 % | Storey 1 | 31.5 |" in table and "| 35 % | Storey 0 | 30.9 |" in table  # by exp(0.6) to 1
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


def test_what_a_page_needs_is_told_in_one_line(out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as taken:
        taken.bind(ANY)
        taken.listen()
        port = taken.getsockname()[1]
        assert "cannot listen on" in refused("sgslam.cli.view", out, "--at", port)
        assert "cannot listen on" in refused("sgslam.run", "--demo", "--out", tmp_path, "--view", port)
    monkeypatch.setitem(sys.modules, "viser", None)
    assert "pip install 'sgslam[view]'" in refused("sgslam.cli.view", out)
    assert parse_address("0.0.0.0:80") == ("0.0.0.0", 80)
