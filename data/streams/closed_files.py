"""Tells which files of a folder have just been closed by their writer, or renamed into it (inotify(7) of Linux)."""

import ctypes
import errno
import os
import select
import struct
from pathlib import Path

_CLOSE_WRITE, _MOVED_TO = 0x08, 0x80
_EVENT = struct.Struct("iIII")  # watch, mask, cookie, length of the name
_PLENTY = 1 << 16  # bytes of events


class ClosedFiles:
    """Watches a folder from its creation on. A file system that reports nothing (a network's) yields no names."""

    def __init__(self, folder: Path) -> None:
        """Raises OSError if the folder cannot be watched."""
        libc = ctypes.CDLL(None, use_errno=True)
        self._handle = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        watched = libc.inotify_add_watch(self._handle, os.fsencode(folder), _CLOSE_WRITE | _MOVED_TO)
        if self._handle < 0 or watched < 0:
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code), str(folder))

    def wait(self, seconds: float) -> set[str]:
        """The names of files closed or renamed since the last call; waits for at most `seconds` where there are none
        yet."""
        select.select([self._handle], [], [], seconds)
        try:
            events = os.read(self._handle, _PLENTY)
        except OSError as error:
            if error.errno == errno.EAGAIN:
                return set()
            raise
        names, at = set(), 0
        while at < len(events):
            *_, length = _EVENT.unpack_from(events, at)
            at += _EVENT.size + length
            names.add(os.fsdecode(events[at - length : at].rstrip(b"\0")))
        return names

    def close(self) -> None:
        """Ends watching."""
        os.close(self._handle)
