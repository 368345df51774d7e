"""`python -m evaluation.matching_benchmark.run` as a user runs it: the same rows whatever happens to the run."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import called, refused
from evaluation.matching_benchmark.rows import Row, read_rows
from evaluation.matching_benchmark.run import main
from evaluation.matching_benchmark.worker import Task, blank_row, run_tasks, score_answer
from plans import a_graph, flat

from data.common.cli import run_command
from data.plans.sources import Plan
from data.synthetic_maps.noise_models import draw
from evaluation.drives.slam_graph_files import SlamDrive, SlamGraph, write_drive
from evaluation.matching_benchmark.pairs import Candidate, pairs_of_cell, read_candidates, slam_pairs
from evaluation.matching_benchmark.tables import markdown, tables
from matching import Matcher
from matching.result import MatchResult

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def plans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plans")
    for seed in (3, 4):
        a_graph(flat(np.random.default_rng(seed)), "ground").save(folder / f"flat_{seed}.json")
    return folder


def command(plans: Path, out: Path, *more: str) -> list[str]:
    given = [str(plans / f"flat_{n}.json") for n in (3, 4)]
    small = ["--methods", "voting", "oracle", "--regimes", "real", "negative", "--rooms", "2", "all", "--pairs", "6"]
    return [
        sys.executable,
        "-m",
        "evaluation.matching_benchmark.run",
        "--out",
        str(out),
        "--plans",
        *given,
        *small,
        *more,
    ]


def told(rows: list[Row]) -> list[Row]:
    """Without what no two runs have in common."""
    return sorted((replace(r, seconds=0.0) for r in rows), key=lambda r: repr(r.key))


def undisturbed(plans: Path) -> list[Row]:
    """The rows of `command`, made here and now."""
    candidates = read_candidates([plans / f"flat_{n}.json" for n in (3, 4)], [])
    rows = []
    for regime in ("real", "negative"):
        for pair in [p for rooms in (2, None) for p in pairs_of_cell(candidates, regime, rooms, 6, 0)]:
            prepared = pair.prepare()
            rows.append(score_answer(blank_row(pair, prepared, "voting"), prepared, Matcher.load("voting")))
            if regime == "real":  # no oracle where there is no truth
                rows.append(score_answer(blank_row(pair, prepared, "oracle"), prepared, None))
    return rows


def test_a_run_that_is_killed_goes_on_and_ends_with_the_same_rows(plans: Path, tmp_path: Path) -> None:
    page = tmp_path / "PAGE.md"
    rows = undisturbed(plans)
    assert len(rows) == 6 * (2 * 2 + 2)
    path = tmp_path / "killed" / "rows.jsonl"
    with subprocess.Popen(command(plans, path.parent), stdout=subprocess.DEVNULL) as process:
        while not path.exists() or path.read_bytes().count(b"\n") < 5:
            assert process.poll() is None
            time.sleep(0.002)
        os.kill(process.pid, signal.SIGKILL)
    assert 5 <= len(read_rows(path)) < len(rows)
    with path.open("ab") as file:
        file.write(b'{"method":"voting","reg')
    again = called(*command(plans, path.parent, "--page", str(page))[2:])
    assert again.returncode == 0
    assert told(read_rows(path)) == told(rows)
    assert len(path.read_text().splitlines()) == len(rows)
    assert " 0 matches to make" not in again.stdout and "min left" in again.stdout
    text = page.read_text()
    assert text.startswith("<!-- matching -->\n## Matching") and "| real | voting |" in text
    assert "`python -m evaluation.matching_benchmark.run" in text and " cores, " in text
    main(["--out", str(path.parent), "--report-only", "--page", str(page), "--section", "small-ones"])
    assert page.read_text().startswith(text.rstrip()) and "## Matching: small ones" in page.read_text()
    made = {p.name for p in path.parent.iterdir()}
    assert made >= {"table.md", "table_full.md", "table.tex", "f1.svg", "reliability.svg", "time.svg", "commands.jsonl"}
    from_rows = "\n".join(map(markdown, tables(read_rows(path))))
    assert (path.parent / "table.md").read_text().startswith(from_rows)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (["--regimes", "dreamt"], "dreamt"),
        (["--methods", "magic"], "no matching method 'magic'"),
        (["--rooms", "two"], "--rooms two"),
        (["--pairs", "0"], "--pairs 0"),
        (["--pairs-of", "magic:3"], "--pairs-of magic:3"),
        (["--plans", "nowhere"], "nowhere"),
        (["--generated", "castle:2"], "castle:2"),
    ],
)
def test_a_users_mistake_is_one_line(
    plans: Path, tmp_path: Path, change: list[str], message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        run_command(lambda: main(command(plans, tmp_path / "out", *change)[3:]))
    error = capfd.readouterr().err
    assert ended.value.code == 2 and message in error and len(error.splitlines()) == 1


def test_a_report_of_nothing_is_a_mistake(tmp_path: Path) -> None:
    assert "no rows" in refused("evaluation.matching_benchmark.run", "--out", tmp_path, "--report-only")


def candidates() -> list[Candidate]:
    graphs = {seed: a_graph(flat(np.random.default_rng(seed)), "ground") for seed in range(3, 7)}
    return [Candidate("flats", Plan(f"flat_{seed}", f"house_{seed}", graph)) for seed, graph in graphs.items()]


def test_pairs_depend_neither_on_the_order_of_the_plans_nor_on_how_many_pairs_are_wanted() -> None:
    plans = candidates()
    for regime in ("real", "negative"):
        few, many = (pairs_of_cell(plans[::step], regime, 3, n, 0) for step, n in ((1, 6), (-1, 8)))
        keys = [[(p.target.plan.name, p.source.plan.name, p.index) for p in pairs] for pairs in (few, many)]
        assert keys[1][:6] == keys[0]
        assert few[5].prepare().drawn == many[5].prepare().drawn
        assert few[0].prepare().drawn != few[4].prepare().drawn  # the same plan again, another map
        assert {p.target.plan.name for p in few} == {f"flat_{n}" for n in range(3, 7)}
        assert all((p.source is not p.target) == (regime == "negative") for p in many)
    assert pairs_of_cell(plans, "real", 500, 3, 0) == []  # no plan is so large
    assert pairs_of_cell(plans[:1], "negative", 2, 3, 0) == []  # there is no other building


def test_the_maps_of_our_own_pipeline_are_pairs_by_the_rooms_they_saw(tmp_path: Path) -> None:
    plan = a_graph(flat(np.random.default_rng(5)), "ground")
    drawn = [draw(plan, "real", np.random.default_rng(n), n) for n in (2, 5, 8)]
    for sequence in ("one", "two"):
        graphs = tuple(SlamGraph(float(n), n == 2, of) for n, of in enumerate(drawn))
        write_drive(tmp_path, SlamDrive(sequence, 0, plan, graphs), "house")
    pairs = slam_pairs(tmp_path)
    assert [(p.target.plan.name, p.rooms) for p in pairs] == [(s, n) for s in ("one", "two") for n in (2, 4, None)]
    assert {p.target.plan.building for p in pairs} == {"one"}  # two drives of one building
    rows = list(run_tasks([Task(p, ("voting", "oracle")) for p in pairs], jobs=2, limit_s=60))
    assert len({r.key for r in rows}) == 12 and {r.regime for r in rows} == {"sgslam"}
    assert sum(r.wall_tally.right for r in rows) > 0.8 * sum(r.wall_tally.true for r in rows)


class _Slow:
    """A method that does not come back for large maps, and raises for one of them."""

    def match(self, s: Any, a: Any) -> MatchResult:
        if len(s.rooms) == 3:
            raise ValueError("three is\ntoo many")
        time.sleep(900 if len(s.rooms) > 3 else 0)
        return MatchResult("none", "nothing")


def test_the_limit_of_time_holds_and_a_failure_is_a_row(tmp_path: Path) -> None:
    """In a process of its own, whose workers know the method because they import the script as their main module."""
    script = tmp_path / "slow.py"
    here = Path(__file__).parent
    folders = [str(folder) for folder in (here, here.parent / "helpers", here.parents[1])]
    script.write_text(
        f"import sys; sys.path[:0] = {folders!r}\n"
        "from matching import Matcher\n"
        "from test_matching_benchmark import _Slow, slow_rows\n"
        "Matcher.load = staticmethod(lambda name: _Slow())\n"
        "if __name__ == '__main__': slow_rows()\n"
    )
    began = time.perf_counter()
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True)
    rows = json.loads(done.stdout)
    assert rows == [
        [1, "slow", "none"], [1, "oracle", "unique"], [3, "slow", "failed"], [3, "oracle", "unique"],
        [5, "slow", "late"], [5, "oracle", "unique"],
    ]  # fmt: skip
    assert time.perf_counter() - began < 600


def slow_rows() -> None:
    """Prints what becomes of pairs on which the slow method answers, raises, and does not come back."""
    pairs = [pair for rooms in (1, 3, 5) for pair in pairs_of_cell(candidates(), "real", rooms, 1, 0)]
    rows = list(run_tasks([Task(pair, ("slow", "oracle")) for pair in pairs], jobs=1, limit_s=2.0))
    late = [r for r in rows if r.status == "late"]
    assert all(r.seconds == 2.0 and r.wall_tally.true > 10 and not r.completed for r in late)
    print(json.dumps([[r.rooms, r.method, r.status] for r in rows]))
