"""Runs methods on pairs in child processes, so that the time limit holds whatever a method does."""

import multiprocessing
import os
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from data.common.children import ProcessEndedError, end_with_parent, may_have_children
from evaluation.matching_benchmark.judge import is_wrong, tallies
from evaluation.matching_benchmark.methods import load_method
from evaluation.matching_benchmark.oracle import oracle_match
from evaluation.matching_benchmark.pairs import Pair, Prepared
from evaluation.matching_benchmark.rows import ORACLE, Row
from matching import Matcher
from matching.result import MatchResult

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Task:
    """A pair and the methods still to run on it."""

    pair: Pair
    methods: tuple[str, ...]


def run_tasks(tasks: Sequence[Task], jobs: int, limit_s: float, scheduler: str | None = None) -> Iterator[Row]:
    """The rows of all tasks as they are ready, from `jobs` processes of one thread each or a scheduler's cluster.

    A method that exceeds the time limit is stopped with its process: its row is "late", and a new process runs the
    pair's other methods. Raises UserError as `data.common.cluster` does.
    """
    if scheduler is not None:
        yield from _run_on_cluster(tasks, limit_s, scheduler)
        return
    workers = [_Worker() for _ in range(min(jobs, len(tasks)))]
    try:
        yield from _rows(workers, tasks, limit_s)
    finally:
        for worker in workers:
            worker.stop()


def _rows(workers: Sequence["_Worker"], tasks: Iterable[Task], limit_s: float) -> Iterator[Row]:
    todo = deque(tasks)
    for worker in workers:
        worker.give(todo.popleft())
    while busy := [w for w in workers if w.task is not None]:
        pause = max(0.0, min((w.deadline for w in busy), default=0.0) - time.monotonic())
        ready = wait([w.pipe for w in busy], None if pause == float("inf") else pause)
        for worker in busy:
            row = worker.receive(limit_s) if worker.pipe in ready else worker.late(limit_s)
            if row is not None:
                yield row
            if worker.task is None and todo:
                worker.give(todo.popleft())


def _run_on_cluster(tasks: Sequence[Task], limit_s: float, scheduler: str) -> Iterator[Row]:
    from data.common.cluster import connected

    weights = {file for task in tasks for m in task.methods if Path(file := m.partition("@")[2]).is_file()}
    with connected(scheduler) as cluster:
        for _, rows in cluster.over(tasks, partial(rows_on_worker, limit_s), describe, sorted(weights)):
            yield from rows


def rows_on_worker(limit_s: float, task: Task) -> list[Row]:
    """The rows of a task on a cluster's worker, computed by a child process that is kept for the next task, since
    methods load slowly. There is one child for each thread of the worker."""
    with _starting:  # the environment passed to the child belongs to the whole process
        may_have_children()
        worker = _idle.pop() if _idle else _Worker()
    try:
        rows = list(_rows([worker], [task], limit_s))
    except BaseException:
        worker.stop()
        raise
    _idle.append(worker)
    return rows


class _Worker:
    """A child process and its current `task`, None while it is idle."""

    def __init__(self) -> None:
        self.task: Task | None = None
        self.deadline = float("inf")
        self._late: Row | None = None
        self._start()

    def _start(self) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.pipe, theirs = spawn.Pipe()
        self.process = spawn.Process(target=serve, args=(theirs,), daemon=True)
        before = {name: os.environ.get(name) for name in THREADS}
        os.environ.update(dict.fromkeys(THREADS, "1"))
        try:
            self.process.start()
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})
        theirs.close()

    def give(self, task: Task) -> None:
        self.task, self.deadline = task, float("inf")
        self.pipe.send(task)

    def receive(self, limit_s: float) -> Row | None:
        """Handles a message; returns its row, None for other messages."""
        assert self.task is not None
        try:
            kind, row = self.pipe.recv()
        except EOFError:
            self.process.join()
            raise ProcessEndedError(f"a process ended ({self.process.exitcode}) at {describe(self.task)}") from None
        if kind == "began":
            self._late, self.deadline = row, time.monotonic() + limit_s
            return None
        if kind == "raised":
            raise RuntimeError(f"{describe(self.task)}:\n{row}")
        self._done()
        return row if isinstance(row, Row) else None

    def late(self, limit_s: float) -> Row | None:
        """If the time limit is exceeded, restarts the process and returns the "late" row; else None."""
        if time.monotonic() < self.deadline or self.task is None or self._late is None:
            return None
        row = replace(self._late, seconds=limit_s, reason=f"stopped after {limit_s:g} s")
        self._done()
        left = self.task
        self.stop()
        self._start()
        if left is not None:
            self.give(left)
        return row

    def _done(self) -> None:
        assert self.task is not None
        left = self.task.methods[1:]
        self.task, self.deadline = (replace(self.task, methods=left) if left else None), float("inf")

    def stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


_starting, _idle = threading.Lock(), list[_Worker]()  # state of a cluster's worker


def describe(task: Task) -> str:
    """One line that identifies the pair."""
    pair = task.pair
    return f"{task.methods[0]} on {pair.regime} {pair.target.plan.name}, {pair.rooms} rooms, index {pair.index}"


def serve(pipe: Connection) -> None:
    """The child process: sends the rows of each task's methods until the pipe is closed."""
    end_with_parent()
    matchers: dict[str, Matcher] = {}
    try:
        while True:
            task: Task = pipe.recv()
            try:
                prepared = task.pair.prepare()
                for method in task.methods:
                    blank = blank_row(task.pair, prepared, method)
                    if method != ORACLE and method not in matchers:
                        matchers[method] = load_method(method)
                    pipe.send(("began", blank))
                    pipe.send(("row", score_answer(blank, prepared, matchers.get(method))))
            except Exception:
                import traceback

                pipe.send(("raised", traceback.format_exc()))
    except (EOFError, KeyboardInterrupt, BrokenPipeError):
        pass  # the parent process is gone or interrupted: there is no one to report to


def blank_row(pair: Pair, prepared: Prepared, method: str) -> Row:
    """The row of a method without an answer."""
    rooms, walls = tallies(MatchResult("none", ""), prepared.truth, prepared.drawn.s_graph)
    return Row(
        method, pair.regime, pair.target.plans, pair.target.plan.name, pair.target.plan.building, pair.source_name,
        pair.rooms, pair.index, pair.seed, pair.target.size, len(prepared.drawn.s_graph.rooms),
        len(prepared.drawn.s_graph.wall_surfaces), "late", "", False, prepared.twin, prepared.rival,
        0.0, rooms, walls,
    )  # fmt: skip


def score_answer(blank: Row, prepared: Prepared, matcher: Any) -> Row:
    """The row of a method's answer; a method that raises gets the status "failed"."""
    began = time.perf_counter()
    try:
        if matcher is None:
            result = oracle_match(prepared.drawn, prepared.a_graph)
        else:
            result = matcher.match(prepared.drawn.s_graph, prepared.a_graph)
        seconds = time.perf_counter() - began
        rooms, walls = tallies(result, prepared.truth, prepared.drawn.s_graph)
        wrong = is_wrong(result, prepared.truth, prepared.drawn.deformed)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        return replace(blank, status="failed", reason=reason, seconds=time.perf_counter() - began)
    return replace(
        blank, status=result.status, reason=result.reason, wrong=wrong, seconds=seconds, room_tally=rooms,
        wall_tally=walls,
    )  # fmt: skip
