"""The state file of a run: an npz without pickle, written atomically; damaged files are rejected."""

import json
import tokenize
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import UserError
from data.common.files import atomic_file
from sgslam.serialization.state_tree import Packer, Unpacker

FORMAT, VERSION = "sgslam state", 25
_TREE, _HEADER = "tree", "header"


def write_state(path: Path, about: dict[str, Any], state: Any, known: Mapping[str, type]) -> None:
    """Writes a tree (see `state_tree`) with a header `about` it (JSON), atomically.

    Raises TypeError for unsupported values in the tree, OSError if the file cannot be written.
    """
    packer = Packer(known)
    tree = _bytes(packer.pack(state))
    header = _bytes({"format": FORMAT, "version": VERSION, "about": about})
    with atomic_file(path) as file:
        np.savez(file, allow_pickle=False, **{_HEADER: header, _TREE: tree, **packer.arrays()})


def read_about(path: Path) -> dict[str, Any]:
    """The header of a state file, without reading the rest. Raises UserError as `read_state` does."""
    with _opened(path) as file:
        return _about(path, file)


def read_state(path: Path, known: Mapping[str, type]) -> tuple[dict[str, Any], Any]:
    """The header and the tree of a state file.

    Raises UserError, in one line, if the file is missing, of another version, or damaged.
    """
    with _opened(path) as file:
        about = _about(path, file)
        try:
            names = [name.removesuffix(".npy") for name in file.namelist()]
            arrays = {name: _array(file, name) for name in names if name not in (_HEADER, _TREE)}
            return about, Unpacker(known, arrays).unpack(json.loads(_array(file, _TREE).tobytes()))
        except _DAMAGE as error:
            reason = str(error).partition("\n")[0]  # numpy explains a large header over several lines
            raise UserError(f"{path}: damaged, or of another version ({reason}); start a new run") from None


def _bytes(value: Any) -> NDArray[np.uint8]:
    return np.frombuffer(json.dumps(value, allow_nan=False, separators=(",", ":")).encode(), dtype=np.uint8)


# the errors that a flipped byte anywhere in a file can cause
_DAMAGE = (ValueError, TypeError, KeyError, IndexError, AttributeError, EOFError, OSError, zipfile.BadZipFile,
           NotImplementedError, RecursionError, MemoryError, OverflowError, RuntimeError, UserError, SyntaxError,
           tokenize.TokenError)  # fmt: skip


def _opened(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except FileNotFoundError:
        raise UserError(f"{path}: there is no such file; nothing was saved there") from None
    except _DAMAGE as error:
        raise UserError(f"{path}: not a saved run ({type(error).__name__}); it cannot be resumed") from None


def _about(path: Path, file: zipfile.ZipFile) -> dict[str, Any]:
    try:
        header = json.loads(_array(file, _HEADER).tobytes())
        if header["format"] != FORMAT:
            raise ValueError("of another format")
        version, about = header["version"], header["about"]
    except _DAMAGE as error:
        raise UserError(f"{path}: not a saved run ({type(error).__name__}); it cannot be resumed") from None
    if version != VERSION or not isinstance(about, dict):
        raise UserError(f"{path}: saved in version {version} of the format, this is {VERSION}; start a new run")
    return about


def _array(file: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """A stored array (N,) of numbers, checked against the size of the file."""
    entry = file.getinfo(f"{name}.npy")
    if entry.compress_type != zipfile.ZIP_STORED or entry.file_size != entry.compress_size:
        raise ValueError("compressed")  # a few bytes could expand to fill the memory
    raw = BytesIO(file.read(entry))
    version = np.lib.format.read_magic(raw)
    if version != (1, 0):
        raise ValueError("of another version of npy")
    shape, _, dtype = np.lib.format.read_array_header_1_0(raw)
    if len(shape) != 1 or dtype.kind not in "fiub" or shape[0] * dtype.itemsize != len(raw.getvalue()) - raw.tell():
        raise ValueError("an array of another size than its header tells")
    return np.frombuffer(raw.getvalue(), dtype=dtype, offset=raw.tell())
