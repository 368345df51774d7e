"""Runs tasks on the workers of a Dask cluster; every task gets exactly one result.

Tasks are pure: their inputs are sent along, their results come back, and only the caller writes files. If a worker
dies, Dask runs its task elsewhere, and the results equal those of a single machine.
"""

import argparse
import logging
import re
import socket
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from data.common.build import build
from data.common.cluster_worker import Refused, Work, do, itself
from data.common.errors import UserError

CONNECTING_S = 5.0
WORKERLESS_S = 30.0  # without any worker, until a run gives up
LOOK_EVERY_S = 2.0
AHEAD = 2  # tasks given out for each thread of the cluster
MOST_ASIDE = 10  # tasks that fail, until something is taken to be wrong with all

T = TypeVar("T")
R = TypeVar("R")
Name = Callable[[T], str]
Files = Iterable[Path | str]


@dataclass(frozen=True)
class _Failed:
    why: str


def add_options(parser: argparse.ArgumentParser, local: str, help_local: str) -> None:
    """Adds `--scheduler` and the option `local` for a number of local processes; they exclude each other."""
    either = parser.add_mutually_exclusive_group()
    either.add_argument(local, type=int, default=1, metavar="N", help=help_local)
    either.add_argument(
        "--scheduler", type=reached, metavar="tcp://HOST:PORT",
        help="of a Dask cluster whose workers do it instead; they need the same sgslam, and files that are named must "
        "lie at the same paths there: see docs/cluster.md",
    )  # fmt: skip


@contextmanager
def connected(scheduler: str) -> Iterator["Cluster"]:
    """Connects to a scheduler (`tcp://HOST:PORT`); on exit, unfinished tasks are released.

    Raises UserError as `reached` does, if no worker appears, and if a worker has another build of sgslam.
    """
    reached(scheduler)
    from distributed import Client

    for name in ("distributed", "distributed.client"):  # errors are reported here, in one line
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(scheduler, timeout=CONNECTING_S)
    except (OSError, ValueError, TypeError) as error:
        raise UserError(f"--scheduler {scheduler}: no Dask scheduler answers there ({_line(error)})") from None
    with client:
        cluster = Cluster(client, scheduler)
        cluster.check()
        yield cluster


def reached(scheduler: str) -> str:
    """Returns the address if dask.distributed is installed and a scheduler responds there; otherwise raises UserError.

    Dask itself would retry for long, or wait forever for a server of another kind.
    """
    try:
        there = find_spec("distributed")
    except ValueError:
        there = None
    if there is None:
        raise UserError("--scheduler needs dask.distributed; pip install 'sgslam[cluster]'")
    found = re.fullmatch(r"(tcp|tls)://(.+):(\d+)", scheduler)
    if not found:
        raise UserError(f"--scheduler {scheduler}: write tcp://HOST:PORT, as `dask scheduler` prints it")
    try:
        with socket.create_connection((found[2].strip("[]"), int(found[3])), CONNECTING_S) as line:
            # it greets first, with a message that begins with its length in 8 bytes
            greets = found[1] == "tls" or int.from_bytes(line.recv(8), "little") in range(1, 1 << 20)
    except (OSError, OverflowError) as error:
        raise UserError(f"--scheduler {scheduler}: cannot be reached ({_line(error)}); is it running?") from None
    if not greets:
        raise UserError(f"--scheduler {scheduler}: what answers there is no Dask scheduler")
    return scheduler


class Cluster:
    """A scheduler and its workers, which may come and go."""

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self._name = f"sgslam-{uuid.uuid4().hex[:8]}"
        self._submitted = self._threads = 0
        self._checked_at = self._had_workers = time.monotonic()

    def check(self) -> None:
        """Waits for a first worker. Raises UserError if none appears or a worker has another build."""
        try:
            self._client.wait_for_workers(1, timeout=CONNECTING_S)
        except TimeoutError:
            raise UserError(
                f"--scheduler {self._address}: it has no worker; start some with `dask worker {self._address}`"
            ) from None
        ask = "__import__('data.common.build', fromlist=['build']).build()"  # sgslam's functions cannot be sent
        for worker, message in self._client.run(eval, ask, on_error="return").items():
            if message != build():
                has = (
                    f"sgslam {message}" if isinstance(message, str) else f"no sgslam that it can use ({_line(message)})"
                )
                raise UserError(f"the worker {worker} has {has}, and here it is {build()}; install the same on all")
        self._check_workers()
        print(f"{self._threads} threads of workers at {self._address}", flush=True)

    def over(
        self, tasks: Iterable[T], function: Callable[[T], R], name: Name[T], files: Files = ()
    ) -> Iterator[tuple[T, R]]:
        """Yields every task with its result, in order of completion.

        `function` is a function of a module, or a partial of one; `files` are the files it reads. A task that raises,
        or whose workers die repeatedly, is tried again alone after all others. Raises UserError for what a task raises,
        at once, and at the end for tasks that still fail, by `name`.
        """
        work, aside = self._sent(function, files), []
        for task, answer in self._stream(iter(tasks), work, name):
            if not isinstance(answer, _Failed):
                yield task, answer
                continue
            aside.append((task, answer.why))
            if len(aside) > MOST_ASIDE:
                raise UserError(f"{len(aside)} tasks have failed, the first: {name(aside[0][0])}: {aside[0][1]}")
        failed = []
        for task, why in aside:
            print(f"{name(task)}: {why}; once more, alone", flush=True)
            answer = self._answer(self._submit_task(work, task), [name(task)])
            if isinstance(answer, _Failed):
                failed.append(f"{name(task)}: {answer.why}")
            else:
                yield task, answer
        if failed:
            raise UserError(f"all others are done, but {len(failed)} failed twice: {'; '.join(failed)}")

    def in_order(self, tasks: Iterable[T], function: Callable[[T], R], name: Name[T]) -> Iterator[R]:
        """Yields the results in the order of the tasks, which may be endless; the cluster works ahead as far as it can.

        A failed task is tried once more; raises UserError if that fails too.
        """
        work = self._sent(function)
        ahead: deque[tuple[T, Any]] = deque()
        waiting = iter(tasks)
        while True:
            self._check_workers()
            ahead.extend((task, self._submit_task(work, task)) for task in islice(waiting, self._capacity(len(ahead))))
            if not ahead:
                return
            task, future = ahead.popleft()
            answer = self._answer(future, [name(task)])
            if isinstance(answer, _Failed):
                answer = self._answer(self._submit_task(work, task), [name(task)])
            if isinstance(answer, _Failed):
                raise UserError(f"{name(task)} failed twice: {answer.why}")
            yield answer

    def _stream(self, waiting: Iterator[T], work: Any, name: Name[T]) -> Iterator[tuple[T, Any]]:
        from distributed import CancelledError, wait

        running: dict[Any, T] = {}
        while True:
            self._check_workers(map(name, running.values()))
            running.update(
                (self._submit_task(work, task), task) for task in islice(waiting, self._capacity(len(running)))
            )
            if not running:
                return
            try:
                done = wait(list(running), LOOK_EVERY_S, "FIRST_COMPLETED").done
            except TimeoutError:
                continue
            except CancelledError:
                raise self._workers_lost() from None
            for future in done:
                task = running[future]
                answer = self._answer(future, [name(task)])
                del running[future]
                yield task, answer

    def _sent(self, function: Callable[[Any], Any], files: Files = ()) -> Any:
        return self._submit(itself, Work.of(function, files))

    def _submit_task(self, work: Any, task: Any) -> Any:
        return self._submit(do, work, task)

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        self._submitted += 1
        return self._client.submit(function, *arguments, key=f"{self._name}-{self._submitted}", pure=False)

    def _capacity(self, running: int) -> int:
        return max(0, AHEAD * max(1, self._threads) - running)

    def _answer(self, future: Any, names: Iterable[str]) -> Any:
        """Waits for a result. Raises UserError for a refusal and if the cluster is gone."""
        from distributed import CancelledError, KilledWorker

        while True:
            try:
                answer = future.result(LOOK_EVERY_S)
            except KilledWorker as error:
                return _Failed(f"its worker died, {error.allowed_failures + 1} times")
            except CancelledError:
                raise self._workers_lost() from None
            except Exception as error:
                if future.status == "error":
                    return _Failed(_line(error))
                if not isinstance(error, TimeoutError):
                    raise self._workers_lost() from error
                self._check_workers(names)
                continue
            if isinstance(answer, Refused):
                raise UserError(answer.why)
            return answer

    def _check_workers(self, running: Iterable[str] = ()) -> None:
        """Counts threads at intervals. Raises UserError if there have been none for long."""
        now = time.monotonic()
        if self._threads and now - self._checked_at < LOOK_EVERY_S:
            return
        try:
            self._threads = sum(self._client.nthreads().values())
        except Exception:  # whatever a connection that broke makes of it
            raise self._workers_lost() from None
        self._checked_at = now
        if self._threads:
            self._had_workers = now
        elif now - self._had_workers > WORKERLESS_S:
            raise UserError(
                f"--scheduler {self._address}: all workers are gone, at work on: {', '.join(running)}; what is done "
                "is kept: start workers and give the same command again"
            )

    def _workers_lost(self) -> UserError:
        return UserError(
            f"--scheduler {self._address}: the connection is lost; what is done is kept: give the same command again"
        )


def _line(error: object) -> str:
    """The last line of an error's text, which in a traceback is the reason."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    lines = str(error).strip().splitlines()
    return lines[-1] if lines else type(error).__name__
