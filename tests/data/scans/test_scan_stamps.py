"""Stamps of scans and times of points: where they come from, their units, and which are not believed."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import natural_key
from data.scans import ScanFolder
from data.scans.point_times import seconds_after
from data.scans.sources import open_scans
from data.scans.writers import SCAN_WRITERS
from data.trajectory.stamps import NS

STAMP = 1_700_000_000 * NS + 123_456_789
TURN = np.linspace(0.0, 0.0997, 500)


def write_bins(folder: Path, names: list[str], times: str = "") -> Path:
    folder.mkdir(exist_ok=True)
    for name in names:
        np.array([[1, 2, 3, 0.5]] * 4, "<f4").tofile(folder / name)
    if times:
        (folder / "times.txt").write_text(times)
    return folder


def folder_of(path: Path, seconds: list[float]) -> ScanFolder:
    names = [f"{k}.bin" for k in range(len(seconds))]
    return ScanFolder(write_bins(path, names, "".join(f"{s:.3f}\n" for s in seconds)))


def test_order_and_guessed_stamps(tmp_path: Path) -> None:
    names = ["2.pcd", "10.pcd", "1.pcd", "a10b2", "a2b10", "a2b9", "010.pcd"]
    assert sorted(names, key=natural_key) == ["1.pcd", "2.pcd", "010.pcd", "10.pcd", "a2b9", "a2b10", "a10b2"]
    write_bins(tmp_path, ["10.bin", "2.bin", "1.bin", ".hidden.bin", "notes.md"])
    folder = ScanFolder(tmp_path)
    assert [f.name for f in folder.files] == ["1.bin", "2.bin", "10.bin"]
    assert folder.stamps_ns.tolist() == [0, 100_000_000, 200_000_000]
    assert folder.note is not None and "0.1 s" in folder.note


@pytest.mark.parametrize(
    ("names", "stamps"),
    [
        (["1700000000.100000001.bin", "1700000000.2.bin"], [1700000000100000001, 1700000000200000000]),
        (["1.5.bin", "1.25.bin", "1.1.bin"], [1_100_000_000, 1_250_000_000, 1_500_000_000]),
        (["1700000000000000002.bin", "1700000000000000001.bin"], [1700000000000000001, 1700000000000000002]),
    ],
)
def test_stamps_in_names(names: list[str], stamps: list[int], tmp_path: Path) -> None:
    folder = ScanFolder(write_bins(tmp_path, names))
    assert folder.stamps_ns.tolist() == stamps and folder.note is None
    assert [s.stamp_ns for s in folder] == stamps


@pytest.mark.parametrize("is_kitti", [True, False])
def test_a_times_file_wins_and_kittis_stamps_are_those_of_the_middle(is_kitti: bool, tmp_path: Path) -> None:
    """Beside the scans or above them; the user may state another instant."""
    scans = write_bins(tmp_path / "velodyne", ["5.5.bin", "6.5.bin", "7.5.bin"])
    ((tmp_path if is_kitti else scans) / "times.txt").write_text("0.000000e+00\n1.036224e-01\n\n0.25\n")
    if is_kitti:
        (tmp_path / "calib.txt").touch()
    opened, stated = open_scans(scans), open_scans(scans, stamped="end")
    assert opened.stamps_ns is not None and opened.stamps_ns.tolist() == [0, 103_622_400, 250_000_000]
    assert (opened.stamped, stated.stamped) == ("middle" if is_kitti else "start", "end")
    assert ("each scan's middle, as in KITTI; --stamp" in (opened.note or "")) == is_kitti and stated.note is None


NINE = [f"{k}.bin" for k in range(9)]


@pytest.mark.parametrize(
    ("names", "times", "message"),
    [
        ([], "", "no scans in it"),
        (["1.bin", "2.pcd", "3.pcd"], "", "1 .bin, 2 .pcd"),
        (["1.5.bin", "2.bin"], "", "'1.5.bin' carries a stamp and '2.bin' does not"),
        ([f"{1_700_000_000_000_000 + 100_000 * k}.bin" for k in range(9)], "", "seem to be in another unit"),
        (NINE[:3], "0.1\n0.2\n0.3\n0.4", "4 stamps for the 3 scans"),
        (NINE[:3], "0.1\n0.3\n0.2\n", "1 of 3 scans have wrong stamps.* 2.bin: its stamp goes back"),
        (NINE[:3], "0.1\nsoon\n0.3\n", "line 2: 'soon'"),
        (NINE[:3], "0.1\nnan\n0.3\n", "line 2"),
        (NINE, "".join(f"{10**6 + 100 * k}\n" for k in range(9)), "seem to be in another unit"),
        (NINE[:1], "1700000000123456789", "seems to be in nanoseconds"),
    ],
)
def test_wrong_folders_and_stamps_are_refused_before_anything_is_read(
    names: list[str], times: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match=message) as caught:
        ScanFolder(write_bins(tmp_path, names, times))
    assert "\n" not in str(caught.value)


def steady(count: int) -> list[float]:
    return [100 + k / 10 for k in range(count)]


@pytest.mark.parametrize(
    ("seconds", "lost"),
    [
        ([*steady(12), 5000.0, *steady(40)[13:]], [12]),
        ([*steady(40), *(s - 0.5 for s in steady(50)[40:])], [40, 41, 42, 43, 44]),  # a clock set back a little
        ([*steady(20), *(s + 3600 for s in steady(20))], []),  # a pause
    ],
)
def test_wrong_stamps_cost_their_own_scans(seconds: list[float], lost: list[int], tmp_path: Path) -> None:
    folder = folder_of(tmp_path, seconds)
    assert [s.index for s in folder] == [k for k in range(len(seconds)) if k not in lost]
    assert [s.index for s in folder.skipped] == lost
    if pauses := [k for k in range(1, 40) if seconds[k] - seconds[k - 1] > 100 and k not in lost]:
        assert len(folder.remarks) == 1 and f"before scan {pauses[0]}" in folder.remarks[0]


def test_a_clock_set_back_for_good_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"20 of 40 .* goes back"):
        folder_of(tmp_path, [*steady(20), *(s - 50 for s in steady(20))])


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (TURN.astype(np.float32), TURN),  # Velodyne
        (TURN.astype(np.float32) - np.float32(0.0997), TURN - 0.0997),  # counted back from the end
        ((TURN * 1e9).astype(np.uint32), TURN),  # Ouster, Livox offsets
        ((TURN * 1e6).astype(np.uint32), TURN),
        (STAMP * 1e-9 + TURN, TURN),  # Hesai, RoboSense
        (STAMP * 1e-9 + TURN - 0.0997, TURN - 0.0997),  # the stamp is the scan's end
        (STAMP + (TURN * 1e9).astype(np.int64), TURN),
        (345_678.25 + TURN, TURN),  # seconds of a GPS week, or since the sensor was switched on
        (((1 << 32) - 40_000_000 + (TURN * 1e9).astype(np.int64)).astype(np.uint32), TURN),  # ns that pass 2^32
    ],
)
def test_units_and_origins_of_all_drivers(values: NDArray[np.generic], expected: NDArray[np.float64]) -> None:
    seconds = seconds_after(values, STAMP)
    assert seconds is not None
    assert np.abs(seconds - expected).max() < 2e-6


def test_times_that_say_nothing_are_none() -> None:
    odd = (np.zeros(10), np.array([]), np.array([0.0, np.nan]), np.array([0.0, 1e300]), np.array(["a"]))
    for values in (*odd, np.zeros((3, 2))):
        assert seconds_after(values, STAMP) is None


def timed_folder(path: Path, period: float, times: NDArray[np.floating], count: int = 12) -> ScanFolder:
    """Scans of 50 points with the same `times`, as PLY."""
    path.mkdir(exist_ok=True)
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    for k in range(count):
        SCAN_WRITERS["ply"](path / f"{k}.ply", points, times.astype(np.float32))
    (path / "times.txt").write_text("".join(f"{period * k:.3f}\n" for k in range(count)))
    return ScanFolder(path)


@pytest.mark.parametrize(("period", "begin"), [(0.05, 0.0), (0.2, -1.0)])
def test_times_from_0_to_1_are_fractions_of_the_interval_between_scans(
    begin: float, period: float, tmp_path: Path
) -> None:
    fractions = np.linspace(begin, begin + 1, 50)
    folder = timed_folder(tmp_path, period, fractions)
    for scan in folder:
        assert scan.point_times is not None
        np.testing.assert_allclose(scan.point_times, period * fractions, atol=1e-6)
    assert len(folder.remarks) == 1 and f"scans are {period:g} s apart" in folder.remarks[0]


@pytest.mark.parametrize(
    ("period", "last", "remark"),
    [(1.0, 1.0, None), (2.0, 1.0, None), (0.06, 0.1, None), (0.1, 0.4, "scans overlap")],
)
def test_times_in_seconds_stay_seconds(period: float, last: float, remark: str | None, tmp_path: Path) -> None:
    times = np.linspace(0, last, 50)
    folder = timed_folder(tmp_path, period, times)
    scans = list(folder)
    assert len(scans) == 12
    assert all(np.allclose(s.point_times, times, atol=1e-6) for s in scans if s.point_times is not None)
    assert [remark in own for own in folder.remarks if remark] == [True] * (remark is not None)
    assert bool(folder.remarks) == (remark is not None)


def test_a_point_without_time_costs_itself_and_not_the_others_times(tmp_path: Path) -> None:
    times = np.linspace(0, 0.1, 50)
    times[7] = np.nan
    for scan in timed_folder(tmp_path / "one", 0.1, times, 2):
        assert scan.dropped == 1 and scan.point_times is not None
        np.testing.assert_allclose(scan.point_times, np.delete(times, 7), atol=1e-6)
    times[:30] = np.nan
    for scan in timed_folder(tmp_path / "most", 0.1, times, 2):
        assert scan.point_times is None and len(scan.points) == 50 and not scan.dropped
    (alone,) = timed_folder(tmp_path / "alone", 0.1, np.linspace(0, 1, 50), 1)
    assert alone.point_times is not None and np.isclose(alone.point_times.max(), 0.1)  # nothing speaks for seconds
