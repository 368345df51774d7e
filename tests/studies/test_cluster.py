"""Work shared out to a Dask cluster: a real scheduler, two workers, and what may become of them."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cluster_tasks import deadly, doubled
from plans import a_graph, flat

from data.common import cluster as of_data
from data.common.cli import run_command
from data.common.cluster import connected
from data.common.errors import UserError
from evaluation.matching_benchmark.pairs import Pair, pairs_of_cell, read_candidates
from evaluation.matching_benchmark.rows import Row, read_rows
from evaluation.matching_benchmark.run import main
from evaluation.matching_benchmark.tasks import BenchmarkOptions, key_of, tasks_of
from evaluation.matching_benchmark.worker import blank_row, run_tasks, score_answer
from matching import Matcher
from matching.train import main as train

pytestmark = pytest.mark.slow

METHODS, ROOMS, PAIRS = ("voting", "oracle"), (2, 3), 4
MANY = 5000  # pairs of which the first are those above; however seldom we get to look, there is something left


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plan") / "flat.json"
    a_graph(flat(np.random.default_rng(3), 9, 7), "ground").save(path)
    return path


def benchmark(plan: Path, out: Path, *more: str, pairs: int = PAIRS) -> list[str]:
    small = ["--regimes", "real", "--rooms", *map(str, ROOMS), "--pairs", str(pairs)]
    return ["--out", str(out), "--plans", str(plan), "--methods", *METHODS, *small, *more]


def without_times(rows: list[Row]) -> list[Row]:
    return sorted((replace(r, seconds=0.0) for r in rows), key=lambda r: repr(r.key))


@pytest.mark.slow
def test_interrupted_and_with_a_worker_killed_the_rows_are_those_of_one_machine(
    scheduler: str, plan: Path, tmp_path: Path
) -> None:
    from distributed import Client

    path = tmp_path / "rows.jsonl"
    words = benchmark(plan, tmp_path, "--scheduler", scheduler, pairs=MANY)
    command = [sys.executable, "-m", "evaluation.matching_benchmark.run", *words]
    with Client(scheduler, set_as_default=False) as watching:
        client = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        while not (path.exists() and read_rows(path)):
            assert client.poll() is None
            time.sleep(0.002)
        client.send_signal(signal.SIGINT)
        assert client.communicate()[1] == "interrupted\n" and client.returncode == 130
        while watching.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)):
            time.sleep(0.02)
        wanted = BenchmarkOptions(
            tmp_path, (plan,), (), None, dict.fromkeys(METHODS, PAIRS), ("real",), ROOMS, ("small",), 0, 60.0, 1, None
        )
        every = [p for rooms in ROOMS for p in pairs_of_cell(read_candidates([plan], []), "real", rooms, PAIRS, 0)]
        keys = {key_of(pair, method) for pair in every for method in METHODS}
        before = [row for row in read_rows(path) if row.key in keys]
        left = tasks_of(wanted, {r.key for r in before})
        assert before and 0 < sum(len(t.methods) for t in left) == 2 * len(every) - len(before)
        after = []
        for row in run_tasks(left, 1, 60.0, scheduler):
            if not after:
                os.kill(next(iter(watching.run(os.getpid).values())), signal.SIGKILL)
            after.append(row)
    assert without_times(before + after) == without_times([row for pair in every for row in found_here(pair)])


def found_here(pair: Pair) -> list[Row]:
    prepared = pair.prepare()
    voting = score_answer(blank_row(pair, prepared, "voting"), prepared, Matcher.load("voting"))
    return [voting, score_answer(blank_row(pair, prepared, "oracle"), prepared, None)]


def test_a_task_that_ends_its_worker_each_time_is_named_and_the_others_are_done(scheduler: str) -> None:
    with connected(scheduler) as cluster:
        cluster._client.run_on_scheduler(lambda dask_scheduler: setattr(dask_scheduler, "allowed_failures", 0))
        answers = {}
        with pytest.raises(UserError, match="number 3: its worker died") as error:
            for task, answer in cluster.over(range(-4, 12), deadly, lambda n: f"number {n}"):
                assert task not in answers
                answers[task] = answer
        cluster._client.run_on_scheduler(lambda dask_scheduler: setattr(dask_scheduler, "allowed_failures", 3))
    assert answers == {n: 2 * n for n in range(-4, 12) if abs(n) != 3}
    assert "number -3: is too few" in str(error.value) and "2 failed twice" in str(error.value)


@pytest.mark.slow
def test_answers_in_order_without_end(scheduler: str) -> None:
    with connected(scheduler) as cluster:
        answers = cluster.in_order(iter(int, 1), doubled, str)
        assert [next(answers) for _ in range(9)] == [0] * 9
        assert list(cluster.in_order(range(30), doubled, str)) == list(range(0, 60, 2))


def test_workers_that_would_answer_otherwise_are_refused(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "weights.pt").write_text("seen from here only")
    monkeypatch.chdir(tmp_path)
    with connected(scheduler) as cluster, pytest.raises(UserError, match=r"worker tcp://.* does not see weights\.pt"):
        list(cluster.over(range(3), doubled, str, ["weights.pt"]))
    monkeypatch.setattr(of_data, "build", lambda: "0.0.9 (01234567)")
    with pytest.raises(UserError, match=r"worker tcp://.* has sgslam .*, and here it is 0\.0\.9"), connected(scheduler):
        pass


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--scheduler", "tcp://127.0.0.1:9"], "tcp://127.0.0.1:9: cannot be reached"),
        (["--scheduler", "127.0.0.1"], "write tcp://HOST:PORT"),
        (["--jobs", "2", "--scheduler", "HERE"], "not allowed with argument --jobs"),
    ],
)
def test_a_users_mistake_is_one_line(
    scheduler: str, plan: Path, tmp_path: Path, given: list[str], message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    given = [scheduler if word == "HERE" else word for word in given]
    with pytest.raises(SystemExit) as ended:
        run_command(lambda: main(benchmark(plan, tmp_path / "out", *given)))
    error = capfd.readouterr().err
    assert ended.value.code == 2 and message in error and len(error.splitlines()) == 1


def test_without_dask_it_is_told_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SystemExit) as ended:
        run_command(lambda: train(["--out", str(tmp_path), "--scheduler", "tcp://127.0.0.1:9"]))
    assert ended.value.code == 2 and "pip install 'sgslam[cluster]'" in capfd.readouterr().err
