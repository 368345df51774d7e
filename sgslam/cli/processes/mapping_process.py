"""The process that maps: it takes tracked scans in their order, and writes the results at the end.

`MappingProcess` is how the process that tracks sees it: messages go there in order, and its newest state is here. Where
the process that tracks is gone, a live run's results are written; another run is resumed.
"""

import multiprocessing
import os
import pickle
import queue
import signal
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.processes import end_with_parent

if TYPE_CHECKING:  # the process is started before these are loaded
    from sgslam.cli.job.inputs import RunInputs
    from sgslam.cli.processes.run_map import RunMap

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class HeldAnchor:
    """An anchor that holds: the wall `wall` of the S-graph, the surface `a_id` of the plan, and how tightly."""

    wall: str
    a_id: str
    state: Literal["tight", "loose"]


@dataclass(frozen=True, eq=False)
class MapState:
    """The state of the map after so many `scans`; the names are those of `Answer`.
    `failed` says why no more scans are added. `place` is the probability of the best place in the plan, and that of the
    runner-up."""

    scans: int = 0
    part: int = 0
    T_map_odom: Floats = field(default_factory=lambda: np.eye(4))
    T_bim_map: Floats | None = None
    anchors: tuple[HeldAnchor, ...] = ()
    map_stamp_ns: int | None = None
    keyframes: int = 0
    failed: str | None = None
    place: tuple[float, float] = (0.0, 0.0)


class MappingProcess:
    """Starts the process, which loads what it needs meanwhile; `begin` and `wait_until_ready` come before all else.

    At most `most_waiting` scans wait there; `put` then waits for one to be done: nothing is dropped. `state` is the
    newest state of the map.
    """

    def __init__(self, most_waiting: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._receiver, their_sender = context.Pipe(duplex=False)
        their_receiver, self._sender = context.Pipe(duplex=False)
        self._process = context.Process(target=_map_scans, args=(their_receiver, their_sender), name="map")
        self._process.start()
        their_receiver.close()
        their_sender.close()
        self.state, self._put, self._most = MapState(), 0, most_waiting
        self._outcome: dict[str, Any] | UserError | None = None  # what the process ended with
        self._changed = threading.Condition()
        self._messages: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._is_ready = False
        threading.Thread(target=self._send, daemon=True).start()
        threading.Thread(target=self._receive, daemon=True).start()

    def begin(self, inputs: "RunInputs") -> None:
        """Tells the process what to do."""
        self._messages.put(pickle.dumps(inputs))

    def wait_until_ready(self) -> None:
        """Raises UserError for what is wrong with the inputs."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_ready or self._outcome is not None)
        self._check()

    @property
    def waiting(self) -> int:
        """How many scans are not in the map yet."""
        return self._put - self.state.scans

    def put(self, call: str, **arguments: Any) -> None:
        """Has the process call a method of its `RunMap`. Raises UserError if it has ended."""
        packed = pickle.dumps((call, arguments), protocol=pickle.HIGHEST_PROTOCOL)  # now: arrays may change afterwards
        if call == "add":
            with self._changed:
                self._changed.wait_for(lambda: self.waiting < self._most or self._outcome is not None)
            self._put += 1
        self._check()
        self._messages.put(packed)

    def finish(self, **told: Any) -> dict[str, Any]:
        """Waits until all scans are in the map and the results are written; returns the content of metrics.json.
        Raises UserError."""
        self.put("finish", **told)
        self.end()
        with self._changed:
            self._changed.wait_for(lambda: self._outcome is not None)
        self._check()
        assert isinstance(self._outcome, dict)
        self._process.join()
        return self._outcome

    def end(self) -> None:
        """Tells the process that nothing comes any more."""
        self._messages.put(None)

    def kill(self) -> None:
        """Ends the process at once."""
        self._process.kill()
        self._process.join()

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
                with self._changed:
                    self.state, self._is_ready = told, True
                    self._changed.notify_all()
        except (EOFError, OSError):
            self._process.join()
            ended = f"the process that builds the map ended with exit code {self._process.exitcode}"
            told = UserError(f"{ended}; too little memory? Start again")
        with self._changed:
            self._outcome = told
            self._changed.notify_all()


def _map_scans(receiver: Connection, sender: Connection) -> None:
    """The work of the process: `RunInputs` and calls of `RunMap` in, a `MapState` after each scan, and the content of
    metrics.json at the end. A UserError is sent instead where there is one."""
    for number in (signal.SIGINT, signal.SIGTERM):  # they go to both processes; the other one says what follows
        signal.signal(number, signal.SIG_IGN)
    from threadpoolctl import threadpool_limits

    from sgslam.cli.processes.run_map import RunMap  # loads all that a run needs

    threadpool_limits(1, user_api="blas")
    with suppress(BrokenPipeError, EOFError):  # the other process is gone
        inputs: RunInputs = pickle.loads(_received(receiver))
        if inputs.options.live:
            os.nice(5)  # the tracker, which must answer in time, comes first
        else:
            end_with_parent()
        try:
            mapping = RunMap(inputs)
            sender.send(MapState())  # ready
            sender.send(_results(mapping, receiver, sender, inputs.options.live))
        except UserError as error:
            sender.send(error)


def _results(mapping: "RunMap", receiver: Connection, sender: Connection, is_live: bool) -> dict[str, Any]:
    """Makes the calls that come, up to `finish`."""
    while True:
        try:
            name, arguments = pickle.loads(_received(receiver))
        except EOFError:
            if not is_live:
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
