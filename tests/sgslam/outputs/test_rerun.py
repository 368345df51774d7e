"""A run as a recording for the Rerun viewer: what is in it, and that the run is the same as without it."""

import sys
from pathlib import Path

import numpy as np
import pytest
from commands import refused
from drives import small_drive, small_run

from sgslam.slam import SceneGraphSlam
from sgslam.viewer.rerun_log import RerunLog, recorded

pytest.importorskip("rerun", reason="rerun is not installed: pip install 'sgslam[rerun]'")
LIVE = {"/map/sensor", "/map/sensor/scan", "/health"}
AT_KEYFRAMES = {"/map", "/map/trajectory", "/map/walls/matched", "/map/walls/unmatched", "/map/rooms"}
OF_THE_PLAN = {"/plan/walls", "/plan/rooms", "/matching", "/anchors/tight", "/anchors/changes"}


def rows(path: Path) -> dict[str, int]:
    """How often each entity of a recording was logged, by rerun's own reader."""
    from rerun.chunk import RrdReader

    counts: dict[str, int] = {}
    for chunk in RrdReader(path).stream():
        counts[str(chunk.entity_path)] = counts.get(str(chunk.entity_path), 0) + chunk.num_rows
    return counts


@pytest.mark.slow
@pytest.mark.parametrize("planned", [True, False])
def test_the_recording_holds_the_run_over_time_which_is_the_same(planned: bool, tmp_path: Path) -> None:
    path, drive, keyframes = tmp_path / "run.rrd", small_drive(), set()
    slam = SceneGraphSlam(drive.bim if planned else None)
    log = RerunLog(path, drive.bim.graph) if planned else RerunLog(path)
    for stamp_ns, points in drive.scans:
        update = slam.add_scan(stamp_ns, points, np.zeros(len(points)))
        keyframes.add(update.keyframes)
        log.add_scan(slam, update, points)
    seen, alone = slam.finish(), small_run(with_bim=planned)[1]
    log.add_map(slam)
    assert not path.exists()
    log.close()
    assert [own.name for own in tmp_path.iterdir()] == [path.name]
    counts = rows(path)
    assert counts.keys() >= LIVE | AT_KEYFRAMES and bool(OF_THE_PLAN & counts.keys()) == planned
    assert counts["/map/sensor"] == counts["/map/sensor/scan"] == len(drive.scans) > counts["/health"] > 0
    assert {counts[name] for name in AT_KEYFRAMES} == {len(keyframes) + 1}
    for name in ("trajectory", "trajectory_map", "trajectory_odometry"):
        assert getattr(seen, name).poses.tobytes() == getattr(alone, name).poses.tobytes()
    assert seen.s_graph == alone.s_graph and seen.deviations == alone.deviations and seen.anchors == alone.anchors


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
    with recorded(tmp_path / "empty.rrd", small_drive().bim.graph):
        pass
    assert not (tmp_path / "empty.rrd").exists()  # without a scan there is no file


def test_what_is_missing_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.save(tmp_path / "0.npy", small_drive().scans[0][1])
    (tmp_path / "times.txt").write_text("0.0\n")
    words = ("sgslam.run", "--scan-dir", tmp_path, "--out", tmp_path / "out", "--rerun")
    assert "cannot be written" in refused(*words, tmp_path / "none/run.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert "pip install 'sgslam[rerun]'" in refused(*words, tmp_path / "run.rrd")
    assert not list((tmp_path / "out").iterdir())
