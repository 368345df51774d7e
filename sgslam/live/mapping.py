"""The process that maps: it takes tracked scans in their order, and writes the results at the end."""

import logging
import os
import pickle
import signal
from contextlib import suppress
from multiprocessing.connection import Connection

from data.common.errors import UserError
from sgslam.live.live_map import LiveMap
from sgslam.live.messages import FinishMessage, LiveInputs, LogMessage, StartMessage, TrackedMessage

_NICENESS = 5  # so that the tracker, which must answer in time, comes first


def map_scans(receiver: Connection, sender: Connection, inputs: LiveInputs) -> None:
    """The work of the process: messages in, a `MapState` after each scan, and the content of metrics.json at the end.

    A UserError is sent instead where there is one. If the other process is gone, the results so far are written.
    """
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to both processes; the other one says what follows
    os.nice(_NICENESS)
    threadpool_limits(1, user_api="blas")
    with suppress(BrokenPipeError):  # the other process is gone
        try:
            mapping = LiveMap(inputs)
            sender.send(None)  # ready
            sender.send(mapping.finish(_follow(mapping, receiver, sender)))
        except UserError as error:
            sender.send(error)


def _follow(mapping: LiveMap, receiver: Connection, sender: Connection) -> FinishMessage:
    try:
        return _until_finish(mapping, receiver, sender)
    except (EOFError, BrokenPipeError):
        return FinishMessage(0.0, (), ("the tracking process has ended",))


def _until_finish(mapping: LiveMap, receiver: Connection, sender: Connection) -> FinishMessage:
    while True:
        message = pickle.loads(_received(receiver))
        if isinstance(message, FinishMessage):
            return message
        if isinstance(message, TrackedMessage):
            sender.send(mapping.add(message))
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
