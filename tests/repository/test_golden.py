"""The golden references: equal results are called bit-equal, and what moved is named with its amount."""

import copy
import json
from pathlib import Path

import pytest
from commands import refused
from golden import worker
from golden.differences import plan_lines
from golden.folders import content_lines, folder_lines


@pytest.mark.slow
def test_what_is_made_twice_is_equal_and_what_moved_is_reported() -> None:
    made = worker.generated(1, ["apartment"])
    assert plan_lines(made, worker.generated(1, ["apartment"])) == []
    moved = copy.deepcopy(made)
    (plan,) = moved.values()
    wall, gone = plan["graph"]["wall_surfaces"][0], plan["graph"]["doors"].pop()
    wall["centroid"] = [wall["centroid"][0] + 0.25, wall["centroid"][1]]
    report = "\n".join(plan_lines(made, moved))
    assert gone["id"] in report and "0.25 m" in report


@pytest.mark.parametrize(
    ("name", "after", "parts"),
    [
        ("a.tum", "0.2 1 0 0 0 0 0 1\n0.3 2 0 0 0 0 0 1", ("1 of 3", "0.1")),
        ("a.tum", "0.1 0 0 0 0 0 0 1\n0.2 1 0 0 0 0 0 1\n0.3 2 0 0.5 0 0 1 0", ("1 of 3", "0.5 m", "180 degrees")),
        ("a.csv", "stamp_s,health\n0.2,lost\n", ("1 of 2", "0.1", "health: 1 of 2")),
    ],
)
def test_rows_are_compared_by_stamp(name: str, after: str, parts: tuple[str, ...]) -> None:
    before = {"a.tum": "0.1 0 0 0 0 0 0 1\n0.2 1 0 0 0 0 0 1\n0.3 2 0 0 0 0 0 1"}
    text = before.get(name, "stamp_s,health\n0.1,good\n0.2,good\n").encode()
    assert content_lines(name, text, text) == []
    report = "\n".join(content_lines(name, text, after.encode()))
    assert all(part in report for part in parts), report


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
