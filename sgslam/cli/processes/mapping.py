"""The process that maps: it takes tracked scans in their order, and writes the results at the end."""

import os
import pickle
import signal
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from data.common.children import end_with_parent
from data.common.errors import UserError
from sgslam.cli.processes.messages import MapInputs, MapState

if TYPE_CHECKING:
    from sgslam.cli.processes.run_map import RunMap

_NICENESS = 5  # so that the tracker of a live run, which must answer in time, comes first


def map_scans(receiver: Connection, sender: Connection) -> None:
    """The work of the process: `MapInputs` and calls of `RunMap` in, a `MapState` after each scan, and the content of
    metrics.json at the end. A UserError is sent instead where there is one."""
    for number in (signal.SIGINT, signal.SIGTERM):  # they go to both processes; the other one says what follows
        signal.signal(number, signal.SIG_IGN)
    from threadpoolctl import threadpool_limits

    from sgslam.cli.processes.run_map import RunMap  # loads all that a run needs

    threadpool_limits(1, user_api="blas")
    with suppress(BrokenPipeError, EOFError):  # the other process is gone
        inputs: MapInputs = pickle.loads(_received(receiver))
        if inputs.outlives:
            os.nice(_NICENESS)
        else:
            end_with_parent()
        try:
            mapping = RunMap(inputs)
            sender.send(None)  # ready
            sender.send(_results(mapping, receiver, sender, inputs.outlives))
        except UserError as error:
            sender.send(error)


def _results(mapping: "RunMap", receiver: Connection, sender: Connection, outlives: bool) -> dict[str, Any]:
    """Makes the calls that come, up to `finish`."""
    while True:
        try:
            name, arguments = pickle.loads(_received(receiver))
        except EOFError:
            if not outlives:
                raise
            name, arguments = "finish", {"remarks": ["the tracking process has ended"]}
        answer = getattr(mapping, name)(**arguments)
        if name == "finish":
            metrics: dict[str, Any] = answer
            return metrics
        if isinstance(answer, MapState):
            with suppress(BrokenPipeError):  # the next call does not come
                sender.send(answer)


def _received(receiver: Connection) -> bytes:
    """The next call. Raises EOFError where the other process is gone, also in the middle of a call."""
    try:
        return receiver.recv_bytes()
    except OSError as error:
        raise EOFError from error
