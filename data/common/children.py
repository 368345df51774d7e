"""Processes that work for this one."""

import multiprocessing
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from data.common.errors import UserError

R = TypeVar("R")


class ProcessEndedError(UserError):
    """A process ended before it had answered; where it lacked memory, it may do so on another try."""


def run_isolated(function: Callable[..., R], *arguments: Any, what: str) -> R:
    """The function's answer, found by a process of its own, so that its peak memory is its own too.

    Raises what the function raises, and ProcessEndedError, which names `what` was done.
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
        ended = f"{what}: the run's process ended with {process.exitcode}; too little memory?"
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
    with suppress(BrokenPipeError):  # whoever asked has been killed
        sender.send(answer)


def end_with_parent() -> None:
    """Called in a child: it ends when its parent does, even by SIGKILL, so that nobody works for nobody."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def may_have_children() -> None:
    """Lets this process start others although it is a daemon, which multiprocessing forbids.

    A Dask worker below its nanny is one. Its children must be daemons too, or call `end_with_parent`.
    """
    multiprocessing.current_process().daemon = False
