"""The matching benchmark on a Dask cluster, interrupted and with a worker killed."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.matching_benchmark.rows import Row, read_rows
from evaluation.matching_benchmark.tasks import BenchmarkOptions, key_of, tasks_of
from evaluation.matching_benchmark.worker import blank_row, run_tasks, score_answer
from plans import a_graph, flat

from evaluation.matching_benchmark.pairs import Pair, pairs_of_cell, read_candidates
from matching import Matcher

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
