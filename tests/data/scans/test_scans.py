"""Scan folders: every format and its damaged forms, order, stamps, and what is skipped."""

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pypcd4 import Encoding, PointCloud

from data.common.errors import UserError
from data.common.files import natural_key
from data.scans import ScanFolder
from data.scans.formats import read_points, read_timed
from data.scans.reading_errors import UnreadableScanError
from data.scans.sources import open_scans
from data.trajectory.stamps import ns_to_seconds, seconds_to_ns

REAL_SCANS = Path(__file__).parents[3] / "../shared/data/scans/vlp16_room_corridor"
POINTS = np.random.default_rng(0).normal(size=(60, 3)).astype(np.float32) * 5


def xyzi(points: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.c_[points, np.full(len(points), 0.5, np.float32)].astype("<f4")


def npy(points: NDArray[np.float32]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, points)
    return buffer.getvalue()


def text_rows(values: NDArray[np.float32], separator: str = " ", end: str = "\n") -> bytes:
    return "".join(separator.join(f"{v:.9g}" for v in row) + end for row in values).encode()


def ply(points: NDArray[np.float32], form: str) -> bytes:
    header = f"ply\nformat {form} 1.0\ncomment made here\nelement vertex {len(points)}\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "intensity")) + "end_header\n"
    data = text_rows(xyzi(points)) if form == "ascii" else xyzi(points).astype(
        ">f4" if "big" in form else "<f4").tobytes()  # fmt: skip
    return header.encode() + data


def pcd(points: NDArray[np.float32], form: str) -> bytes:
    """With a double `time` and a `ring` of 2 bytes; the binary forms with padding of 10 bytes too."""
    padded = form != "ascii"
    kind = [("pad", "u1", 10)] if padded else []
    records = np.zeros(len(points), np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2"),
                                              *kind, ("time", "<f8")]))  # fmt: skip
    for i, name in enumerate("xyz"):
        records[name] = points[:, i]
    pad = (lambda text: f" {text}") if padded else (lambda text: "")
    header = (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z ring{pad('_')} time\n"
        f"SIZE 4 4 4 2{pad('1')} 8\nTYPE F F F U{pad('U')} F\nCOUNT 1 1 1 1{pad('10')} 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {form}\n"
    )
    data = text_rows(np.c_[points, np.zeros((len(points), 2))]) if form == "ascii" else records.tobytes()
    return header.encode() + data


def compressed_pcd(points: NDArray[np.float32], folder: Path) -> bytes:
    ring = np.arange(len(points), dtype=np.uint16)
    types = (np.float32, np.float32, np.float32, np.uint16)
    cloud = PointCloud.from_points([*points.T, ring], ("x", "y", "z", "ring"), types)
    cloud.save(folder / "c", encoding=Encoding.BINARY_COMPRESSED)
    return (folder / "c").read_bytes()


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """One good file of each kind, all of POINTS; keyed by a name whose suffix is the format's."""
    folder = tmp_path_factory.mktemp("forms")
    return {
        "kitti.bin": xyzi(POINTS).tobytes(),
        "single.npy": npy(POINTS),
        "double.npy": npy(np.c_[POINTS, POINTS].astype(np.float64)),
        "columns.npy": npy(np.asfortranarray(POINTS)),
        "ascii.ply": ply(POINTS, "ascii"),
        "little.ply": ply(POINTS, "binary_little_endian"),
        "big.ply": ply(POINTS, "binary_big_endian"),
        "ascii.pcd": pcd(POINTS, "ascii"),
        "binary.pcd": pcd(POINTS, "binary"),
        "compressed.pcd": compressed_pcd(POINTS, folder),
    }


FORMS = ["kitti.bin", "single.npy", "double.npy", "columns.npy", "ascii.ply", "little.ply", "big.ply",
         "ascii.pcd", "binary.pcd", "compressed.pcd"]  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_every_format_gives_the_same_points(name: str, files: dict[str, bytes], tmp_path: Path) -> None:
    (tmp_path / name.upper()).write_bytes(files[name])
    (scan,) = ScanFolder(tmp_path)
    assert scan.points.dtype == np.float64 and scan.points.flags.c_contiguous
    assert np.allclose(scan.points, POINTS, rtol=1e-6, atol=0)
    assert (scan.index, scan.stamp_ns, scan.dropped) == (0, 0, 0)


@pytest.mark.parametrize("name", [f for f in FORMS if f not in ("ascii.ply", "ascii.pcd")])
def test_a_binary_file_cut_anywhere_is_unreadable(name: str, files: dict[str, bytes], tmp_path: Path) -> None:
    whole = files[name]
    path = tmp_path / name
    for length in sorted({*range(1, min(len(whole), 400), 7), len(whole) // 2, len(whole) - 1}):
        path.write_bytes(whole[:length])
        if name == "kitti.bin" and length % 16 == 0:
            continue
        with pytest.raises(UnreadableScanError):
            read_points(path)


@pytest.mark.parametrize("name", ["ascii.ply", "ascii.pcd"])
def test_an_ascii_file_cut_short_is_unreadable(name: str, files: dict[str, bytes], tmp_path: Path) -> None:
    for rows in (1, 20, len(POINTS)):
        (tmp_path / name).write_bytes(b"\n".join(files[name].splitlines()[:-rows]))
        with pytest.raises(UnreadableScanError):
            read_points(tmp_path / name)


BILLION = 10**9


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("binary.pcd", b"POINTS 60", b"POINTS %d" % BILLION),
        ("ascii.pcd", b"POINTS 60", b"POINTS %d" % BILLION),
        ("compressed.pcd", b"POINTS 60", b"POINTS %d" % BILLION),
        ("binary.pcd", b"COUNT 1 1 1 1 10 1", b"COUNT 1 1 1 1 %d 1" % BILLION),
        ("little.ply", b"vertex 60", b"vertex %d" % BILLION),
        ("ascii.ply", b"vertex 60", b"vertex %d" % BILLION),
        ("single.npy", b"(60, 3)", b"(%d, 3)" % BILLION),
    ],
)
def test_a_header_cannot_make_us_allocate(
    name: str, old: bytes, new: bytes, files: dict[str, bytes], tmp_path: Path
) -> None:
    import tracemalloc

    assert old in files[name]
    (tmp_path / name).write_bytes(files[name].replace(old, new))
    tracemalloc.start()
    with pytest.raises(UnreadableScanError):
        read_points(tmp_path / name)
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


def test_arrays_that_are_no_points_are_unreadable(tmp_path: Path) -> None:
    for name, array in {"flat": np.zeros(9), "two": np.zeros((5, 2)), "whole": np.zeros((5, 3), int)}.items():
        np.save(tmp_path / f"{name}.npy", array)
        with pytest.raises(UnreadableScanError):
            read_points(tmp_path / f"{name}.npy")
    np.save(tmp_path / "pickle.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(UnreadableScanError):
        read_points(tmp_path / "pickle.npy")


def test_arrays_with_named_columns_and_organised_ones(tmp_path: Path) -> None:
    table = np.zeros(len(POINTS), [("time", "<f8"), ("ring", "<u2"), *((axis, "<f4") for axis in "xyz")])
    table["x"], table["y"], table["z"], table["time"] = *POINTS.T, np.linspace(0, 0.09, len(POINTS))
    np.save(tmp_path / "named.npy", table)
    points, times = read_timed(tmp_path / "named.npy")
    assert np.array_equal(points, POINTS) and times is not None and np.array_equal(times, table["time"])
    np.save(tmp_path / "image.npy", xyzi(POINTS).reshape(6, 10, 4))
    assert np.array_equal(read_points(tmp_path / "image.npy"), POINTS)


# as Ouster's driver and PCL save it: three kinds of padding, one of them of no bytes; 48 bytes a point
OUSTER = """FIELDS x y z _ intensity t reflectivity ring _ noise _ range _
SIZE 4 4 4 1 4 4 2 1 1 2 1 4 1
TYPE F F F U F U U U U U U U U
COUNT 1 1 1 4 1 1 1 1 0 1 0 1 15
"""
PLAIN = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 60\nHEIGHT 1\nPOINTS 60\nDATA binary\n"


def test_a_pcd_of_ouster_with_padding_of_no_bytes(tmp_path: Path) -> None:
    names, sizes, kinds, counts = (line.split()[1:] for line in OUSTER.splitlines())
    fields = [
        (str(k), f"<{t.lower()}{s}", (int(c),)) for k, (t, s, c) in enumerate(zip(kinds, sizes, counts, strict=True))
    ]
    rows = np.zeros(len(POINTS), fields)
    for k in range(3):
        rows[str(k)] = POINTS[:, k : k + 1]
    rows[str(names.index("t"))] = 1_000_000 * np.arange(60)[:, None]
    assert rows.itemsize == 48
    (tmp_path / "0.pcd").write_bytes(
        (OUSTER + "WIDTH 60\nHEIGHT 1\nPOINTS 60\nDATA binary\n").encode() + rows.tobytes()
    )
    (scan,) = ScanFolder(tmp_path)
    assert np.array_equal(scan.points, POINTS) and scan.point_times is not None
    np.testing.assert_allclose(scan.point_times, np.arange(60) / 1000)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("COUNT 1 1 1\n", ""), ("VERSION 0.7", "VERSION .6"), ("VERSION 0.7", "VERSION 0.6"), ("FIELDS", "COLUMNS"),
        ("POINTS 60\n", ""), ("F F F", "f f f"), ("DATA binary", "data BINARY"), ("HEIGHT 1\nPOINTS 60\n", ""),
        ("SIZE 4 4 4\nTYPE F F F\n", ""), ("WIDTH 60\nHEIGHT 1\n", "WIDTH 7\nHEIGHT 9\n"),
        ("SIZE 4 4 4\nTYPE F F F", "SIZE 8 8 8\nTYPE D D D"),
    ],
)  # fmt: skip
def test_pcd_headers_of_old_versions_and_of_scripts(old: str, new: str, tmp_path: Path) -> None:
    points = POINTS.astype("<f8" if "D" in new.split() else "<f4")
    (tmp_path / "0.pcd").write_bytes(PLAIN.replace(old, new).encode() + points.tobytes())
    assert np.array_equal(read_points(tmp_path / "0.pcd"), POINTS)
    text = PLAIN.replace(old, new).replace("binary", "ascii").replace("BINARY", "ascii")
    (tmp_path / "1.pcd").write_bytes(text.encode() + text_rows(POINTS))
    assert np.allclose(read_points(tmp_path / "1.pcd"), POINTS, rtol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("COUNT 1 1 1", "COUNT 1 1 x", "'COUNT 1 1 x' must have 3 whole numbers"),
        ("SIZE 4 4 4", "SIZE 4 4", "'SIZE 4 4' must have 3 sizes"),
        ("TYPE F F F", "TYPE F F Q", "'TYPE F F Q' must have 3 types"),
        ("FIELDS x y z", "FIELDS x y range", "no line FIELDS with x, y, z"),
        ("WIDTH 60\nHEIGHT 1\nPOINTS 60\n", "", "'WIDTH' must have 1 whole number"),
        ("POINTS 60", "POINTS -3", "'POINTS -3' must have 1 whole number"),
        ("DATA binary", "DATA zip", "'DATA zip' must have 1 of ascii, binary"),
    ],
)
def test_a_pcd_header_that_is_wrong_is_quoted(old: str, new: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "0.pcd").write_bytes(PLAIN.replace(old, new).encode() + POINTS.tobytes())
    with pytest.raises(UnreadableScanError, match=reason):
        read_points(tmp_path / "0.pcd")


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


@pytest.mark.parametrize("order", ["turn", "ring", "none"])
@pytest.mark.parametrize("count", [120, 500, 6000])
@pytest.mark.parametrize("more", ["", "shares", "bytes", "zeros", "bytes rings", "zeros rings", "shares times"])
def test_values_a_point_of_a_bin_are_recognised(more: str, count: int, order: str, tmp_path: Path) -> None:
    """Sizes that are whole numbers of points of 3, 4 and 5 values (60 divides 4 * 120 and the like)."""
    points, random = lidar_points(count, order), np.random.default_rng(2)
    columns = {
        "shares": random.random(count), "bytes": random.integers(0, 256, count), "zeros": np.zeros(count),
        "rings": np.arange(count) % 16, "times": np.linspace(0, 0.1, count),
    }  # fmt: skip
    np.column_stack([points, *(columns[name] for name in more.split())]).astype("<f4").tofile(tmp_path / "0.bin")
    read = read_points(tmp_path / "0.bin")
    assert len(read) == count and np.array_equal(read, points)


def test_a_bin_of_kitti_that_is_cut_off_is_no_bin_of_other_points(tmp_path: Path) -> None:
    whole = xyzi(lidar_points(3000, "ring")).tobytes()
    for lost in (5 * 4, 3 * 4, 4, 60 * 4 - 4):
        (tmp_path / "0.bin").write_bytes(whole[:-lost])
        with pytest.raises(UnreadableScanError, match="4 float32"):
            read_points(tmp_path / "0.bin")


def test_ascii_pcd_may_be_spaced_freely(tmp_path: Path) -> None:
    rows = np.c_[POINTS, np.zeros((60, 2))]
    loose = pcd(POINTS, "ascii").replace(text_rows(rows), text_rows(rows, "  ", " \r\n"))
    (tmp_path / "a.pcd").write_bytes(loose)
    assert np.allclose(read_points(tmp_path / "a.pcd"), POINTS, rtol=1e-6)


def write_bins(folder: Path, names: list[str], points: NDArray[np.float32] = POINTS) -> None:
    folder.mkdir(exist_ok=True)
    for name in names:
        xyzi(points).tofile(folder / name)


def test_bad_returns_are_dropped_and_counted(tmp_path: Path) -> None:
    dirty = np.vstack([POINTS, [[np.nan, 0, 0], [0, 0, 0], [1, np.inf, 1], [-0.0, 0, 0]]])
    write_bins(tmp_path, ["0.bin"], dirty)
    (scan,) = ScanFolder(tmp_path)
    assert scan.dropped == 4
    assert np.array_equal(scan.points, POINTS.astype(np.float64))


def test_one_bad_scan_is_skipped_and_named(tmp_path: Path) -> None:
    write_bins(tmp_path, [f"{i}.bin" for i in range(12)])
    (tmp_path / "3.bin").write_bytes(b"")
    write_bins(tmp_path, ["7.bin"], np.full((4, 3), np.nan))
    folder = ScanFolder(tmp_path)
    for _ in range(2):  # the second pass counts afresh
        scans = list(folder)
        assert [s.index for s in scans] == [0, 1, 2, 4, 5, 6, 8, 9, 10, 11]
        assert [s.stamp_ns for s in scans] == [s.index * 100_000_000 for s in scans]
        assert [(s.index, s.path.name) for s in folder.skipped] == [(3, "3.bin"), (7, "7.bin")]
        assert "empty" in folder.skipped[0].reason and "NaN" in folder.skipped[1].reason


def test_exactly_a_fifth_may_be_unreadable_and_not_one_more(tmp_path: Path) -> None:
    names = [f"{i}.bin" for i in range(10)]
    write_bins(tmp_path, names)
    for name in names[8:]:
        (tmp_path / name).write_bytes(b"17 bytes, no scan")
    assert len(list(ScanFolder(tmp_path))) == 8
    (tmp_path / "1.bin").write_bytes(b"x")
    seen = []
    with pytest.raises(UserError, match=r"3 of 10 .* fifth.* 1\.bin"):
        for scan in ScanFolder(tmp_path):
            seen.append(scan.index)
    assert seen == [0, 2, 3, 4, 5, 6, 7]


def test_a_hopeless_folder_ends_as_soon_as_that_is_certain(tmp_path: Path) -> None:
    write_bins(tmp_path, [f"{i}.bin" for i in range(10)])
    for i in range(3):
        (tmp_path / f"{i}.bin").write_bytes(b"x")
    with pytest.raises(UserError, match="3 of 10"):
        next(iter(ScanFolder(tmp_path)))


def test_natural_order() -> None:
    names = ["2.pcd", "10.pcd", "1.pcd", "a10b2", "a2b10", "a2b9", "010.pcd"]
    assert sorted(names, key=natural_key) == ["1.pcd", "2.pcd", "010.pcd", "10.pcd", "a2b9", "a2b10", "a10b2"]


def test_folder_order_and_guessed_stamps(tmp_path: Path) -> None:
    write_bins(tmp_path, ["10.bin", "2.bin", "1.bin", ".hidden.bin"])
    (tmp_path / "notes.md").write_text("not a scan")
    folder = ScanFolder(tmp_path)
    assert [f.name for f in folder.files] == ["1.bin", "2.bin", "10.bin"]
    assert folder.stamps_ns.tolist() == [0, 100_000_000, 200_000_000]
    assert folder.note is not None and "0.1 s" in folder.note


@pytest.mark.parametrize(
    ("names", "stamps"),
    [
        (["1700000000.100000001.bin", "1700000000.2.bin"], [1700000000100000001, 1700000000200000000]),
        (["1.5.bin", "1.25.bin", "1.1.bin"], [1_100_000_000, 1_250_000_000, 1_500_000_000]),
        (["scan_9.5.bin", "scan_10.25.bin"], [9_500_000_000, 10_250_000_000]),
        (["1700000000000000002.bin", "1700000000000000001.bin"], [1700000000000000001, 1700000000000000002]),
        (["cloud_1700000000000000.bin"], [1700000000000000]),
    ],
)
def test_stamps_in_names(names: list[str], stamps: list[int], tmp_path: Path) -> None:
    write_bins(tmp_path, names)
    folder = ScanFolder(tmp_path)
    assert folder.stamps_ns.tolist() == stamps and folder.note is None
    assert [s.stamp_ns for s in folder] == stamps


@pytest.mark.parametrize("beside", [False, True])
def test_times_txt_wins_over_names(beside: bool, tmp_path: Path) -> None:
    scans = tmp_path / "velodyne"
    write_bins(scans, ["5.5.bin", "6.5.bin", "7.5.bin"])
    ((tmp_path if beside else scans) / "times.txt").write_text("0.000000e+00\n1.036224e-01\n\n0.25\n")
    folder = ScanFolder(scans)
    assert folder.stamps_ns.tolist() == [0, 103_622_400, 250_000_000] and folder.note is None


@pytest.mark.parametrize("is_kitti", [True, False])
def test_kittis_stamps_are_those_of_the_middle_unless_the_user_states_another_instant(
    is_kitti: bool, tmp_path: Path
) -> None:
    write_bins(tmp_path / "velodyne", ["0.bin", "1.bin"])
    (tmp_path / "times.txt").write_text("0.0\n0.1\n")
    if is_kitti:
        (tmp_path / "calib.txt").touch()
    opened, stated = open_scans(tmp_path / "velodyne"), open_scans(tmp_path / "velodyne", stamped="end")
    assert (opened.stamped, stated.stamped) == ("middle" if is_kitti else "start", "end")
    assert ("each scan's middle, as in KITTI; --stamp" in (opened.note or "")) == is_kitti and stated.note is None


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ("0.1\n0.2\n", "2 stamps for the 3 scans"),
        ("0.1\n0.2\n0.3\n0.4", "4 stamps for the 3 scans"),
        ("0.1\n0.3\n0.2\n", "goes backwards from '2.bin'.* to '3.bin'"),
        ("0.1\n0.1\n0.2\n", "repeats from '1.bin'"),
        ("0.1\nsoon\n0.3\n", "line 2: 'soon'"),
        ("0.1\nnan\n0.3\n", "line 2"),
        ("0.1\n1700000000000000000\n0.3\n", "line 2"),
    ],
)
def test_bad_times_are_refused_before_anything_is_read(times: str, message: str, tmp_path: Path) -> None:
    for name in ("1.bin", "2.bin", "3.bin"):
        (tmp_path / name).write_bytes(b"not a scan")
    (tmp_path / "times.txt").write_text(times)
    with pytest.raises(UserError, match=message):
        ScanFolder(tmp_path)


@pytest.mark.parametrize(
    ("step", "unit"), [(100.0, "milliseconds"), (1e5, "microseconds"), (1e8, "nanoseconds"), (1.0, None), (0.1, None)]
)
def test_stamps_in_another_unit_are_refused(step: float, unit: str | None, tmp_path: Path) -> None:
    write_bins(tmp_path, [f"{k}.bin" for k in range(9)])
    (tmp_path / "times.txt").write_text("".join(f"{1e6 + k * step:.3f}\n" for k in range(9)))
    if unit is None:
        assert len(ScanFolder(tmp_path)) == 9
        return
    with pytest.raises(UserError, match=f"seem to be in {unit}"):
        ScanFolder(tmp_path)


def test_names_in_microseconds_are_refused_and_those_in_nanoseconds_read(tmp_path: Path) -> None:
    write_bins(tmp_path / "micro", [f"{1_700_000_000_000_000 + 100_000 * k}.bin" for k in range(9)])
    write_bins(tmp_path / "nano", [f"{1_700_000_000_000_000_000 + 100_000_000 * k}.bin" for k in range(9)])
    with pytest.raises(UserError, match="seem to be in microseconds"):
        ScanFolder(tmp_path / "micro")
    assert ScanFolder(tmp_path / "nano").stamps_ns[1] == 1_700_000_000_100_000_000


def test_stations_of_a_survey_are_minutes_apart_and_that_unevenly(tmp_path: Path) -> None:
    write_bins(tmp_path, [f"{k}.bin" for k in range(6)])
    (tmp_path / "times.txt").write_text("0\n95\n210\n420\n500\n630\n")
    assert len(ScanFolder(tmp_path)) == 6


@pytest.mark.parametrize(
    ("stamp", "unit"),
    [("1700000000123", "milli"), ("1700000000123456", "micro"), ("1700000000123456789", "nano")],
)
def test_the_unit_of_a_time_of_day_is_named(stamp: str, unit: str, tmp_path: Path) -> None:
    write_bins(tmp_path, ["1.bin"])
    (tmp_path / "times.txt").write_text(stamp)
    with pytest.raises(UserError, match=f"seems to be in {unit}seconds"):
        ScanFolder(tmp_path)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ([], "no scans in it"),
        (["1.bin", "2.pcd", "3.pcd"], "1 .bin, 2 .pcd"),
        (["1.5.bin", "1.50.bin"], "repeats"),
        (["1.5.bin", "2.bin"], "'1.5.bin' carries a stamp and '2.bin' does not"),
        (["99999999999999999999.bin"], "too large"),
    ],
)
def test_bad_folders_are_refused(names: list[str], message: str, tmp_path: Path) -> None:
    write_bins(tmp_path, names)
    with pytest.raises(UserError, match=message) as caught:
        ScanFolder(tmp_path)
    assert "\n" not in str(caught.value)


def test_no_folder_at_all(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist"):
        ScanFolder(tmp_path / "nowhere")
    write_bins(tmp_path, ["1.bin"])
    with pytest.raises(UserError, match="is a file"):
        ScanFolder(tmp_path / "1.bin")
    with pytest.raises(UserError, match="write a bag"):
        ScanFolder(tmp_path / "recording.pcap")


@given(st.integers(-(2**63), 2**63 - 1))
def test_stamps_survive_text(stamp: int) -> None:
    assert seconds_to_ns(ns_to_seconds(stamp)) == stamp


def test_real_scans_with_padding_and_ring() -> None:
    if not REAL_SCANS.is_dir():
        pytest.skip("the shared VLP-16 scans are not here")
    scans = list(ScanFolder(REAL_SCANS))
    assert [s.path.stem for s in scans] == [str(i) for i in range(30)]
    ranges = np.linalg.norm(scans[0].points, axis=1)
    assert 20_000 < len(ranges) < 30_000 and 0.3 < np.median(ranges) < 30 and ranges.max() < 150
    # sixteen beams, 2 degrees apart
    elevation = np.degrees(np.arcsin(scans[0].points[:, 2] / ranges))
    assert np.abs(elevation - (2 * np.round((elevation - 1) / 2) + 1)).max() < 0.1
