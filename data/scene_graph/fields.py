"""What the fields of a scene graph in JSON may hold."""

import math
from collections.abc import Callable, Mapping
from typing import Any

FARTHEST = 1e9  # m: no coordinate on the earth is larger, and squares of it stay exact enough

Check = Callable[[Any], bool]


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= FARTHEST


def _any_number(value: Any) -> bool:  # whether it is finite is told apart
    return _number(value) or (isinstance(value, float) and not math.isfinite(value))


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and -(2**63) <= value < 2**63


def _several(of: Check, count: int | None = None) -> Check:
    def check(value: Any) -> bool:
        return isinstance(value, list) and count in (None, len(value)) and all(map(of, value))

    return check


def _or_none(of: Check) -> Check:
    return lambda value: value is None or of(value)


def _part(value: Any) -> bool:
    """Source, from, to, whether in full height."""
    return (
        isinstance(value, list) and len(value) == 4
        and _text(value[0]) and _number(value[1]) and _number(value[2]) and isinstance(value[3], bool)
    )  # fmt: skip


_PAIR = _several(_any_number, 2)
_COMMON: Mapping[str, Check] = {
    "id": _text, "name": _text, "source": _text, "floor": _or_none(_text), "room": _or_none(_text),
    "centroid": _PAIR, "normal": _PAIR, "length": _or_none(_any_number), "elevation": _or_none(_any_number),
    "height": _or_none(_PAIR), "plane": _or_none(_several(_any_number, 4)), "polygon": _or_none(_several(_PAIR)),
    "parts": _several(_part), "rooms": _several(_text), "observes": _several(_text), "stamp_ns": _whole,
    "pose": _several(_any_number, 7),
}  # fmt: skip


def check_item(item: Any) -> None:
    """Raises ValueError, naming it, where a field of a floor, room, surface, door or keyframe is of the wrong kind."""
    if not isinstance(item, dict):
        raise ValueError(f"{str(item)[:40]} is no object")
    for name, value in item.items():
        if name in _COMMON and not _COMMON[name](value):
            raise ValueError(f"'{name}' of '{str(item.get('id'))[:40]}' is {str(value)[:40]}")
