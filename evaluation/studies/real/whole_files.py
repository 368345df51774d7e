"""Whether downloaded files are whole: by the sizes that they state of themselves, where their format states one."""

import re
import struct
from collections.abc import Callable, Iterable
from pathlib import Path

from data.common.errors import UserError

_HEAD = 4096  # bytes that hold every header but a long one of PCD
_STEP_END = b"END-ISO-10303-21"


def check_whole(paths: Iterable[Path], advice: str) -> None:
    """Raises UserError with the first of the files that is missing, empty or cut off, how many there are, and `advice`.

    Sizes of LAS, PLY, NumPy and KITTI files are not checked beyond that: they fail when they are read.
    """
    broken = [(path, reason) for path in paths if (reason := defect(path)) is not None]
    if broken:
        (path, reason), more = broken[0], len(broken) - 1
        others = f" (and {more} more)" if more else ""
        raise UserError(f"{path}: {reason}{others}; {advice}")


def defect(path: Path) -> str | None:
    """What is wrong with a file, None if nothing is seen."""
    if not path.is_file():
        return "is missing"
    size = path.stat().st_size
    if not size:
        return "is empty"
    suffix = path.suffix.lower()
    if suffix == ".ifc":
        return None if _STEP_END in _tail(path) else "is cut off: it does not end as an IFC file does"
    stated = _STATED[suffix](path) if suffix in _STATED else None
    return f"is cut off: {size} of {stated} bytes" if stated is not None and size < stated else None


def _tail(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _HEAD))
        return file.read()


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD)


def _pcd(path: Path) -> int | None:
    """Header and points of a binary PCD file."""
    head = _head(path)
    found = re.search(rb"^DATA (binary(?:_compressed)?)\r?\n", head, re.MULTILINE)
    if found is None:
        return None
    if found[1] != b"binary":
        packed = head[found.end() : found.end() + 4]
        return found.end() + 8 + (struct.unpack("<I", packed)[0] if len(packed) == 4 else 0)
    fields = {name: line.split() for name, line in re.findall(rb"^([A-Z]+) (.*)$", head[: found.start()], re.MULTILINE)}
    try:
        sizes = [int(size) for size in fields[b"SIZE"]]
        counts = [int(count) for count in fields.get(b"COUNT", [b"1"] * len(sizes))]
        return found.end() + int(fields[b"POINTS"][0]) * sum(s * c for s, c in zip(sizes, counts, strict=True))
    except (KeyError, IndexError, ValueError):
        return None


def _bag(path: Path) -> int | None:
    """The place of a ROS 1 bag's index, which is at its end; 0 in a bag that was never closed."""
    found = re.search(rb"index_pos=(.{8})", _head(path), re.DOTALL)
    return struct.unpack("<Q", found[1])[0] + 1 if found is not None else None


def _sqlite(path: Path) -> int | None:
    """All pages of an SQLite database, where its header is up to date."""
    head = _head(path)[:100]
    if len(head) < 100 or head[24:28] != head[92:96]:
        return None
    page = struct.unpack(">H", head[16:18])[0]
    return int(struct.unpack(">I", head[28:32])[0] * (65536 if page == 1 else page))


def _e57(path: Path) -> int | None:
    head = _head(path)
    return struct.unpack("<Q", head[16:24])[0] if head.startswith(b"ASTM-E57") and len(head) >= 24 else None


_STATED: dict[str, Callable[[Path], int | None]] = {".pcd": _pcd, ".bag": _bag, ".db3": _sqlite, ".e57": _e57}
