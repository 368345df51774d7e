"""A run as a recording for the Rerun viewer: what is in it, and that the run is the same as without it."""

import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from commands import refused
from drives import small_drive, small_run

from sgslam.slam import SceneGraphSlam
from sgslam.viewer.rerun_log import RerunLog

pytest.importorskip("rerun", reason="rerun is not installed: pip install 'sgslam[rerun]'")
FLOOR, STOREY = "/map/floor-0", "/plan/Ground"
SHOWN = {"/map", "/map/sensor", "/map/scan", "/health", f"{FLOOR}/trajectory/way", f"{FLOOR}/walls/matched"}
SHOWN |= {f"{FLOOR}/rooms/outlines", f"{STOREY}/plan/walls", f"{STOREY}/rooms/outlines"}
OF_THE_PLAN = {"/matching", "/anchors/tight", "/anchors/changes"}


@pytest.mark.slow
def test_the_recording_holds_the_run_over_time_which_is_the_same(tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    path, drive = tmp_path / "run.rrd", small_drive()
    slam, log = SceneGraphSlam(drive.bim), RerunLog(path, drive.bim.graph)
    for stamp_ns, points in drive.scans:
        log.add_scan(slam, slam.add_scan(stamp_ns, points, np.zeros(len(points))), points)
    seen, alone = slam.finish(), small_run(with_bim=True)[1]
    log.add_map(slam)
    log.close()
    assert [own.name for own in tmp_path.iterdir()] == [path.name]
    counts: Counter[str] = Counter()
    for chunk in RrdReader(path).stream():
        counts[str(chunk.entity_path)] += chunk.num_rows
    assert counts.keys() >= SHOWN | OF_THE_PLAN and counts["/map/scan"] == 2 * len(drive.scans)  # points and pose
    assert seen.trajectory.poses.tobytes() == alone.trajectory.poses.tobytes()
    assert seen.s_graph == alone.s_graph and seen.deviations == alone.deviations and seen.anchors == alone.anchors


def test_what_is_missing_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.save(tmp_path / "0.npy", small_drive().scans[0][1])
    (tmp_path / "times.txt").write_text("0.0\n")
    words = ("sgslam.run", "--scan-dir", tmp_path, "--out", tmp_path / "out", "--rerun")
    assert "cannot be written" in refused(*words, tmp_path / "none/run.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert "pip install 'sgslam[rerun]'" in refused(*words, tmp_path / "run.rrd")
