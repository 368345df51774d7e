"""Lines on standard input that change a live run: `initialpose X Y YAW`."""

import math
import queue
import signal
import sys
import threading
from contextlib import suppress
from typing import TextIO

from sgslam.cli.processes.messages import Pose2

_FORM = "initialpose X Y YAW (m, m, rad)"


def read_pose(line: str) -> Pose2 | None:
    """The pose that a line gives; None where it has another form."""
    name, *words = line.split() or [""]
    if name != "initialpose" or len(words) != 3:
        return None
    try:
        x, y, yaw = (float(word) for word in words)
    except ValueError:
        return None
    return (x, y, yaw) if all(map(math.isfinite, (x, y, yaw))) else None


class PoseLines:
    """Reads poses from lines, in a thread of its own. A line of another form is reported on standard error."""

    def __init__(self, lines: TextIO) -> None:
        self._poses: queue.SimpleQueue[Pose2] = queue.SimpleQueue()
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTTIN, signal.SIG_IGN)  # a job in the background reads nothing, and is not stopped
        threading.Thread(target=self._read, args=(lines,), daemon=True).start()

    def newest(self) -> Pose2 | None:
        """The newest pose since the last call; None if there is none."""
        pose = None
        with suppress(queue.Empty):
            while True:
                pose = self._poses.get_nowait()
        return pose

    def _read(self, lines: TextIO) -> None:
        with suppress(OSError, ValueError):  # no standard input
            for line in lines:
                pose = read_pose(line)
                if pose is not None:
                    self._poses.put(pose)
                elif line.strip():
                    print(f"not understood: '{line.strip()}'; write {_FORM}", file=sys.stderr)
