"""Computes cases in child processes, of this machine or of a Dask cluster's workers."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import lru_cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from data.common.children import end_with_parent, may_have_children
from data.common.cluster import completed
from data.common.errors import UserError
from evaluation.harness.study import Case, Study, load_study

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
Answer = dict[str, Any]  # a record as JSON values


def records_of(
    study: Study, cases: Sequence[Case], work: Path, jobs: int, scheduler: str | None
) -> Iterator[tuple[Case, Answer]]:
    """Each case with its record, in order of completion, from `jobs` processes or the workers of a Dask cluster.

    Raises what a case raises, and UserError for a process that ended and as `data.common.cluster` does.
    """
    if scheduler is not None:
        yield from _on_cluster(study, cases, scheduler)
        return
    work.mkdir(parents=True, exist_ok=True)
    with _pool(study, 1 if study.timed else jobs) as pool:
        running = {pool.submit(execute, study.name, case.key, str(work)): case for case in cases}
        for future in as_completed(running):
            yield running[future], _answer(future, running[future])


def execute(name: str, case: str, work: str) -> Answer:
    """The record of a case (JSON) of the study `name`, as JSON values."""
    study = load_study(name)
    return study.measure(study.case.model_validate_json(case), Path(work)).model_dump(mode="json")


def _answer(future: "Future[Answer]", case: Case) -> Answer:
    try:
        return future.result()
    except BrokenProcessPool:
        raise UserError(f"the process that computed {case.key} ended; too little memory? Rows are kept") from None


@contextmanager
def _pool(study: Study, jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that end with this one; on an error the cases that wait are dropped."""
    context, tasks = get_context("spawn"), None if study.small else 1
    before = {name: os.environ.get(name) for name in THREADS}
    if study.small:
        os.environ.update(dict.fromkeys(THREADS, "1"))  # the children inherit it
    pool = ProcessPoolExecutor(jobs, context, end_with_parent, max_tasks_per_child=tasks)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def _on_cluster(study: Study, cases: Sequence[Case], scheduler: str) -> Iterator[tuple[Case, Answer]]:
    function = partial(execute_on_worker, study.name, os.getcwd())
    by_key = {case.key: case for case in cases}
    for key, answer in completed(function, by_key, scheduler=scheduler):
        if isinstance(answer, UserError):
            raise answer
        if isinstance(answer, BaseException):
            raise UserError(f"{key}: {answer}; rows are kept") from answer
        yield by_key[key], answer


def execute_on_worker(name: str, folder: str, case: str) -> Answer:
    """`execute` in a child process of a cluster's worker, in the working directory `folder` of the caller."""
    from distributed import get_worker

    future = _worker_pool(name, folder).submit(execute, name, case, get_worker().local_directory)
    try:
        return future.result()
    except BrokenProcessPool:
        _worker_pool.cache_clear()
        raise


@lru_cache(maxsize=1)
def _worker_pool(name: str, folder: str) -> ProcessPoolExecutor:
    may_have_children()
    if load_study(name).small:
        os.environ.update(dict.fromkeys(THREADS, "1"))
    tasks = None if load_study(name).small else 1
    return ProcessPoolExecutor(1, get_context("spawn"), _begin_on_worker, (folder,), max_tasks_per_child=tasks)


def _begin_on_worker(folder: str) -> None:
    end_with_parent()
    if Path(folder).is_dir():  # what the cases read by relative paths has been looked for by the caller's
        os.chdir(folder)
