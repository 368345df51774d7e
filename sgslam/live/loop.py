"""The loop of `sgslam live`: takes scans as they come and writes a line for each."""

import contextlib
import json
import os
import queue
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any, TextIO

from data.common.errors import UserError
from data.scans import Scan
from data.streams import Arrival, GrowingFolder
from sgslam.cli.processes.mapping_process import HeldAnchor
from sgslam.live.live_slam import Answer, LiveSlam
from sgslam.perception.scan_checks import in_metres_and_sensor_frame


@dataclass
class LiveLoop:
    """Adds the scans of a stream until it ends, none has come for `idle` seconds, or `is_over` says so."""

    live: LiveSlam
    stream: GrowingFolder
    out: TextIO
    idle: float | None
    is_over: Callable[[], bool]
    _anchors: tuple[HeldAnchor, ...] = ()
    _told_skipped: int = 0
    _came_s: float = 0.0
    _answers: int = 0

    def run(self) -> str | None:
        """Returns the reason if the source ended it by a fault, after some scans. Raises UserError before the first."""
        try:
            for scan in in_metres_and_sensor_frame(self._scans()):
                self._add(scan)
        except BrokenPipeError:  # no one reads the lines any more
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.out.fileno())  # else Python complains at its end
        except UserError as error:
            if not self._answers:
                raise
            return str(error)
        finally:
            self.stream.stop.set()
        return None

    def _add(self, scan: Scan) -> None:
        answer = self.live.add_scan(scan.stamp_ns, scan.points, scan.point_times, came_s=self._came_s)
        self._answers += 1
        print(json.dumps(self._line(scan, answer)), file=self.out, flush=True)

    def _line(self, scan: Scan, answer: Answer) -> dict[str, Any]:
        """With the anchors where they have changed, and scans that were skipped."""
        line: dict[str, Any] = {"scan": scan.index, **answer.to_dict()}
        if answer.anchors != self._anchors:
            self._anchors = answer.anchors
            line["anchors"] = [{"wall": a.wall, "a_id": a.a_id, "state": a.state} for a in answer.anchors]
        if new := self.stream.skipped[self._told_skipped :]:
            self._told_skipped += len(new)
            line["skipped"] = [{"scan": skipped.name, "reason": skipped.reason} for skipped in new]
        return line

    def _scans(self) -> Iterator[Scan]:
        """The scans, read by another thread."""
        arrivals: queue.Queue[Arrival | Exception | None] = queue.Queue(8)  # read ahead where they come quickly
        threading.Thread(target=_read, args=(self.stream, arrivals), daemon=True).start()
        last_s = perf_counter()
        while not self.is_over():
            with contextlib.suppress(queue.Empty):
                arrival = arrivals.get(timeout=0.1)  # then looks whether the end was asked for
                if arrival is None:
                    return
                if isinstance(arrival, Exception):
                    raise arrival
                self._came_s = arrival.came_s
                yield arrival.scan
                last_s = perf_counter()
                continue
            if self.idle is not None and perf_counter() - last_s > self.idle:
                return


def _read(stream: GrowingFolder, arrivals: "queue.Queue[Arrival | Exception | None]") -> None:
    try:
        for arrival in stream:
            arrivals.put(arrival)
        arrivals.put(None)
    except Exception as error:  # the main thread raises it
        arrivals.put(error)
