"""The state of a run in its folder: written during the run, read to resume it or to use its map."""

import logging
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

from data import UserError
from sgslam.serialization import read_about, read_state, write_state

FILE = "state.bin"  # in a run's folder
LEAST_S = 10.0  # of a run between two checkpoints
SHARE = 0.01  # of the run time that writing checkpoints may take
_log = logging.getLogger(__name__)


class Resumable(Protocol):
    """What has a state, such as `SceneGraphSlam`, or the part of one that tracks."""

    @property
    def keyframes(self) -> int:
        """The number of keyframes so far."""
        ...

    def state(self) -> dict[str, bytes]:
        """The complete state."""
        ...

    def restore(self, state: dict[str, bytes]) -> None:
        """Restores what `state` returned. Raises ValueError if it does not fit."""
        ...


class Checkpoints:
    """Writes the state of a run into its folder, as often as a fixed share of the run time allows.

    `about` identifies the run (see `RunInputs.header`). On a full disk the checkpoint is lost and the run goes on.
    """

    def __init__(self, folder: Path, about: dict[str, Any]) -> None:
        self.path, self._about = folder / FILE, about
        self._written, self._took = perf_counter(), 0.0
        self._failed = False

    def write_if_due(self, slam: Resumable, progress: dict[str, Any]) -> None:
        """Writes a checkpoint if one is due; `progress` is the caller's own state, returned by `load`."""
        if perf_counter() - self._written >= max(self._took / SHARE, LEAST_S):
            self.write(slam, progress)

    def write(
        self, slam: Resumable, progress: dict[str, Any], finished: bool = False, tracking: bytes | None = None
    ) -> bool:
        """Writes a checkpoint; returns whether that succeeded. `tracking` is the state of a tracker elsewhere."""
        began = perf_counter()
        about = {**self._about, "finished": finished, "keyframes": slam.keyframes, "progress": progress}
        try:
            state = slam.state()
            write_state(self.path, about, state if tracking is None else {**state, "tracking": tracking})
        except OSError as error:
            if not self._failed:
                _log.warning("%s: cannot save the run's state (%s); the run goes on without", self.path, error.strerror)
            self._failed = True
            return False
        finally:
            self._written = perf_counter()
            self._took = self._written - began
        self._failed = False
        return True


def about_run(folder: Path) -> dict[str, Any]:
    """The header of a run's state: its inputs, and whether it is `finished`. Raises UserError if there is none."""
    if not (folder / FILE).is_file():
        why = "no run wrote to it, or it was interrupted at its start"
        raise UserError(f"{folder}: no run state ({FILE}) in this folder: {why}")
    return read_about(folder / FILE)


def load(folder: Path, slam: Resumable, with_tracking: bool = True) -> dict[str, Any]:
    """Restores a run's state into `slam`, made for the same building with the same settings; returns the progress that
    was saved with it. `with_tracking`: also that of the tracker.

    Raises UserError if the file is missing, damaged, of another version, or of a different run.
    """
    about_run(folder)
    about, state = read_state(folder / FILE)
    if not with_tracking:
        del state["tracking"]
    try:
        slam.restore(state)
    except ValueError as error:
        raise UserError(f"{folder / FILE}: damaged, or of a different run ({error}); start a new run") from None
    progress: dict[str, Any] = about["progress"]
    return progress
