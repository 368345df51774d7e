"""The state of a run in its folder: written during the run, read to resume it or to use its map."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

from data import UserError
from sgslam.serialization import read_state, write_state

FILE = "state.bin"  # in a run's folder
EVERY_S = 60.0  # of a run between two checkpoints: what is lost at most where it is killed
_log = logging.getLogger(__name__)


def write_run(folder: Path, about: dict[str, Any], state: dict[str, bytes]) -> bool:
    """Writes a run's state and what is to be known `about` it, in JSON form; returns whether that succeeded. On a full
    disk the run goes on without."""
    try:
        write_state(folder / FILE, about, state)
    except OSError as error:
        _log.warning("%s: cannot save the run's state (%s); the run goes on without", folder / FILE, error.strerror)
        return False
    return True


def read_run(folder: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What is known about a run, such as whether it is `finished`, and its state; raises as `read_state`."""
    return read_state(folder / FILE)


def load(folder: Path, restore: Callable[[dict[str, bytes]], None]) -> dict[str, Any]:
    """Has a run's state restored, in what was made for the same building with the same settings; returns what is known
    about the run. Raises UserError as `read_run`, and for the state of a different run."""
    about, state = read_run(folder)
    try:
        restore(state)
    except ValueError as error:
        raise UserError(f"{folder / FILE}: damaged, or of a different run ({error}); start a new run") from None
    return about
