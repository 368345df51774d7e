"""Packs a tree of plain values, arrays and known dataclasses as JSON and a few long arrays, and unpacks it exactly.

Unpacking executes no code: a tree may hold only the types listed here and the dataclasses that the caller names. Long
lists are stored by columns, so that tens of thousands of observations take milliseconds.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from itertools import chain
from math import isfinite
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
_KIND = "~"  # marks values without a JSON type
_LONG = 4  # longer lists of one type are stored by columns
_DTYPES = {"f8": np.float64, "f4": np.float32, "i8": np.int64, "i4": np.int32, "u1": np.uint8, "b1": np.bool_}
_CODES = {np.dtype(dtype): code for code, dtype in _DTYPES.items()}
_KINDS = ("float", "array", "dict", "tuple", "set", "some", "numbers", "arrays", "tuples", "lists", "object", "objects",
          "again", "columns")  # fmt: skip
_FLOATS, _INTS, _PLAIN = {float, np.float64}, {int, np.int64}, {int, str, bool, type(None)}


class Stateful:
    """Saves and restores the attributes named in `_STATE`."""

    _STATE: ClassVar[tuple[str, ...]]

    def state(self) -> dict[str, Any]:
        """Returns the state as a tree; its parts are not copies and change with the object."""
        return {name: getattr(self, name) for name in self._STATE}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores what `state` returned."""
        for name in self._STATE:
            setattr(self, name, state[name])


class Packer:
    """Packs a tree. A dataclass object that occurs twice is stored once, except in lists stored by columns."""

    def __init__(self, known: Mapping[str, type]) -> None:
        self._names = {kind: name for name, kind in known.items()}
        self._buffers: dict[str, list[NDArray[Any]]] = {}
        self._sizes: dict[str, int] = {}
        self._met: dict[int, int] = {}

    def arrays(self) -> Arrays:
        """The long arrays (N,) of the packed trees, by dtype code; to be called once, at the end.

        The parts that they are made of are released.
        """
        return {code: np.concatenate(self._buffers.pop(code)) for code in list(self._buffers)}

    def pack(self, value: Any) -> Any:
        """A value in JSON form. Raises TypeError for unsupported values."""
        if type(value) in _PLAIN or (type(value) is float and isfinite(value)):
            return value
        if isinstance(value, np.ndarray):
            return self._array(value)
        if isinstance(value, np.generic):
            return self.pack(value.item())
        if isinstance(value, float):
            return {_KIND: "float", "v": repr(value)}
        if isinstance(value, list):
            return self._list(value)
        if isinstance(value, (tuple, set)):
            return {_KIND: type(value).__name__, "v": self._list(list(value))}
        if isinstance(value, dict):
            return {_KIND: "dict", "k": self._list(list(value)), "v": self._list(list(value.values()))}
        return self._object(value)

    def _object(self, value: Any) -> Any:
        if id(value) in self._met:
            return {_KIND: "again", "n": self._met[id(value)]}
        name, names = self._named(type(value))
        packed = {_KIND: "object", "c": name, "f": names, "v": [self.pack(getattr(value, n)) for n in names]}
        self._met[id(value)] = len(self._met)  # after its parts, in the order in which they are unpacked
        return packed

    def _named(self, kind: type) -> tuple[str, list[str]]:
        if kind not in self._names or not is_dataclass(kind):
            raise TypeError(f"no state can hold a {kind.__name__}")
        return self._names[kind], [f.name for f in fields(kind) if f.init]

    def _array(self, value: NDArray[Any]) -> dict[str, Any]:
        if value.dtype not in _CODES:
            raise TypeError(f"no state can hold an array of {value.dtype}")
        if _by_columns(value):
            return {_KIND: "columns", "v": self._array(value.T)}
        code = _CODES[value.dtype]
        start = self._sizes.get(code, 0)
        self._sizes[code] = start + value.size
        self._buffers.setdefault(code, []).append(value.ravel())
        return {_KIND: "array", "d": code, "o": start, "s": list(value.shape)}

    def _list(self, items: Sequence[Any]) -> Any:
        """Packs short lists item by item, long ones of one type by columns."""
        kinds = set(map(type, items)) if len(items) > _LONG else set()
        absent = type(None)
        if absent in kinds and len(kinds) > 1:
            there = np.array([item is not None for item in items])
            return {_KIND: "some", "m": self._array(there), "v": self._list([i for i in items if i is not None])}
        if kinds and kinds <= _FLOATS:
            return {_KIND: "numbers", "v": self._array(np.array(items, dtype=np.float64))}
        if kinds and kinds <= _INTS and min(items) >= -(2**63) and max(items) < 2**63:
            return {_KIND: "numbers", "v": self._array(np.array(items, dtype=np.int64))}
        kind = kinds.pop() if len(kinds) == 1 else None
        if kind is bool:
            return {_KIND: "numbers", "v": self._array(np.array(items))}
        if kind is np.ndarray:
            turned = [_by_columns(item) for item in items]
            rows = [item.T if turn else item for item, turn in zip(items, turned, strict=True)]
            if rows[0].ndim and len({(r.dtype, r.ndim, r.shape[1:]) for r in rows}) == 1:
                sizes = self._array(np.array([len(row) for row in rows]))
                return {_KIND: "arrays", "n": sizes, "v": self._array(np.concatenate(rows)), "t": self._list(turned)}
        if kind in (tuple, list):
            sizes = self._array(np.array([len(item) for item in items]))
            return {_KIND: f"{kind.__name__}s", "n": sizes, "v": self._list(list(chain.from_iterable(items)))}
        if kind in self._names:
            name, names = self._named(kind)
            columns = [self._list([getattr(item, n) for item in items]) for n in names]
            return {_KIND: "objects", "c": name, "f": names, "n": len(items), "v": columns}
        return [self.pack(item) for item in items]


def _by_columns(array: NDArray[Any]) -> bool:
    """Whether a matrix is stored by columns: its products may round differently from those of one stored by rows."""
    return array.ndim == 2 and array.flags.f_contiguous and not array.flags.c_contiguous


class Unpacker:
    """Unpacks what a `Packer` packed. Raises ValueError, TypeError, KeyError or IndexError where it was not."""

    def __init__(self, known: Mapping[str, type], arrays: Arrays) -> None:
        self._known, self._arrays = known, arrays
        self._met: list[Any] = []

    def unpack(self, packed: Any) -> Any:
        """The value that was packed."""
        if isinstance(packed, list):
            return [self.unpack(item) for item in packed]
        if not isinstance(packed, dict):
            return packed
        if packed[_KIND] not in _KINDS:
            raise ValueError(f"nothing is a {packed[_KIND]!r}")
        read: Callable[[dict[str, Any]], Any] = getattr(self, f"_read_{packed[_KIND]}")
        return read(packed)

    def _read_float(self, packed: dict[str, Any]) -> float:
        return float(packed["v"])

    def _read_array(self, packed: dict[str, Any]) -> NDArray[Any]:
        shape, start = tuple(packed["s"]), packed["o"]
        flat, count = self._arrays[packed["d"]], 1
        for size in shape:
            count *= size
        if start < 0 or min(shape, default=0) < 0 or start + count > len(flat):
            raise ValueError("an array leaves the file")
        return flat[start : start + count].reshape(shape).copy()

    def _read_dict(self, packed: dict[str, Any]) -> dict[Any, Any]:
        return dict(zip(self.unpack(packed["k"]), self.unpack(packed["v"]), strict=True))

    def _read_tuple(self, packed: dict[str, Any]) -> tuple[Any, ...]:
        return tuple(self.unpack(packed["v"]))

    def _read_set(self, packed: dict[str, Any]) -> set[Any]:
        return set(self.unpack(packed["v"]))

    def _read_some(self, packed: dict[str, Any]) -> list[Any]:
        items = iter(self.unpack(packed["v"]))
        return [next(items) if there else None for there in self.unpack(packed["m"]).tolist()]

    def _read_numbers(self, packed: dict[str, Any]) -> list[Any]:
        numbers: list[Any] = self.unpack(packed["v"]).tolist()
        return numbers

    def _read_arrays(self, packed: dict[str, Any]) -> list[NDArray[Any]]:
        parts = zip(self._parts(packed), self.unpack(packed["t"]), strict=True)
        return [part.copy().T if turned else part.copy() for part, turned in parts]

    def _read_columns(self, packed: dict[str, Any]) -> NDArray[Any]:
        return np.asarray(self.unpack(packed["v"]).T)

    def _read_tuples(self, packed: dict[str, Any]) -> list[tuple[Any, ...]]:
        return [tuple(part) for part in self._parts(packed)]

    def _read_lists(self, packed: dict[str, Any]) -> list[list[Any]]:
        return [list(part) for part in self._parts(packed)]

    def _parts(self, packed: dict[str, Any]) -> list[Any]:
        ends = np.cumsum(self.unpack(packed["n"])).tolist()
        values = self.unpack(packed["v"])
        if ends and ends[-1] != len(values):
            raise ValueError("parts do not add up")
        return [values[a:b] for a, b in zip([0, *ends], ends, strict=False)]

    def _read_object(self, packed: dict[str, Any]) -> Any:
        made = self._class(packed)(**dict(zip(packed["f"], map(self.unpack, packed["v"]), strict=True)))
        self._met.append(made)
        return made

    def _read_objects(self, packed: dict[str, Any]) -> list[Any]:
        kind, names = self._class(packed), packed["f"]
        columns = [self.unpack(column) for column in packed["v"]]
        if len(columns) != len(names) or {len(column) for column in columns} != {packed["n"]}:
            raise ValueError("columns do not fit")
        return [kind(**dict(zip(names, row, strict=True))) for row in zip(*columns, strict=True)]

    def _read_again(self, packed: dict[str, Any]) -> Any:
        return self._met[packed["n"]]

    def _class(self, packed: dict[str, Any]) -> type:
        kind = self._known[packed["c"]]
        if packed["f"] != [f.name for f in fields(kind) if f.init]:
            raise ValueError(f"{packed['c']} has other fields")
        return kind
