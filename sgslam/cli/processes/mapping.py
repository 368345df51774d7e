"""The process that maps: it takes the tracker's steps in their order, and writes the results at the end."""

import logging
import os
import pickle
import signal
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from data.common.children import end_with_parent
from data.common.errors import UserError
from sgslam.cli.processes.messages import (
    CheckpointMessage,
    FinishMessage,
    LogMessage,
    MapInputs,
    StartMessage,
    TrackedMessage,
)

if TYPE_CHECKING:
    from sgslam.cli.processes.run_map import RunMap

_NICENESS = 5  # so that the tracker of a live run, which must answer in time, comes first


def map_scans(receiver: Connection, sender: Connection) -> None:
    """The work of the process: `MapInputs` and messages in, a `MapState` after each step, and the content of
    metrics.json at the end. A UserError is sent instead where there is one."""
    from threadpoolctl import threadpool_limits

    from sgslam.cli.processes.run_map import RunMap  # loads all that a run needs

    for number in (signal.SIGINT, signal.SIGTERM):  # they go to both processes; the other one says what follows
        signal.signal(number, signal.SIG_IGN)
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
            sender.send(mapping.finish(_follow(mapping, receiver, sender, inputs.outlives)))
        except UserError as error:
            sender.send(error)


def _follow(mapping: "RunMap", receiver: Connection, sender: Connection, outlives: bool) -> FinishMessage:
    try:
        return _until_finish(mapping, receiver, sender)
    except (EOFError, BrokenPipeError):
        if not outlives:
            raise
        return FinishMessage(remarks=("the tracking process has ended",))


def _until_finish(mapping: "RunMap", receiver: Connection, sender: Connection) -> FinishMessage:
    while True:
        message = pickle.loads(_received(receiver))
        if isinstance(message, FinishMessage):
            return message
        if isinstance(message, TrackedMessage):
            sender.send(mapping.add(message))
        elif isinstance(message, CheckpointMessage):
            mapping.save(message)
        elif isinstance(message, StartMessage):
            mapping.set_start(message.pose)
        elif isinstance(message, LogMessage):
            logging.getLogger(message.name).log(message.level, "%s", message.text)


def _received(receiver: Connection) -> bytes:
    """The next message. Raises EOFError where the other process is gone, also in the middle of a message."""
    try:
        return receiver.recv_bytes()
    except OSError as error:
        raise EOFError from error
