"""Scans that are still coming: taken once they are complete, in order, and none is silently left out."""

import os
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from data.common.errors import UserError
from data.streams import Arrival, GrowingFolder, GrowingStamps

SOON = 5.0  # s, within which a busy machine notices
POINTS = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)


@contextmanager
def coming(stream: GrowingFolder) -> Iterator["queue.Queue[Arrival]"]:
    """The arrivals of a stream, as they come, until the context ends."""
    arrivals: queue.Queue[Arrival] = queue.Queue()
    thread = threading.Thread(target=lambda: [arrivals.put(arrival) for arrival in stream])
    thread.start()
    try:
        yield arrivals
    finally:
        stream.stop.set()
        thread.join()


def stamps_of(arrivals: "queue.Queue[Arrival]", count: int) -> list[int]:
    return [arrivals.get(timeout=SOON).scan.stamp_ns for _ in range(count)]


def test_a_file_is_taken_when_its_writer_has_left_it_and_not_before(tmp_path: Path) -> None:
    data = np.c_[POINTS, np.zeros(50)].astype("<f4").tobytes()
    with coming(GrowingFolder(tmp_path)) as arrivals:
        with (tmp_path / "1.25.bin").open("wb") as file:
            file.write(data[:320])  # 20 points, as good as a scan
            file.flush()
            with pytest.raises(queue.Empty):
                arrivals.get(timeout=0.3)
            file.write(data[320:])
        (tmp_path / "1.75.bin").write_bytes(data)
        assert stamps_of(arrivals, 2) == [1_250_000_000, 1_750_000_000]


def test_files_are_taken_in_their_order_with_those_that_were_there_before(tmp_path: Path) -> None:
    for k in range(3):
        np.save(tmp_path / f"{9 + k}.5.npy", POINTS)
        os.utime(tmp_path / f"{9 + k}.5.npy", (0, 0))
    stream = GrowingFolder(tmp_path)
    with coming(stream) as arrivals:
        np.save(tmp_path / ".12.5.npy", POINTS)  # a name that recorders give while they write
        (tmp_path / ".12.5.npy").rename(tmp_path / "12.5.npy")
        (tmp_path / "notes.txt").write_text("no scan")
        assert stamps_of(arrivals, 4) == [int((k + 0.5) * 1e9) for k in (9, 10, 11, 12)]
        np.save(tmp_path / "10.75.npy", POINTS)
        (tmp_path / "13.5.npy").write_bytes(b"damaged")
        np.save(tmp_path / "14.5.npy", POINTS)
        assert stamps_of(arrivals, 1) == [14_500_000_000]
    assert [(own.name, own.index) for own in stream.skipped] == [("10.75.npy", 4), ("13.5.npy", 5)]
    assert "came after 12.5.npy" in stream.skipped[0].reason


def test_a_stamp_far_ahead_costs_only_its_own_scan(tmp_path: Path) -> None:
    (tmp_path / "times.txt").write_text("1\n1.1\n99\n1.2\n")
    for k in range(4):
        np.save(tmp_path / f"{k}.npy", POINTS)
        os.utime(tmp_path / f"{k}.npy", (0, 0))
    stream = GrowingFolder(tmp_path)
    with coming(stream) as arrivals:
        assert stamps_of(arrivals, 3) == [1_000_000_000, 1_100_000_000, 1_200_000_000]
    assert [own.name for own in stream.skipped] == ["2.npy"]


def test_stamps_come_from_a_times_txt_that_grows_or_from_all_names(tmp_path: Path) -> None:
    scan, times = tmp_path / "scans" / "0.npy", tmp_path / "times.txt"
    times.write_text("# seconds\n1.5\n2.")
    stamps = GrowingStamps(scan.parent)
    assert [stamps.stamp_ns(k, scan) for k in range(2)] == [1_500_000_000, None] and not stamps.are_guessed
    times.write_text(times.read_text() + "25\nlate\n")
    with pytest.raises(UserError, match=r"times\.txt, line 4: .*one stamp"):
        stamps.stamp_ns(1, scan)
    assert stamps.stamp_ns(1, scan) == 2_250_000_000
    stamps = GrowingStamps(tmp_path / "other" / "folder")
    assert stamps.stamp_ns(0, Path("1.5.npy")) == 1_500_000_000
    with pytest.raises(UserError, match="its name carries no stamp"):
        stamps.stamp_ns(1, Path("a.npy"))
