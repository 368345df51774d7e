"""One contract for all forms of scans: the same points, times, stamps and order; what is cut off or wrong is named."""

import re
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scan_files
from bag_files import NS, START, cloud, lidar_bag, store, write_bag
from numpy.typing import NDArray
from scan_files import BAGS, E57, FILES, GOOD, LAYOUTS, SECONDS, UNTIMED, points_of, stamp_of, write_scans

from data.common.errors import UnreadableScanError, UserError
from data.plans import load_bim
from data.scans import ScanFolder
from data.scans.formats import read_points
from data.scans.sources import open_scans

IN_BAGS = [*(f"{kind} of ouster" for kind in BAGS), *(f"{k} of {own}" for k in ("ros1", "mcap") for own in LAYOUTS)]


@pytest.mark.parametrize("form", [*FILES, *E57, *dict.fromkeys(IN_BAGS)])
def test_every_form_gives_the_same_scans(form: str, tmp_path: Path) -> None:
    source = open_scans(write_scans(form, tmp_path))
    is_las = form[-3:].lower() in ("las", "laz")
    for _ in range(2):  # it can be read again
        scans = list(source)
        assert len(source) == len(scans) == 3 and not source.skipped and not source.remarks
        for k, scan in enumerate(scans):
            assert (scan.index, scan.dropped) == (k, 2)
            assert scan.stamp_ns == (k * NS // 10 if form in E57 else stamp_of(k))
            assert scan.points.dtype == np.float64 and scan.points.flags.c_contiguous
            np.testing.assert_allclose(scan.points, points_of(k)[GOOD], rtol=1e-6, atol=1e-5 if is_las else 1e-12)
            assert (scan.point_times is None) == (form in UNTIMED)
            if scan.point_times is not None:
                np.testing.assert_allclose(scan.point_times, SECONDS[GOOD], atol=2e-6)
    if form in E57:  # the points are in the scanner's frame, the poses beside them
        poses = [np.asarray(scan.T_odom_sensor) for scan in scans]
        np.testing.assert_allclose(poses, [[[1, 0, 0, x], *np.eye(4)[1:]] for x in (0.0, 1.5, 3.0)])


@pytest.mark.parametrize("form", FILES)
def test_a_file_that_is_cut_off_is_unreadable(form: str, tmp_path: Path) -> None:
    whole, path = FILES[form](points_of(0)), tmp_path / form
    lengths = [0, 1, 10, 100, 230, len(whole) // 2 + 1, len(whole) - 30]
    if form.startswith("ascii"):
        lengths = [len(b"".join(whole.splitlines(keepends=True)[:-rows])) for rows in (1, 20, 60)]
    for length in lengths if form in ("kitti.bin", "ascii.ply", "ascii.pcd") else [*lengths, len(whole) - 1]:
        path.write_bytes(whole[:length])
        with pytest.raises(UnreadableScanError) if length else pytest.raises(UserError):
            read_points(path) if length else list(ScanFolder(tmp_path))


PLAIN = b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 60\nHEIGHT 1\nPOINTS 60\nDATA binary\n"
FLOATS = points_of(0)[GOOD][:50].tobytes() + bytes(12 * 10)
MANY = b"%d" % 10**9
WRONG = [  # suffix, content, part of what is said
    (".pcd", PLAIN.replace(b"COUNT 1 1 1", b"COUNT 1 1 x"), "'COUNT 1 1 x' must have 3 whole numbers"),
    (".pcd", PLAIN.replace(b"x y z", b"x y range"), "no line FIELDS with x, y, z"),
    (".pcd", PLAIN.replace(b"WIDTH 60\nHEIGHT 1\nPOINTS 60\n", b""), "'WIDTH' must have 1 whole number"),
    (".pcd", PLAIN.replace(b"POINTS 60", b"POINTS " + MANY) + FLOATS, "claims 12000000000 bytes"),
    (".pcd", PLAIN.replace(b"POINTS 60", b"POINTS " + MANY).replace(b"binary", b"ascii"), "claims 1000000000 points"),
    (".pcd", PLAIN.replace(b"binary", b"binary_compressed") + b"\xff\xff\xff\x7f" * 2 + FLOATS, "packed into"),
    (".ply", FILES["little.ply"](points_of(0)).replace(b"vertex 60", b"vertex " + MANY), "claims 1000000000 points"),
    (".ply", FILES["ascii.ply"](points_of(0)).replace(b"vertex 60", b"vertex 61"), "61 points, 60 are there"),
    (".npy", FILES["single.npy"](points_of(0)).replace(b"(60, 3)", b"(%s, 3)" % MANY), "greater than file size"),
    (".npy", scan_files.npy(np.zeros(9)), "shape"),
    (".npy", scan_files.npy(np.zeros((5, 3), int)), "type int64"),
    (".npy", scan_files.npy(np.array([{"a": 1}], dtype=object)), "Python objects"),
    (".las", b"LASF" + bytes(400), "claims more than the file holds"),
]  # fmt: skip


@pytest.mark.parametrize(("suffix", "content", "reason"), WRONG)
def test_a_wrong_file_is_unreadable_and_allocates_little(
    suffix: str, content: bytes, reason: str, tmp_path: Path
) -> None:
    (tmp_path / f"0{suffix}").write_bytes(content)
    tracemalloc.start()
    with pytest.raises(UnreadableScanError, match=re.escape(reason)) as caught:
        read_points(tmp_path / f"0{suffix}")
    assert tracemalloc.get_traced_memory()[1] < 50e6 and "\n" not in str(caught.value)
    tracemalloc.stop()


def lidar_points(count: int, order: str) -> NDArray[np.float32]:
    """Walls of a room of 12 x 8 m by a LiDAR of 16 rings, which lie turn by turn, ring by ring, or in no order."""
    angles = np.linspace(-np.pi, np.pi, -(-count // 16))
    rise, turn = np.meshgrid(np.deg2rad(np.linspace(-15, 15, 16)), angles, indexing="xy" if order == "turn" else "ij")
    along = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=-1).reshape(-1, 3)
    points = along * (np.array([6.0, 4.0, 1.5]) / np.maximum(np.abs(along), 1e-9)).min(axis=1)[:, None]
    points = points + np.random.default_rng(0).normal(0, 0.01, points.shape)
    if order == "none":
        points = np.random.default_rng(1).permutation(points)
    return points[:count].astype("<f4")


@pytest.mark.parametrize("more", ["", "shares", "zeros rings", "shares times"])
def test_values_a_point_of_a_bin_are_recognised(more: str, tmp_path: Path) -> None:
    """Sizes that are whole numbers of points of 3, 4 and 5 values (60 divides 4 * 120 and the like)."""
    for order, count in ((order, count) for order in ("turn", "ring", "none") for count in (120, 500, 6000)):
        points, random = lidar_points(count, order), np.random.default_rng(2)
        columns = {"shares": random.random(count), "bytes": random.integers(0, 256, count), "zeros": np.zeros(count)}
        columns |= {"rings": np.arange(count) % 16, "times": np.linspace(0, 0.1, count)}
        np.column_stack([points, *(columns[name] for name in more.split())]).astype("<f4").tofile(tmp_path / "0.bin")
        assert np.array_equal(read_points(tmp_path / "0.bin"), points), (order, count)


def test_bad_scans_are_skipped_and_named_up_to_a_fifth(tmp_path: Path) -> None:
    for k in range(10):
        (tmp_path / f"{k}.bin").write_bytes(FILES["kitti.bin"](points_of(k)))
    (tmp_path / "3.bin").write_bytes(b"")
    np.full((4, 4), np.nan, "<f4").tofile(tmp_path / "7.bin")
    folder = ScanFolder(tmp_path)
    for _ in range(2):  # the second pass counts afresh
        scans = list(folder)
        assert [(s.index, s.stamp_ns) for s in scans] == [(k, k * NS // 10) for k in (0, 1, 2, 4, 5, 6, 8, 9)]
        assert [(s.index, s.path.name) for s in folder.skipped] == [(3, "3.bin"), (7, "7.bin")]
        assert "empty" in folder.skipped[0].reason and "NaN" in folder.skipped[1].reason
    (tmp_path / "1.bin").write_bytes(b"x")
    seen = []
    with pytest.raises(UserError, match=r"3 of 10 .* fifth.* 1\.bin"):
        for scan in ScanFolder(tmp_path):
            seen.append(scan.index)
    assert seen == [0, 2, 4, 5, 6]  # it ends as soon as that is certain


@pytest.mark.parametrize("suffix", [".db3", ".mcap"])
def test_single_files_and_folders_without_metadata(suffix: str, tmp_path: Path) -> None:
    folder = lidar_bag(tmp_path / "drive", "mcap" if suffix == ".mcap" else "sqlite3")
    (file,) = folder.glob(f"*{suffix}")
    assert len(list(open_scans(file))) == 20
    (folder / "metadata.yaml").unlink()
    assert len(list(open_scans(folder))) == 20  # a recording that was killed has none
    raw = file.read_bytes()
    if suffix == ".mcap":  # ROS 1 messages in MCAP, as `mcap convert` makes them: rosbags refuses the profile
        assert raw[17:25] == b"\x04\x00\x00\x00ros2"
        (tmp_path / "other.mcap").write_bytes(raw[:21] + b"none" + raw[25:])
        source = open_scans(tmp_path / "other.mcap")
        assert len(list(source)) == 20 and not source.remarks


def test_a_bag_split_into_files(tmp_path: Path) -> None:
    types = store(True)
    for part in range(3):
        stamps = [START + (10 * part + k) * NS // 10 for k in range(10)]
        messages = [(s, cloud(types, points_of(k), s)) for k, s in enumerate(stamps)]
        write_bag(tmp_path / f"drive_{part + 9}.bag", "ros1", {"/points": messages})
    stamps = [s.stamp_ns for s in open_scans(tmp_path)]
    assert len(stamps) == 30 and stamps == sorted(stamps)


def test_the_topic_is_guessed_named_or_asked_for(tmp_path: Path) -> None:
    types = store()
    lidar = [(START + k, cloud(types, points_of(k), START + k * NS, ring=True)) for k in range(3)]
    depth = [(START + k, cloud(types, points_of(9), 0)) for k in range(5)]
    bag = write_bag(tmp_path / "two", "mcap", {"/camera/depth": depth, "/os/points": lidar})
    source = open_scans(bag)
    assert len(source) == 3 and source.note is not None and "/os/points" in source.note
    unset = open_scans(bag, "camera/depth")
    assert [s.stamp_ns for s in unset] == [START + k for k in range(5)] and "time of recording" in unset.remarks[0]
    with pytest.raises(UserError, match=r"no such topic .* /camera/depth \(5\), /os/points \(3\)"):
        open_scans(bag, "/velodyne_points")
    unclear = write_bag(tmp_path / "unclear", "mcap", {"/a": depth, "/b": depth})
    with pytest.raises(UserError, match=r"several topics .*/a \(5\), /b \(5\).*--topic"):
        open_scans(unclear)
    text = types.types["std_msgs/msg/String"]("hello")
    with pytest.raises(UserError, match=r": no scans \(PointCloud2"):
        open_scans(write_bag(tmp_path / "none", "sqlite3", {"/chatter": [(START, text)]}))


@pytest.mark.parametrize("kind", BAGS)
def test_what_can_be_read_of_a_bag_that_was_cut_off_is_used(kind: str, tmp_path: Path) -> None:
    name = "drive.bag" if kind.startswith("ros1") else "drive"
    bag = lidar_bag(tmp_path / name, kind, count=200, points=3000 if kind == "mcap" else 40)  # chunks have a megabyte
    file = bag if bag.is_file() else next(p for p in bag.iterdir() if p.suffix in (".db3", ".mcap"))
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    (bag / "metadata.yaml").unlink(missing_ok=True) if bag.is_dir() else None
    source = open_scans(bag)
    indices = [(s.stamp_ns - START) * 10 // NS for s in source]
    assert indices == sorted(set(indices)) and indices[:50] == list(range(50))  # pages of a table end in no order
    assert 75 < len(indices) < 200
    assert len(source.remarks) == 1 and "what could be read is used" in source.remarks[0]


def test_bad_messages_cost_their_own_scans(tmp_path: Path) -> None:
    types = store()
    messages: list[tuple[int, Any]] = [(stamp_of(k), cloud(types, points_of(k), stamp_of(k))) for k in range(30)]
    messages[5] = (stamp_of(5), cloud(types, np.full((40, 3), np.nan), stamp_of(5)))
    messages[9][1].width = 10**9
    messages[12][1].header.stamp.sec -= 1000
    messages[20][1].fields = messages[20][1].fields[:2]
    source = open_scans(write_bag(tmp_path / "bad", "mcap", {"/p": messages}))
    assert [s.index for s in source] == [k for k in range(30) if k not in (5, 9, 12, 20)]
    reasons = [s.reason for s in source.skipped]
    assert [word in reason for word, reason in zip(("NaN", "claims", "goes back", "no fields"), reasons, strict=True)]
    assert source.skipped[0].name == "bad, scan 5"


def test_e57_without_poses_with_a_scan_of_nothing_and_broken(tmp_path: Path) -> None:
    import pye57

    file, points = pye57.E57(str(tmp_path / "a.e57"), mode="w"), points_of(0)[GOOD].astype(float)
    for own in (points, np.zeros((4, 3)), *[points] * 5):
        file.write_scan_raw(dict(zip(("cartesianX", "cartesianY", "cartesianZ"), own.T, strict=True)))
    file.close()
    source = open_scans(tmp_path / "a.e57")
    assert [s.T_odom_sensor for s in source] == [None] * 6 and [s.index for s in source.skipped] == [1]
    whole = (tmp_path / "a.e57").read_bytes()
    for content in (whole[:-500], b"", whole[:100], b"ASTM-E57" + bytes(2000)):
        (tmp_path / "b.e57").write_bytes(content)
        with pytest.raises(UserError, match="E57") as told:
            open_scans(tmp_path / "b.e57")
        assert "\n" not in str(told.value)


def test_a_missing_library_is_named_with_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name, extra in (("laspy", "a.las", "scans"), ("pye57", "a.e57", "scans"), ("ezdxf", "a.dxf", "dxf")):
        monkeypatch.setitem(sys.modules, module, None)  # as if it were not installed
        (tmp_path / name).write_bytes(b"anything")
        with pytest.raises(UserError, match=re.escape(f"pip install 'sgslam[{extra}]'")):
            if name == "a.dxf":
                load_bim(tmp_path / name)
            else:
                list(open_scans(tmp_path if name == "a.las" else tmp_path / name))


def test_paths_that_are_no_scans(tmp_path: Path) -> None:
    scans, bag = tmp_path / "scans", lidar_bag(tmp_path / "beside.bag", "ros1")
    scans.mkdir()
    (scans / "0.bin").write_bytes(FILES["kitti.bin"](points_of(0)))
    (scans / "beside.bag").write_bytes(bag.read_bytes())
    assert isinstance(open_scans(scans), ScanFolder)
    (tmp_path / "text.bag").write_text("no bag at all")
    for path, topic, message in (
        (scans, "/points", "not a bag"),
        (tmp_path / "nowhere", None, "does not exist"),
        (tmp_path / "text.bag", None, "no scans .PointCloud2"),
        (scans / "0.bin", None, "is a file"),
        (tmp_path / "recording.pcap", None, "write a bag"),
    ):
        with pytest.raises(UserError, match=message):
            open_scans(path, topic)
