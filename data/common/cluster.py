"""Tasks shared out to processes of this machine, or to the workers of a Dask cluster."""

import asyncio
import concurrent.futures
import logging
import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from data.common.build import build
from data.common.errors import UserError
from data.common.processes import end_with_parent

PATIENCE_S = 5.0  # with a scheduler that does not answer, or has no worker
RETRIES = 2  # of a task that raises; how often its worker may die is Dask's `allowed-failures`
T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def connected(scheduler: str) -> Iterator[Any]:
    """A Dask `Client`; on exit, unfinished tasks are dropped. Raises UserError if no scheduler answers, if it has no
    workers, and if one of them has another build of sgslam."""
    try:
        from distributed import Client, Security, rpc
    except ImportError:
        raise UserError("--scheduler needs dask.distributed; pip install 'sgslam[cluster]'") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors are reported here, in one line

    async def kind() -> str:
        async with rpc(scheduler, connection_args=Security().get_connection_args("client")) as server:
            return str((await server.identity())["type"])

    try:  # a Client would wait forever for a server that is silent, or a worker
        if asyncio.run(asyncio.wait_for(kind(), PATIENCE_S)) != "Scheduler":
            raise ValueError("it is a worker")
        client = Client(scheduler, timeout=PATIENCE_S)
        client.wait_for_workers(1, PATIENCE_S)
    except Exception as error:  # whatever Dask makes of what another server sends
        hint = f"({str(error) or type(error).__name__}); write tcp://HOST:PORT, as `dask scheduler` prints it"
        raise UserError(f"--scheduler {scheduler}: no Dask scheduler with workers answers there {hint}") from None
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
        context = multiprocessing.get_context("spawn")
        with concurrent.futures.ProcessPoolExecutor(processes, context, end_with_parent) as pool:
            local = {pool.submit(function, task): task for task in tasks}
            for done in concurrent.futures.as_completed(local):
                yield local[done], done.exception() or done.result()
        return
    with connected(scheduler) as client:
        from distributed import as_completed

        futures = {client.submit(function, task, pure=False, retries=RETRIES): task for task in tasks}
        for future in as_completed(futures):
            yield futures.pop(future), future.exception() or future.result()
