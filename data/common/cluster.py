"""Runs tasks on the workers of a Dask cluster; every task gets exactly one result.

Dask retries tasks and reruns those of workers that die. Tasks are pure, and only the caller writes files, so the
results equal those of a single machine.
"""

import argparse
import asyncio
import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from copy import copy
from functools import partial
from itertools import islice
from operator import call
from pathlib import Path
from typing import Any, TypeVar

from data.common.build import build
from data.common.cluster_worker import digest, do
from data.common.errors import UserError

CONNECTING_S = 5.0
WORKERLESS_S = 30.0  # without any worker, until a run gives up
LOOK_EVERY_S = 10.0  # for workers; also the longest transfer of a result, since Dask asks a dead worker for longer
AHEAD = 2  # tasks submitted for each thread of the cluster, so that none waits for the next
RETRIES = 2

T = TypeVar("T")
R = TypeVar("R")


def add_options(parser: argparse.ArgumentParser, local: str, help_local: str) -> None:
    """Adds `--scheduler` and the option `local` for a number of local processes; they exclude each other."""
    either = parser.add_mutually_exclusive_group()
    either.add_argument(local, type=int, default=1, metavar="N", help=help_local)
    either.add_argument(
        "--scheduler", type=reached, metavar="tcp://HOST:PORT",
        help="address of a Dask scheduler whose workers do the work; they need the same sgslam, and the named files at "
        "the same paths: see docs/cluster.md",
    )  # fmt: skip


def reached(scheduler: str) -> str:
    """Returns the address if a Dask scheduler answers there within CONNECTING_S; otherwise raises UserError."""
    try:
        from distributed import Security, rpc
    except ImportError:
        raise UserError("--scheduler needs dask.distributed; pip install 'sgslam[cluster]'") from None
    for name in ("distributed", "distributed.client"):  # errors are reported here, in one line
        logging.getLogger(name).setLevel(logging.CRITICAL)

    async def ask() -> None:
        async with rpc(scheduler, connection_args=Security().get_connection_args("client")) as server:
            if (kind := (await server.identity())["type"]) != "Scheduler":
                raise ValueError(f"it is a {kind}")

    try:
        asyncio.run(asyncio.wait_for(ask(), CONNECTING_S))  # a Client would wait forever for a silent server
    except Exception as error:  # whatever Dask makes of what another server sends
        hint = f"({_line(error)}); write tcp://HOST:PORT, as `dask scheduler` prints it"
        raise UserError(f"--scheduler {scheduler}: no Dask scheduler answers there {hint}") from None
    return scheduler


@contextmanager
def connected(scheduler: str) -> Iterator["Cluster"]:
    """Connects to a scheduler (`tcp://HOST:PORT`); on exit, unfinished tasks are released.

    Raises UserError as `reached` does, if a worker has another build of sgslam, and if the connection is lost.
    """
    reached(scheduler)
    from distributed import CancelledError, Client

    with Client(scheduler, timeout=CONNECTING_S) as client:
        cluster = Cluster(client)
        try:
            print(f"{cluster.threads()} threads of workers at {scheduler}", flush=True)
            for worker, found in client.run(build, on_error="return").items():
                if found != build():
                    raise UserError(f"the worker {worker} must have sgslam {build()} as here, but has: {_line(found)}")
            yield cluster
        except Exception as error:
            if client.status == "running" and not isinstance(error, CancelledError):
                raise
            lost = "the connection was lost; give the same command again, finished work is kept"
            raise UserError(f"--scheduler {scheduler}: {lost}") from error


class Cluster:
    """A scheduler and its workers, which may come and go."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def threads(self) -> int:
        """The number of threads of all workers, 1 at least. Raises UserError if there is no worker for WORKERLESS_S."""
        try:
            if not self._client.nthreads():
                self._client.wait_for_workers(1, WORKERLESS_S)
        except TimeoutError:
            raise UserError(f"no Dask worker for {WORKERLESS_S:g} s; start workers, finished work is kept") from None
        return max(1, sum(self._client.nthreads().values()))

    def over(
        self, tasks: Iterable[T], function: Callable[[T], R], name: Callable[[T], str],
        files: Iterable[Path | str] = (), in_order: bool = False,
    ) -> Iterator[tuple[T, R]]:  # fmt: skip
        """Yields every task with its result, in order of completion or `in_order` of the tasks, which may be endless.

        `function` is a function of a module, or a partial of one; `files` are the files it reads. Raises UserError if
        there is no worker for long, if a worker has another sgslam or other files, and for a task that raises, by its
        `name`: at once if it raises a UserError, else after RETRIES. Dask's `allowed-failures` is how often a task's
        worker may die.
        """
        waiting, running = iter(tasks), dict[Any, T]()
        submit = partial(self._client.submit, pure=False, retries=RETRIES)
        checked = partial(do, function, build(), tuple((str(path), digest(path)) for path in files))
        sent = submit(copy, checked)  # a task, too: it goes to each worker once, and again if its worker dies
        while True:
            free = max(0, AHEAD * self.threads() - len(running))
            running.update((submit(call, sent, task), task) for task in islice(waiting, free))
            if not running:
                return
            future, answer = self._first_answer(list(running)[: 1 if in_order else None])
            task = running.pop(future)
            if isinstance(answer, Exception):
                raise answer if isinstance(answer, UserError) else UserError(f"{name(task)}: {_line(answer)}")
            yield task, answer

    def in_order(self, tasks: Iterable[T], function: Callable[[T], R], name: Callable[[T], str]) -> Iterator[R]:
        """Yields the results alone, in the order of the tasks; otherwise as `over`."""
        return (answer for _, answer in self.over(tasks, function, name, in_order=True))

    def _first_answer(self, futures: list[Any]) -> tuple[Any, Any]:
        """Waits for one of the futures and returns it with its result or exception."""
        from distributed import wait

        while True:
            try:
                future = wait(futures, LOOK_EVERY_S, "FIRST_COMPLETED").done.pop()
                return future, future.exception(LOOK_EVERY_S) or future.result(LOOK_EVERY_S)
            except TimeoutError:  # also if a worker died with its result, which is then computed again
                self.threads()


def _line(error: object) -> str:
    """The last line of an error's text, which in a traceback is the reason."""
    return (str(error).strip() or type(error).__name__).splitlines()[-1]
