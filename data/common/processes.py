"""Processes: how many to use, their environment, and children that end with their parent; tasks shared out to processes
of this machine, or to the workers of a Dask cluster."""

import logging
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

from data.common.build import build
from data.common.errors import UserError, refusing, required

PATIENCE_S = 5.0  # with a scheduler that does not answer, or has no worker
RETRIES = 2  # of a task that raises; how often its worker may die is Dask's `allowed-failures`
T = TypeVar("T")
R = TypeVar("R")


def cores() -> int:
    """The number of cores that this process may use, at least one."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def environment() -> dict[str, str]:
    """This process's environment, extended so that a child Python imports the same modules."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(p or os.getcwd() for p in sys.path)}


class ProcessEndedError(UserError):
    """A process ended without a result; if it ran out of memory, another try may succeed."""


def run_isolated(function: Callable[..., R], *arguments: Any, what: str) -> R:
    """Runs a function in a process of its own, so that its peak memory can be measured, and returns its result.

    Raises what the function raises, and ProcessEndedError, whose text names `what`.
    """
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        try:
            return pool.submit(function, *arguments).result()
        except BrokenProcessPool:
            raise ProcessEndedError(f"{what}: the run's process was ended; is there too little memory?") from None


def end_with_parent() -> None:
    """Called in a child: makes it end when its parent does, even by SIGKILL."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def may_have_children() -> None:
    """Allows this process to start others although it is a daemon, which multiprocessing forbids.

    Dask workers started by a nanny are daemons. Their children must be daemons too, or call `end_with_parent`.
    """
    multiprocessing.current_process().daemon = False


@contextmanager
def connected(scheduler: str) -> Iterator[Any]:
    """A Dask `Client`; on exit, unfinished tasks are dropped. Raises UserError if no scheduler answers, if it has no
    workers, and if one of them has another build of sgslam."""
    import asyncio

    distributed = required("distributed", "--scheduler", "cluster")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors are reported here, in one line

    async def kind() -> str:
        own = distributed.Security().get_connection_args("client")
        async with distributed.rpc(scheduler, connection_args=own) as server:
            return str((await server.identity())["type"])

    no_answer = f"--scheduler {scheduler}: no Dask scheduler with workers answers there"
    with refusing(no_answer, "write tcp://HOST:PORT, as `dask scheduler` prints it"):
        # a Client would wait forever for a server that is silent, or a worker
        if asyncio.run(asyncio.wait_for(kind(), PATIENCE_S)) != "Scheduler":
            raise ValueError("it is a worker")
        client = distributed.Client(scheduler, timeout=PATIENCE_S)
        client.wait_for_workers(1, PATIENCE_S)
    with client:
        for worker, found in client.run(build, on_error="return").items():
            if found != build():
                raise UserError(f"the worker {worker} must have sgslam {build()} as here, but has: {found}")
        yield client


def completed(
    function: Callable[[T], R], tasks: Iterable[T], processes: int = 1, scheduler: str | None = None
) -> Iterator[tuple[T, R | BaseException]]:
    """Yields each task with its result, or with what it raised, in the order of completion. `function` is a function
    of a module, or a partial of one. Raises UserError as `connected` does."""
    if scheduler is None:
        with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), end_with_parent) as pool:
            local = {pool.submit(function, task): task for task in tasks}
            for done in as_completed(local):
                yield local[done], done.exception() or done.result()
        return
    with connected(scheduler) as client:
        futures = {client.submit(function, task, pure=False, retries=RETRIES): task for task in tasks}
        for future in required("distributed", "--scheduler", "cluster").as_completed(futures):
            yield futures.pop(future), future.exception() or future.result()
