"""The golden references: equal results are called bit-equal, and what moved is named with its amount."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from commands import refused
from golden import __main__ as command
from golden import worker
from golden.differences import match_lines, plan_lines
from golden.folders import content_lines, folder_lines
from methods import METHODS

COUNTS = Path(worker.__file__).with_name("public_plans.json")
POSES = ["0.1 0 0 0 0 0 0 1", "0.2 1 0 0 0 0 0 1", "0.3 2 0 0 0 0 0 1"]


def test_graphs_made_twice_are_equal_and_a_moved_one_is_reported() -> None:
    made = worker.generated(1, ["apartment", "skewed"])
    assert plan_lines(made, worker.generated(1, ["apartment", "skewed"])) == []
    moved = copy.deepcopy(made)
    name, plan = next((name, plan) for name, plan in moved.items() if plan["graph"]["doors"])
    wall, gone = plan["graph"]["wall_surfaces"][0], plan["graph"]["doors"].pop()
    wall["centroid"] = [wall["centroid"][0] + 0.25, wall["centroid"][1]]
    said = plan_lines(made, moved)
    assert said[0].startswith("1 of 2 plans moved")
    assert f"{name}: 1 doors vanish: {gone['id']} " in said[-1] or any(f"vanish: {gone['id']} " in s for s in said)
    assert any("1 wall_surfaces changed (centroid 1), moved by 0.25 m at most" in line for line in said)


@pytest.mark.slow
def test_matches_made_twice_are_equal_and_another_answer_is_reported() -> None:
    maps = worker.maps(Path("no public plans"), 6)
    assert len(maps["maps"]) == 6 and maps == worker.maps(Path("no public plans"), 6)
    for method in ("learned", "voting"):
        answers = worker.matches(method, maps)
        assert len(answers) == 6 and match_lines(answers, worker.matches(method, maps, answers)) == []
    other: dict[str, Any] = copy.deepcopy(answers)
    one = next(answer for answer in other.values() if answer["T_a_s"])
    before, one["status"] = one["status"], "of another kind"
    one["T_a_s"][1] += 3.0
    pair = one["wall_surfaces"].pop()
    said = match_lines(answers, other)
    assert said[0].startswith("1 of 6 answers differ") and pair
    assert f"status {before} -> of another kind: 1" in said
    assert any(line.startswith("1 motions moved: 3 m at most") for line in said)
    assert any(line.startswith("pairs of wall_surfaces: 1 vanish, 0 appear") for line in said)


def test_poses_are_compared_by_stamp() -> None:
    text = "\n".join(POSES).encode()
    assert content_lines("trajectory.tum", text, "\n".join(POSES[1:]).encode()) == [
        "1 of 3 rows vanish, the first is 0.1"
    ]
    turned = [*POSES[:2], "0.3 2 0 0.5 0 0 1 0"]
    said = content_lines("trajectory.tum", text, "\n".join(turned).encode())
    assert said == ["1 of 3 poses moved: 0.5 m at most, RMS 0.289; 180 degrees at most, RMS 104"]
    table = b"stamp_s,health\n0.1,good\n0.2,good\n"
    assert content_lines("a.csv", table, b"stamp_s,health\n0.2,lost\n") == [
        "1 of 2 rows vanish, the first is 0.1", "health: 1 of 2 cells differ"
    ]  # fmt: skip


def test_folders_are_equal_but_for_times(tmp_path: Path) -> None:
    for name, seconds, day in (("old", 1.0, 27), ("new", 2.0, 28)):
        folder = tmp_path / name
        (folder / "part").mkdir(parents=True)
        (folder / "metrics.json").write_text(json.dumps({"seconds": {"total": seconds}, "anchored": True, "rmse": 0.1}))
        (folder / "run.log").write_text(f"2026-11-{day} 10:00:00,123 INFO 3 scans")
        (folder / "part" / "clouds.bin").write_bytes(b"points")
        (folder / "state.npz").write_text(name)
    old, new = tmp_path / "old", tmp_path / "new"
    assert folder_lines(old, new) == []
    (new / "metrics.json").write_text(json.dumps({"seconds": {}, "anchored": False, "rmse": 0.35}))
    (new / "run.log").write_text("2026-11-28 10:00:00,123 INFO 5 scans")
    (new / "part" / "clouds.bin").write_bytes(b"others")
    (new / "more.txt").touch()
    said = folder_lines(old, new)
    assert said[:1] == ["more.txt: is new"] and "anchored: True -> False" in said[2]
    assert said[1] == "metrics.json: 2 values differ; the largest change of a number is 0.25, rmse: 0.1 -> 0.35"
    assert said[3].startswith("part/clouds.bin: the hash differs") and len(said) == 5
    assert said[4] == "run.log: 1 of 1 lines differ, in numbers, by 2 at most"


def test_mistakes_are_one_line(tmp_path: Path) -> None:
    assert "no references there" in refused("golden", "compare", "--out", tmp_path)
    assert "--only curves: there are graphs, matches" in refused("golden", "compare", "--only", "curves")
    assert "give a checkout" in refused("golden", "make", "--code", tmp_path, "--out", tmp_path / "out")


def test_all_methods_are_compared() -> None:
    assert set(command.METHODS) == set(METHODS)


@pytest.mark.long
@pytest.mark.slow
def test_public_plans_have_as_many_rooms_surfaces_and_doors_as_noted() -> None:
    """Counts do not depend on the processor, as coordinates may."""
    if not command.DATA.exists():
        pytest.skip(f"{command.DATA} is not here")
    noted = json.loads(COUNTS.read_text())
    assert {name: counts(worker.graphs(name, command.DATA)) for name in noted} == noted, COUNTS


def counts(plans: worker.Plans) -> dict[str, int]:
    """The plans that can be used, and their nodes by kind."""
    graphs = [plan["graph"] for plan in plans.values() if "graph" in plan]
    kinds = ("rooms", "wall_surfaces", "doors")
    return {"plans": len(graphs), **{kind: sum(len(graph[kind]) for graph in graphs) for kind in kinds}}
