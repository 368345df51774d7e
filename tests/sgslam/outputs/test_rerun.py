"""A run as a recording for the Rerun viewer: what is in it, and that the run is the same as without it."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import called, refused
from drives import small_drive, small_run

from sgslam.slam import SceneGraphSlam
from sgslam.viewer.rerun_log import RerunLog, recorded

pytest.importorskip("rerun", reason="rerun is not installed: pip install 'sgslam[rerun]'")
LIVE = {"/map/sensor", "/map/sensor/scan", "/health"}
AT_KEYFRAMES = {"/map", "/map/trajectory", "/map/walls/matched", "/map/walls/unmatched", "/map/rooms"}
ANCHORS = {"/anchors/tight", "/anchors/loose", "/anchors/withdrawn", "/anchors/changes"}


def rows(path: Path) -> dict[str, int]:
    """How often each entity of a recording was logged, by rerun's own reader."""
    from rerun.chunk import RrdReader

    counts: dict[str, int] = {}
    for chunk in RrdReader(path).stream():
        counts[str(chunk.entity_path)] = counts.get(str(chunk.entity_path), 0) + chunk.num_rows
    return counts


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Any, int]]:
    """The recording of a drive with its plan, the result of the run, and the number of keyframes on the way."""
    path, drive = tmp_path_factory.mktemp("rerun") / "run.rrd", small_drive()
    slam, log, keyframes = SceneGraphSlam(drive.bim), RerunLog(path, drive.bim.graph), set()
    for stamp_ns, points in drive.scans:
        update = slam.add_scan(stamp_ns, points, np.zeros(len(points)))
        keyframes.add(update.keyframes)
        log.add_scan(slam, update, points)
    result = slam.finish()
    log.add_map(slam)
    assert not path.exists()
    log.close()
    yield path, result, len(keyframes)


def test_the_recording_holds_the_run_over_time(run: tuple[Path, Any, int]) -> None:
    path, result, keyframes = run
    assert [name.name for name in path.parent.iterdir()] == [path.name]
    counts, scans = rows(path), len(small_drive().scans)
    assert {"/plan/walls", "/plan/rooms", "/matching", *LIVE, *AT_KEYFRAMES, *ANCHORS} <= counts.keys()
    assert counts["/map/sensor"] == counts["/map/sensor/scan"] == scans > counts["/health"] > 0
    assert {counts[name] for name in AT_KEYFRAMES} == {keyframes + 1}
    assert counts["/plan/walls"] == 1
    changes = sum(len(anchor["events"]) for anchor in result.anchors)
    assert 0 < changes <= counts["/anchors/changes"] < 2 * changes  # records of walls that were joined are dropped


def test_a_run_that_is_recorded_is_the_same(run: tuple[Path, Any, int]) -> None:
    (_, seen, _), (_, alone) = run, small_run(with_bim=True)
    for name in ("trajectory", "trajectory_map", "trajectory_odometry"):
        assert getattr(seen, name).poses.tobytes() == getattr(alone, name).poses.tobytes()
    assert seen.s_graph == alone.s_graph and seen.deviations == alone.deviations and seen.anchors == alone.anchors


@pytest.mark.slow
def test_the_command_records_a_run_without_a_plan_to_the_same_result(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    for stamp_ns, points in small_drive().scans[:60]:
        np.save(tmp_path / f"scans/{stamp_ns}.npy", points.astype(np.float32))
    told = {}
    for name, more in (("alone", []), ("recorded", ["--rerun", tmp_path / "run.rrd"])):
        done = called("sgslam.run", "--single-pass", "--scan-dir", tmp_path / "scans", "--out", tmp_path / name, *more)
        assert done.returncode == 0, done.stderr
        files = ("trajectory.tum", "s_graph.json", "trajectory_odometry.tum")
        told[name] = [(tmp_path / name / file).read_bytes() for file in files]
    assert told["alone"] == told["recorded"]
    counts = rows(tmp_path / "run.rrd")
    assert counts.keys() >= LIVE | AT_KEYFRAMES and "/plan/walls" not in counts


def test_a_log_that_fails_does_not_end_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    slam, log = SceneGraphSlam(), RerunLog(tmp_path / "run.rrd")
    monkeypatch.setattr(log._rr, "Points3D", lambda *_, **__: 1 / 0)
    for stamp_ns, points in small_drive().scans[:3]:
        log.add_scan(slam, slam.add_scan(stamp_ns, points, np.zeros(len(points))), points)
    log.close()
    assert caplog.text.count("no longer written: ZeroDivisionError") == 1
    assert (tmp_path / "run.rrd").stat().st_size > 0


def test_what_is_missing_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.save(tmp_path / "0.npy", small_drive().scans[0][1])
    (tmp_path / "times.txt").write_text("0.0\n")
    words = ("sgslam.run", "--scan-dir", tmp_path, "--out", tmp_path / "out", "--rerun")
    assert "cannot be written" in refused(*words, tmp_path / "none/run.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert "pip install 'sgslam[rerun]'" in refused(*words, tmp_path / "run.rrd")
    assert not list((tmp_path / "out").iterdir())


def test_without_a_scan_there_is_no_file(tmp_path: Path) -> None:
    with recorded(tmp_path / "run.rrd", small_drive().bim.graph):
        pass
    assert not list(tmp_path.iterdir())
