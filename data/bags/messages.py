"""Standard messages of ROS, from their bytes."""

from functools import cache
from typing import Any

from data.bags.recovery import Record


class BrokenMessageError(Exception):
    """A message that does not hold together; the text is the reason."""


def decoded(data: bytes, msgtype: str, is_cdr: bool) -> Any:
    """The message that ROS 2 (`is_cdr`) or ROS 1 serialised, as an object with its fields.

    Raises BrokenMessageError.
    """
    types = _types(is_cdr)
    try:
        return types.deserialize_cdr(data, msgtype) if is_cdr else types.deserialize_ros1(data, msgtype)
    except Exception as error:  # the library raises many kinds on garbage
        raise BrokenMessageError(reason(error)) from None


def reason(error: Exception) -> str:
    """Why a message is broken, in a line."""
    lines = str(error).splitlines() or [""]
    return f"a broken message ({type(error).__name__}: {lines[0][:120]})"


def stamp_of(message: Any, record: Record) -> int:
    """The stamp of a message's header (ns); that of its recording where the header has none."""
    stamp = message.header.stamp
    return stamp.sec * 1_000_000_000 + stamp.nanosec or record.log_ns


@cache
def _types(is_cdr: bool) -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE if is_cdr else Stores.ROS1_NOETIC)
