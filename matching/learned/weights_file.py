"""The learned network's file: settings, and weights in half precision by their names in torch.

Numpy reads it without pickle and without torch.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_atomically
from matching.learned.network import CompiledNetwork
from matching.network.dimensions import Settings
from matching.network.features import Array32

SUFFIX = ".npz"
TAG = "sgslam learned 2"  # identifies the format and its version
MOST_BYTES = 1 << 24  # of a file, and of its unpacked content
_TAG, _SETTING, _WEIGHT = "tag", "setting/", "weight/"

Arrays = dict[str, NDArray[Any]]


def write_learned(path: Path, settings: Mapping[str, int], state: Mapping[str, Array32]) -> None:
    """Writes a network atomically; equal networks give equal bytes."""
    arrays: Arrays = {_TAG: np.array(TAG)}
    arrays |= {_SETTING + name: np.array(value) for name, value in settings.items()}
    arrays |= {_WEIGHT + name: value.astype(np.float16) for name, value in state.items()}
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    write_atomically(path, buffer.getvalue())


def read_learned(path: Path) -> tuple[dict[str, int], dict[str, Array32]]:
    """Returns settings and weights in single precision, not yet checked against each other.

    Raises UserError if the file is missing, is not a network file, or has another version.
    """
    arrays = _arrays(path)
    tag = arrays.pop(_TAG, None)
    if tag is None or tag.shape or str(tag) != TAG:
        raise UserError(f"{path}: not a network of the form '{TAG}'; train it again")
    settings, state = ({k[len(of) :]: v for k, v in arrays.items() if k.startswith(of)} for of in (_SETTING, _WEIGHT))
    plain = all(v.dtype == np.int64 and not v.shape for v in settings.values())
    if not plain or any(v.dtype != np.float16 for v in state.values()) or len(settings) + len(state) < len(arrays):
        raise _unfit(path)
    return {k: int(v) for k, v in settings.items()}, {k: v.astype(np.float32) for k, v in state.items()}


def load_learned(path: Path) -> CompiledNetwork:
    """Reads a network, ready for inference.

    Raises UserError if the file is missing, damaged, of another version, or incomplete.
    """
    settings, state = read_learned(path)
    try:
        return CompiledNetwork(Settings(**settings), state)
    except (TypeError, ValueError):
        raise _unfit(path) from None


def _arrays(path: Path) -> Arrays:
    try:
        with path.open("rb") as file:
            packed = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give a network's file ({SUFFIX})") from None
    try:
        with np.load(io.BytesIO(packed), allow_pickle=False) as held:
            sizes = [len(packed), sum(entry.file_size for entry in held.zip.infolist())]
            if max(sizes) > MOST_BYTES or held.zip.testzip():
                raise ValueError("too large, or damaged")
            arrays = dict(held)
            if not all(isinstance(value, np.ndarray) for value in arrays.values()):  # other entries are read as bytes
                raise ValueError("not arrays")
            return arrays
    except Exception:  # numpy's reader runs no code from the file, but may raise anything
        raise UserError(f"{path}: not a network's file; 'python -m matching.train' writes one") from None


def _unfit(path: Path) -> UserError:
    return UserError(f"{path}: its network does not fit this program; train it again")
