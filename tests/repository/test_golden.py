"""The golden references: equal results are called bit-equal, and what moved is named with its amount."""

import json
from pathlib import Path

from commands import refused
from golden.folders import folder_lines


def test_folders_are_equal_but_for_times(tmp_path: Path) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    for folder, seconds in ((old, 1.0), (new, 2.0)):
        folder.mkdir()
        (folder / "metrics.json").write_text(json.dumps({"seconds": {"total": seconds}, "anchored": True, "rmse": 0.1}))
        (folder / "run.log").write_text(f"2026-11-27 10:00:0{seconds:.0f},123 INFO 3 scans")
        (folder / "clouds.bin").write_bytes(b"points")
    assert folder_lines(old, new) == []
    (new / "metrics.json").write_text(json.dumps({"seconds": {}, "anchored": False, "rmse": 0.35}))
    (new / "clouds.bin").write_bytes(b"others")
    (new / "more.txt").touch()
    report = "\n".join(folder_lines(old, new))
    assert all(part in report for part in ("more.txt", "anchored: True -> False", "0.1 -> 0.35", "clouds.bin"))
    assert "run.log" not in report
    assert "no references there" in refused("golden", "compare", "--out", tmp_path)
