"""Processes: how many to use, their environment, and children that end with their parent."""

import multiprocessing
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from data.common.errors import UserError

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
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(sender, function, arguments), daemon=True)
    process.start()
    sender.close()
    try:
        answer: R | BaseException = receiver.recv()
    except EOFError:
        process.join()
        ended = f"{what}: the run's process ended with exit code {process.exitcode}; is there too little memory?"
        raise ProcessEndedError(ended) from None
    process.join()
    if isinstance(answer, BaseException):
        raise answer
    return answer


def _answer(sender: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    end_with_parent()
    answer: Any
    try:
        answer = function(*arguments)
    except Exception as error:
        answer = error
    with suppress(BrokenPipeError):  # the parent has been killed
        sender.send(answer)


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
