"""A run's state in its folder: written while it runs, so that nothing is lost, and read to go on or to come back."""

import logging
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

from data import UserError
from sgslam.serialization.state_file import read_about, read_state, write_state
from sgslam.session.state_types import TYPES

FILE = "state.npz"  # in a run's folder
LONGEST_S = 60.0  # that may be lost
SHARE = 0.005  # of a run that writing its state may take
_log = logging.getLogger(__name__)


class Resumable(Protocol):
    """What can be kept and gone on with; `SceneGraphSlam` is."""

    @property
    def keyframes(self) -> int:
        """How many there are so far."""
        ...

    def state(self) -> dict[str, Any]:
        """All that it knows, as a tree (see `state_tree`)."""
        ...

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on from what `state` told; raises KeyError, TypeError or ValueError where it was unlike."""
        ...


class Checkpoints:
    """Writes the state of a run into its folder, as often as less than a hundredth of the run's time allows.

    `about` tells what the run is of (see `run_inputs`). A disk that is full costs the checkpoint, not the run.
    """

    def __init__(self, folder: Path, about: dict[str, Any]) -> None:
        self.path, self._about = folder / FILE, about
        self._written, self._took = perf_counter(), 0.0
        self._failed = False

    def write_if_due(self, slam: Resumable, progress: dict[str, Any]) -> None:
        """Writes where it is time to; `progress` is what the caller goes on from."""
        if perf_counter() - self._written >= min(self._took / SHARE, LONGEST_S):
            self.write(slam, progress)

    def write(self, slam: Resumable, progress: dict[str, Any], finished: bool = False) -> bool:
        """Whether the state could be written."""
        began = perf_counter()
        about = {**self._about, "finished": finished, "keyframes": slam.keyframes}
        try:
            write_state(self.path, about, {"slam": slam.state(), "progress": progress}, TYPES)
        except OSError as error:
            if not self._failed:
                _log.warning("%s: the run's state cannot be kept from here on (%s)", self.path, error.strerror)
            self._failed = True
            return False
        finally:
            self._written = perf_counter()
            self._took = self._written - began if slam.keyframes else 0.0  # the first time libraries are loaded
        self._failed = False
        return True


def about_run(folder: Path) -> dict[str, Any]:
    """What the run in a folder is of, and whether it is `finished`. Raises UserError where nothing sound is there."""
    if not (folder / FILE).is_file():
        raise UserError(f"{folder}: holds no run's state ({FILE}); give the --out folder of a run")
    return read_about(folder / FILE)


def load(folder: Path, slam: Resumable) -> dict[str, Any]:
    """Takes a run's state into `slam`, which was made for the same building and with the same settings; returns the
    progress that was written with it.

    Raises UserError where the file is missing, damaged, of another version, or of a run that is unlike.
    """
    about_run(folder)
    _, state = read_state(folder / FILE, TYPES)
    try:
        slam.restore(state["slam"])
        progress: dict[str, Any] = dict(state["progress"])
    except (KeyError, IndexError, ValueError, TypeError, AttributeError) as error:
        why = f"{type(error).__name__}: {error}"
        raise UserError(f"{folder / FILE}: damaged, or of a run that is unlike ({why}); run it anew") from None
    return progress
