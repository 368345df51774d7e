"""Bags that rosbags wrote: every storage, every driver's layout, the topic, damage, and streaming."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_files import NS, START, cloud, lidar_bag, livox, scan_points, store, write_bag

from data.common.errors import UserError
from data.scans import ScanFolder
from data.scans.sources import open_scans

KINDS = ["ros1", "ros1-bz2", "ros1-lz4", "sqlite3", "sqlite3-zstd", "mcap"]
SECONDS = np.linspace(0, 0.099, 40)


def named(path: Path, kind: str) -> Path:
    return path / "drive.bag" if kind.startswith("ros1") else path / "drive"


@pytest.mark.parametrize("kind", KINDS)
def test_every_storage_gives_the_same_scans(kind: str, tmp_path: Path) -> None:
    source = open_scans(lidar_bag(named(tmp_path, kind), kind))
    assert len(source) == 20 and source.stamps_ns is None
    for _ in range(2):  # it can be read again
        scans = list(source)
        assert [s.stamp_ns for s in scans] == [START + k * NS // 10 for k in range(20)]
        for k, scan in enumerate(scans):
            np.testing.assert_array_equal(scan.points, scan_points(k).astype(float))
            assert scan.point_times is not None
            np.testing.assert_allclose(scan.point_times, SECONDS, atol=1e-8)
        assert not source.skipped and not source.remarks and source.note is None


@pytest.mark.parametrize("suffix", [".db3", ".mcap"])
def test_single_files_and_folders_without_metadata(suffix: str, tmp_path: Path) -> None:
    folder = lidar_bag(tmp_path / "drive", "mcap" if suffix == ".mcap" else "sqlite3")
    (file,) = folder.glob(f"*{suffix}")
    assert len(list(open_scans(file))) == 20
    (folder / "metadata.yaml").unlink()
    assert len(list(open_scans(folder))) == 20  # a recording that was killed has none


def test_a_bag_split_into_files(tmp_path: Path) -> None:
    types = store(True)
    for part in range(3):
        stamps = [START + (10 * part + k) * NS // 10 for k in range(10)]
        messages = [(s, cloud(types, scan_points(k), s)) for k, s in enumerate(stamps)]
        write_bag(tmp_path / f"drive_{part + 9}.bag", "ros1", {"/points": messages})
    stamps = [s.stamp_ns for s in open_scans(tmp_path)]
    assert len(stamps) == 30 and stamps == sorted(stamps)


LAYOUTS: dict[str, dict[str, Any]] = {
    "velodyne": {"time": ("time", SECONDS.astype(np.float32)), "ring": True},
    "hesai": {"time": ("timestamp", START * 1e-9 + SECONDS), "padding": 1},
    "ouster, organised": {"time": ("t", (SECONDS * 1e9).astype(np.uint32)), "height": 4, "row_padding": 7},
    "livox": {"time": ("timestamp", START + SECONDS * 1e9), "padding": 0},
    "microseconds": {"time": ("time_stamp", (SECONDS * 1e6).astype(np.uint32))},
    "big endian": {"time": ("offset_time", (SECONDS * 1e9).astype(np.uint32)), "order": ">", "height": 2},
    "doubles": {"time": ("time", SECONDS - 0.099), "xyz": "f8"},
}


@pytest.mark.parametrize("ros1", [True, False])
@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts_of_all_drivers(name: str, ros1: bool, tmp_path: Path) -> None:
    points = scan_points(3)
    points[0], points[17] = np.nan, 0.0
    message = cloud(store(ros1), points, START, **LAYOUTS[name])
    kind = "ros1" if ros1 else "mcap"
    (scan,) = open_scans(write_bag(named(tmp_path, kind), kind, {"/p": [(START, message)]}))
    good = np.r_[1:17, 18:40]
    np.testing.assert_array_equal(scan.points, points[good].astype(float))
    assert scan.dropped == 2 and scan.point_times is not None
    expected = SECONDS - 0.099 if name == "doubles" else SECONDS
    np.testing.assert_allclose(scan.point_times, expected[good], atol=2e-6)


@pytest.mark.parametrize("row_step", [0, 20, 40 * 16, 10**6])
def test_a_row_step_that_does_not_fit_the_data_is_ignored(row_step: int, tmp_path: Path) -> None:
    """As drivers leave it: of the whole cloud, or of what it was before rows were cut or joined."""
    message = cloud(store(), scan_points(3), START, height=4)
    message.row_step = row_step
    (scan,) = open_scans(write_bag(tmp_path / "bag", "mcap", {"/p": [(START, message)]}))
    np.testing.assert_array_equal(scan.points, scan_points(3).astype(float))
    message.data = message.data[:-1]
    with pytest.raises(UserError, match="it claims 40 points"):
        list(open_scans(write_bag(tmp_path / "cut", "mcap", {"/p": [(START, message)]})))


@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
def test_livox_messages(kind: str, tmp_path: Path) -> None:
    types = store(kind == "ros1")
    points, offsets = scan_points(1), (SECONDS * 1e9).astype(np.uint32)
    bag = write_bag(named(tmp_path, kind), kind, {"/livox/lidar": [(START, livox(types, points, offsets, START))]})
    (scan,) = open_scans(bag)
    np.testing.assert_array_equal(scan.points, points.astype(float))
    assert scan.stamp_ns == START and scan.point_times is not None
    np.testing.assert_allclose(scan.point_times, SECONDS, atol=1e-8)


def test_the_topic_is_guessed_named_or_asked_for(tmp_path: Path) -> None:
    types = store()
    lidar = [(START + k, cloud(types, scan_points(k), START + k * NS, ring=True)) for k in range(3)]
    depth = [(START + k, cloud(types, scan_points(9), START + k * NS)) for k in range(5)]
    bag = write_bag(tmp_path / "two", "mcap", {"/camera/depth": depth, "/os/points": lidar})
    source = open_scans(bag)
    assert len(source) == 3 and source.note is not None and "/os/points" in source.note
    assert len(open_scans(bag, "camera/depth")) == 5
    with pytest.raises(UserError, match=r"no such topic .* /camera/depth \(5\), /os/points \(3\)"):
        open_scans(bag, "/velodyne_points")
    unclear = write_bag(tmp_path / "unclear", "mcap", {"/a": depth, "/b": depth})
    with pytest.raises(UserError, match=r"several topics .*/a \(5\), /b \(5\).*--topic"):
        open_scans(unclear)


def test_headers_without_stamps_and_bags_without_scans(tmp_path: Path) -> None:
    types = store()
    unset = [(START + k * NS, cloud(types, scan_points(k), 0)) for k in range(4)]
    source = open_scans(write_bag(tmp_path / "unset", "mcap", {"/p": unset}))
    assert [s.stamp_ns for s in source] == [START + k * NS for k in range(4)]
    assert "time of recording" in source.remarks[0]
    text = types.types["std_msgs/msg/String"]("hello")
    with pytest.raises(UserError, match=r": no scans \(PointCloud2"):
        open_scans(write_bag(tmp_path / "none", "sqlite3", {"/chatter": [(START, text)]}))
    with pytest.raises(UserError, match="does not exist"):
        open_scans(tmp_path / "nowhere.bag")
    (tmp_path / "text.bag").write_text("no bag at all")
    with pytest.raises(UserError, match=r": no scans \(PointCloud2"):
        open_scans(tmp_path / "text.bag")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_what_can_be_read_of_a_bag_that_was_cut_off_is_used(kind: str, share: float, tmp_path: Path) -> None:
    bag = lidar_bag(named(tmp_path, kind), kind, count=200)
    file = bag if bag.is_file() else next(p for p in bag.iterdir() if p.suffix in (".db3", ".mcap"))
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    (bag / "metadata.yaml").unlink(missing_ok=True) if bag.is_dir() else None
    source = open_scans(bag)
    stamps = [s.stamp_ns for s in source]
    indices = [(s - START) * 10 // NS for s in stamps]
    assert indices == sorted(set(indices)) and indices[:50] == list(range(50))  # pages of a table end in no order
    assert 200 * share * 0.75 < len(stamps) < 200
    assert len(source.remarks) == 1 and "what could be read is used" in source.remarks[0]


def test_a_damaged_chunk_costs_its_own_scans(tmp_path: Path) -> None:
    bag = lidar_bag(tmp_path / "drive.bag", "ros1-lz4", count=200)
    raw = bytearray(bag.read_bytes())
    raw[len(raw) // 2 : len(raw) // 2 + 200] = bytes(200)
    bag.write_bytes(raw)
    source = open_scans(bag)
    assert 170 <= len([s.stamp_ns for s in source]) < 200
    assert len(source.remarks) == 1 and "of 200 scans" in source.remarks[0]


def test_bad_messages_are_skipped_and_counted(tmp_path: Path) -> None:
    types = store()
    messages = [(START + k * NS // 10, cloud(types, scan_points(k), START + k * NS // 10)) for k in range(30)]
    nan = cloud(types, np.full((40, 3), np.nan), START + 5 * NS // 10)
    messages[5] = (messages[5][0], nan)
    messages[9][1].width = 10**9
    messages[12][1].header.stamp.sec -= 1000
    messages[20][1].fields = messages[20][1].fields[:2]
    source = open_scans(write_bag(tmp_path / "bad", "mcap", {"/p": messages}))
    assert [s.index for s in source] == [k for k in range(30) if k not in (5, 9, 12, 20)]
    reasons = [s.reason for s in source.skipped]
    assert [word in reason for word, reason in zip(("NaN", "claims", "goes back", "no fields"), reasons, strict=True)]
    assert source.skipped[0].name == "bad, scan 5"


def test_mcap_of_other_origin(tmp_path: Path) -> None:
    """ROS 1 messages in MCAP, as `mcap convert` makes them: rosbags refuses the profile."""
    bag = lidar_bag(tmp_path / "drive", "mcap")
    (file,) = bag.glob("*.mcap")
    raw = file.read_bytes()
    assert raw[17:25] == b"\x04\x00\x00\x00ros2"
    (tmp_path / "other.mcap").write_bytes(raw[:21] + b"none" + raw[25:])
    source = open_scans(tmp_path / "other.mcap")
    assert len(list(source)) == 20 and not source.remarks


def test_a_bag_is_streamed(tmp_path: Path) -> None:
    import tracemalloc

    types = store()
    big = [(START + k * NS // 10, cloud(types, scan_points(0, 4000), START + k * NS // 10)) for k in range(150)]
    bag = write_bag(tmp_path / "long", "sqlite3", {"/p": big})
    del big
    tracemalloc.start()
    assert sum(1 for _ in open_scans(bag)) == 150
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    size = sum(p.stat().st_size for p in bag.iterdir())
    assert size > 9e6 and peak < 0.6 * size


def test_folders_of_scans_stay_folders_of_scans(tmp_path: Path) -> None:
    np.array([[1, 2, 3, 0]], "<f4").tofile(tmp_path / "0.bin")
    shutil.copy(lidar_bag(tmp_path / "b.bag", "ros1"), tmp_path / "beside.bag")
    assert isinstance(open_scans(tmp_path), ScanFolder)
    with pytest.raises(UserError, match="not a bag"):
        open_scans(tmp_path, "/points")
