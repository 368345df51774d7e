"""The state of a run: its objects packed as bytes, and these in a file; damaged files are rejected.

What a run is given, such as its settings and its plan, is named instead of packed. Unpacking calls no function of
another package than numpy, and of ours no more than `__setstate__`.
"""

import io
import json
import pickle
import re
from functools import cached_property
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

from data import UserError
from data.common.files import atomic_file
from sgslam.config import Config

VERSION = 27  # to be raised when an attribute of any object in a state gets another name or meaning
_FIRST_LINE = re.compile(rb"sgslam state (\d{1,9}) ([0-9a-f]{64})")
_PACKAGES = ("data", "matching", "sgslam")
_NUMPY = {
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
}


def pack(value: Any, config: Config, **given: Any) -> bytes:
    """The `value` with all objects that it refers to, but the settings and what else is `given`. Raises TypeError for
    an object whose class is neither plain nor one of ours."""
    raw = io.BytesIO()
    _Packer(raw, _named(config, given)).dump(value)
    return raw.getvalue()


def unpack(raw: bytes, config: Config, **given: Any) -> Any:
    """What was packed, with the settings and what else is `given` now; None where nothing of that name is. Raises
    ValueError if `raw` is anything else."""
    try:
        return _Unpacker(io.BytesIO(raw), _named(config, given)).load()
    except Exception as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _named(config: Config, given: dict[str, Any]) -> dict[str, Any]:
    groups = {f"config.{name}": getattr(config, name) for name in Config.model_fields}
    return {"config": config, **groups, **given}


class _Packer(pickle.Pickler):
    def __init__(self, file: io.BytesIO, given: dict[str, Any]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._name_of = {id(own): name for name, own in given.items() if own is not None}

    def persistent_id(self, value: Any) -> str | None:
        return self._name_of.get(id(value))

    def reducer_override(self, value: Any) -> Any:
        kind = type(value)
        package = kind.__module__.partition(".")[0]
        if package in ("builtins", "numpy"):
            return NotImplemented
        if package not in _PACKAGES:
            raise TypeError(f"no state can hold a {kind.__name__}")
        state = value.__getstate__()
        if isinstance(state, dict):  # what is computed when it is needed is computed again
            state = {k: own for k, own in state.items() if not isinstance(getattr(kind, k, None), cached_property)}
        items = tuple(value) if isinstance(value, tuple) else None
        return _blank, (kind.__module__, kind.__qualname__, items), state


class _Unpacker(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, given: dict[str, Any]) -> None:
        super().__init__(file)
        self._given = given

    def persistent_load(self, name: str) -> Any:
        return self._given.get(name)

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == (__name__, _blank.__name__):
            return _blank
        if (module, name) not in _NUMPY:
            raise pickle.UnpicklingError(f"no state holds a {module}.{name}")
        return super().find_class(module, name)


def _blank(module: str, name: str, items: tuple[Any, ...] | None) -> Any:
    """An object of one of our classes, without its attributes; of a named tuple with its `items`."""
    kind = getattr(import_module(module), name) if module.partition(".")[0] in _PACKAGES else None
    if not isinstance(kind, type) or kind.__module__ != module:
        raise pickle.UnpicklingError(f"no state holds a {module}.{name}")
    return object.__new__(kind) if items is None else tuple.__new__(kind, items)


def write_state(path: Path, about: dict[str, Any], parts: dict[str, bytes]) -> None:
    """Writes `parts` (see `pack`) by name, with a header `about` them (JSON), atomically. Raises OSError if the file
    cannot be written."""
    lengths = {name: len(raw) for name, raw in parts.items()}
    header = json.dumps({"about": about, "parts": lengths}, allow_nan=False).encode() + b"\n"
    digest = sha256(header)
    for raw in parts.values():
        digest.update(raw)
    with atomic_file(path) as file:
        file.write(b"sgslam state %d %s\n" % (VERSION, digest.hexdigest().encode()) + header)
        for raw in parts.values():
            file.write(raw)


def read_state(path: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The header and the parts of a state file. Raises UserError, in one line, if the file is missing, of another
    version, or damaged."""
    try:
        first, _, rest = path.read_bytes().partition(b"\n")
    except OSError as error:
        why = "no run wrote to it, or it was interrupted at its start"
        raise UserError(f"{path}: no run state ({error.strerror}): {why}") from None
    found = _FIRST_LINE.fullmatch(first)
    if found is None:
        raise UserError(f"{path}: not a saved run; it cannot be resumed")
    if int(found[1]) != VERSION:
        raise UserError(f"{path}: saved in version {int(found[1])} of the format, this is {VERSION}; start a new run")
    if sha256(rest).hexdigest().encode() != found[2]:
        raise UserError(f"{path}: damaged; start a new run")
    raw, _, packed = rest.partition(b"\n")
    header, parts, at = json.loads(raw), dict[str, bytes](), 0
    for name, length in header["parts"].items():
        parts[name] = packed[at : at + length]
        at += length
    return header["about"], parts
