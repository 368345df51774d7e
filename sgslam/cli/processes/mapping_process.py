"""The process that maps, as the one that tracks sees it: messages go there in order, and its newest state is here."""

import logging
import multiprocessing
import pickle
import queue
import threading
from contextlib import suppress
from dataclasses import replace
from typing import Any

from data.common.errors import UserError
from sgslam.cli.processes.mapping import map_scans
from sgslam.cli.processes.messages import MapInputs, MapState

_log = logging.getLogger(__name__)


class MappingProcess:
    """Starts the process, which loads what it needs meanwhile; `begin` and `wait_until_ready` come before all else.

    At most `most_waiting` scans wait there; `put` then waits for one to be done: nothing is dropped, and there is a
    line in the log if it `warns`. `state` is the newest state of the map.
    """

    def __init__(self, most_waiting: int, warns: bool = False) -> None:
        context = multiprocessing.get_context("spawn")
        self._receiver, their_sender = context.Pipe(duplex=False)
        their_receiver, self._sender = context.Pipe(duplex=False)
        self._process = context.Process(target=map_scans, args=(their_receiver, their_sender), name="map")
        self._process.start()
        their_receiver.close()
        their_sender.close()
        self.state, self._put, self._most = MapState(), 0, most_waiting
        self._warns, self._was_full = warns, False
        self._outcome: dict[str, Any] | UserError | None = None  # what the process ended with
        self._changed = threading.Condition()
        self._messages: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._threads = [threading.Thread(target=own, daemon=True) for own in (self._send, self._receive)]
        self._threads[0].start()

    def begin(self, inputs: MapInputs) -> None:
        """Tells the process what to do."""
        self._messages.put(pickle.dumps(inputs))

    def wait_until_ready(self) -> None:
        """Raises UserError for what is wrong with the inputs."""
        try:
            first = self._receiver.recv()
        except EOFError:
            self._process.join()
            raise self._ended() from None
        if isinstance(first, UserError):
            self._process.join()
            raise first
        self._threads[1].start()

    @property
    def waiting(self) -> int:
        """How many scans are not in the map yet."""
        return self._put - self.state.scans

    def put(self, call: str, **arguments: Any) -> None:
        """Has the process call a method of its `RunMap`. Raises UserError if it has ended."""
        packed = pickle.dumps((call, arguments), protocol=pickle.HIGHEST_PROTOCOL)  # now: arrays may change afterwards
        if call == "add":
            self._wait_for_room()
            self._put += 1
        self._check()
        self._messages.put(packed)

    def finish(self, **told: Any) -> dict[str, Any]:
        """Waits until all scans are in the map and the results are written; returns the content of metrics.json.
        Raises UserError."""
        self.put("finish", **told)
        self.end()
        self._threads[1].join()
        self._process.join()
        if isinstance(self._outcome, dict):
            return self._outcome
        raise self._outcome or self._ended()

    def end(self) -> None:
        """Tells the process that nothing comes any more."""
        self._messages.put(None)

    def kill(self) -> None:
        """Ends the process at once."""
        self._process.kill()
        self._process.join()

    def _wait_for_room(self) -> None:
        is_full = self.waiting >= self._most
        if self._warns and is_full and not self._was_full:
            _log.warning("%d scans wait for the map: tracking now waits for it", self.waiting)
        self._was_full = is_full or (self._was_full and self.waiting > self._most // 2)  # else each scan would warn
        with self._changed:
            self._changed.wait_for(lambda: self.waiting < self._most or self._outcome is not None)

    def _check(self) -> None:
        if isinstance(self._outcome, UserError):
            raise self._outcome

    def _send(self) -> None:
        with suppress(BrokenPipeError):  # `_receive` finds out why
            while (message := self._messages.get()) is not None:
                self._sender.send_bytes(message)
        self._sender.close()

    def _receive(self) -> None:
        try:
            while isinstance(told := self._receiver.recv(), MapState):
                anchors = self.state.anchors if told.anchors is None else told.anchors
                with self._changed:
                    self.state = replace(told, anchors=anchors)
                    self._changed.notify_all()
        except (EOFError, OSError):
            self._process.join()
            told = self._ended()
        with self._changed:
            self._outcome = told
            self._changed.notify_all()

    def _ended(self) -> UserError:
        code = self._process.exitcode
        return UserError(f"the process that builds the map ended with exit code {code}; too little memory? Start again")
