"""Times of points in every driver's unit and origin, and the rule by which stamps are judged."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans import ScanFolder
from data.scans.point_times import seconds_after, time_field
from data.scans.writers import SCAN_WRITERS
from data.streams import GrowingFolder
from data.trajectory.stamps import NS

STAMP = 1_700_000_000 * NS + 123_456_789
TURN = np.linspace(0.0, 0.0997, 500)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (TURN.astype(np.float32), TURN),  # Velodyne
        (TURN.astype(np.float32) - np.float32(0.0997), TURN - 0.0997),  # counted back from the end
        ((TURN * 1e9).astype(np.uint32), TURN),  # Ouster, Livox offsets
        ((TURN * 1e6).astype(np.uint32), TURN),
        ((TURN * 1e6).astype(np.float32), TURN),
        (STAMP * 1e-9 + TURN, TURN),  # Hesai, RoboSense
        (STAMP * 1e-9 + TURN - 0.0997, TURN - 0.0997),  # the stamp is the scan's end
        ((STAMP + TURN * 1e9).astype(np.float64), TURN),  # Livox: ns in a double
        (STAMP + (TURN * 1e9).astype(np.int64), TURN),
        (STAMP // 1000 + (TURN * 1e6).astype(np.uint64), TURN),
        (345_678.25 + TURN, TURN),  # seconds of a GPS week, or since the sensor was switched on
        (np.uint64(5 * NS) + (TURN * 1e9).astype(np.uint64), TURN),
        (np.linspace(0, 0.5, 300), np.linspace(0, 0.5, 300)),  # 2 Hz
        (((1 << 32) - 40_000_000 + (TURN * 1e9).astype(np.int64)).astype(np.uint32), TURN),  # ns that pass 2^32
    ],
)
def test_units_and_origins_of_all_drivers(values: NDArray[np.generic], expected: NDArray[np.float64]) -> None:
    seconds = seconds_after(values, STAMP)
    assert seconds is not None
    assert np.abs(seconds - expected).max() < 2e-6


@pytest.mark.parametrize(
    ("values", "begins"),  # s before the stamp, of a scan stamped in its middle and at its end
    [
        (TURN.astype(np.float32), (0.0499, 0.0997)),  # from the first point
        ((TURN * 1e9).astype(np.uint32), (0.0499, 0.0997)),
        (0.004 + TURN[: len(TURN) - 20], (0.0459, 0.0958)),  # the first and the last rays did not return
        (345_678.25 + TURN, (0.0499, 0.0997)),  # since the sensor was switched on
        (TURN - 0.0997, (0.0997, 0.0997)),  # before the stamp
        (TURN - 0.05, (0.05, 0.05)),
        (STAMP * 1e-9 + TURN, (0.0, 0.0)),  # by the stamp's clock
        (STAMP * 1e-9 + TURN - 0.0997, (0.0997, 0.0997)),
    ],
)
def test_times_from_the_first_point_begin_before_a_stamp_that_is_later(
    values: NDArray[np.generic], begins: tuple[float, float]
) -> None:
    plain = seconds_after(values, STAMP, "start")
    for stamped, begin in zip(("middle", "end"), begins, strict=True):
        seconds = seconds_after(values, STAMP, stamped)  # type: ignore[arg-type]
        assert plain is not None and seconds is not None
        assert seconds[0] == pytest.approx(-begin, abs=3e-4)
        assert seconds - seconds[0] == pytest.approx(plain - plain[0], abs=1e-9)


@pytest.mark.parametrize(
    "values",
    [
        np.zeros(10), np.full(10, 7, np.uint32), np.array([]), np.array([0.0, np.nan]), np.array([0.0, 1e300]),
        np.linspace(0, 1e12, 9), np.array(["a"]), np.zeros((3, 2)),
    ],
)  # fmt: skip
def test_times_that_tell_nothing_are_none(values: NDArray[np.generic]) -> None:
    assert seconds_after(values, STAMP) is None


def test_names_of_times() -> None:
    assert time_field(["x", "y", "z", "Timestamp"]) == "Timestamp"
    assert time_field(["x", "offset_time", "t"]) == "t"
    assert time_field(["x", "y", "z", "s", "t"]) is None  # of a texture
    assert time_field(["x", "ring"]) is None
    assert time_field(["x", "scalar_Scalar_field", "scalar_t", "scalar_s"]) is None


@pytest.mark.parametrize(
    "name",
    [
        "scalar_GpsTime", "scalar_time", "scalar_timestamp", "scalar_Scalar_Time", "stamps", "stamp", "ts",
        "timeOffset", "lidar_time", "T", "TIME_STAMP", "gps_time", "point_time_offset", "timeStamp", "offset_time",
        "relTime",
    ],
)  # fmt: skip
def test_names_of_times_in_every_spelling(name: str) -> None:
    assert time_field(["x", "y", "z", "intensity", name, "ring"]) == name


@pytest.mark.parametrize("form", ["pcd binary", "pcd ascii", "ply binary_little_endian", "ply ascii"])
def test_times_in_files_stay_beside_their_points(form: str, tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)).astype("<f4")
    points[[3, 20]] = np.nan
    times = (np.linspace(0, 0.1, 50) * 1e9).astype("<u4")
    rows = np.zeros(50, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4")])
    rows["x"], rows["y"], rows["z"], rows["t"] = *points.T, times
    kind, encoding = form.split()
    if kind == "pcd":
        header = "VERSION 0.7\nFIELDS x y z t\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 50\nHEIGHT 1\n"
        header += f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 50\nDATA {encoding}\n"
    else:
        header = f"ply\nformat {encoding} 1.0\nelement vertex 50\n"
        header += "".join(f"property float {axis}\n" for axis in "xyz") + "property uint t\nend_header\n"
    text = "".join(f"{x} {y} {z} {t}\n" for x, y, z, t in rows.tolist())
    (tmp_path / f"0.{kind}").write_bytes(header.encode() + (text.encode() if "ascii" in form else rows.tobytes()))
    (scan,) = ScanFolder(tmp_path)
    good = np.isfinite(points).all(axis=1)
    assert scan.dropped == 2 and scan.point_times is not None
    np.testing.assert_allclose(scan.point_times, times[good] * 1e-9, atol=1e-9)


def folder_of(path: Path, seconds: list[float]) -> ScanFolder:
    path.mkdir(exist_ok=True)
    for index in range(len(seconds)):
        np.array([[1, 2, 3, 0.5]] * 4, "<f4").tofile(path / f"{index}.bin")
    (path / "times.txt").write_text("".join(f"{s:.3f}\n" for s in seconds))
    return ScanFolder(path)


def steady(count: int) -> list[float]:
    return [100 + k / 10 for k in range(count)]


def test_a_burst_of_duplicates_costs_the_duplicates(tmp_path: Path) -> None:
    seconds = steady(40)
    seconds[20:24] = [seconds[19]] * 4
    folder = folder_of(tmp_path, seconds)
    assert [s.index for s in folder] == [*range(20), *range(24, 40)]
    assert [s.index for s in folder.skipped] == [20, 21, 22, 23] and "repeats" in folder.skipped[0].reason


@pytest.mark.parametrize("wrong", [0, 12, 39])
def test_one_stamp_far_ahead_costs_its_own_scan(wrong: int, tmp_path: Path) -> None:
    seconds = steady(40)
    seconds[wrong] = 5000.0
    folder = folder_of(tmp_path, seconds)
    kept = [s.index for s in folder]
    expected = [k for k in range(40) if k != wrong or wrong == 39]  # at the very end nothing speaks against it
    assert kept == expected


def test_a_long_pause_is_reported_and_survived(tmp_path: Path) -> None:
    seconds = [*steady(20), *(s + 3600 for s in steady(20))]
    folder = folder_of(tmp_path, seconds)
    assert len(list(folder)) == 40 and not folder.skipped
    assert len(folder.remarks) == 1 and "scan 20" in folder.remarks[0] and "3598" in folder.remarks[0]


def test_a_clock_set_back_for_good_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="goes backwards"):
        folder_of(tmp_path, [*steady(20), *(s - 50 for s in steady(20))])
    clock = [*steady(40), *(s - 0.5 for s in steady(50)[40:])]
    folder = folder_of(tmp_path / "little", clock)
    assert len(list(folder)) == 45 and len(folder.skipped) == 5


def timed_folder(path: Path, seconds: list[float], times: NDArray[np.floating]) -> ScanFolder:
    """Scans of 50 points with the same `times`, as PLY."""
    path.mkdir(exist_ok=True)
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    for index in range(len(seconds)):
        SCAN_WRITERS["ply"](path / f"{index}.ply", points, times.astype(np.float32))
    (path / "times.txt").write_text("".join(f"{s:.3f}\n" for s in seconds))
    return ScanFolder(path)


@pytest.mark.parametrize("period", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("begin", [0.0, -0.5, -1.0])
def test_times_from_0_to_1_are_fractions_of_the_interval_between_scans(
    begin: float, period: float, tmp_path: Path
) -> None:
    fractions = np.linspace(begin, begin + 1, 50)
    folder = timed_folder(tmp_path, [period * k for k in range(12)], fractions)
    for scan in folder:
        assert scan.point_times is not None
        np.testing.assert_allclose(scan.point_times, period * fractions, atol=1e-6)
    assert len(folder.remarks) == 1 and f"scans are {period:g} s apart" in folder.remarks[0]


def test_times_in_seconds_stay_seconds(tmp_path: Path) -> None:
    """A scanner of one turn a second, and a quick one of whose scans most are missing; a single scan tells nothing."""
    slow, quick = np.linspace(0, 1, 50), np.linspace(0, 0.1, 50)
    for name, period, times in (("slow", 1.0, slow), ("gaps", 2.0, slow), ("quick", 0.1, quick), ("two", 0.06, quick)):
        folder = timed_folder(tmp_path / name, [period * k for k in range(12)], times)
        assert all(np.allclose(s.point_times, times, atol=1e-6) for s in folder if s.point_times is not None)
        assert len(list(folder)) == 12 and not folder.remarks
    (alone,) = timed_folder(tmp_path / "alone", [5.0], slow)
    assert alone.point_times is not None and np.isclose(alone.point_times.max(), 0.1)


def test_scans_that_overlap_by_their_times_are_told(tmp_path: Path) -> None:
    folder = timed_folder(tmp_path, [0.1 * k for k in range(12)], np.linspace(0, 0.4, 50))
    assert all(s.point_times is not None and np.isclose(s.point_times.max(), 0.4) for s in folder)
    assert len(folder.remarks) == 1 and "scans overlap" in folder.remarks[0]


@pytest.mark.parametrize(("period", "told"), [(0.0125, True), (0.018, True), (0.025, False)])
def test_parts_of_turns_are_told(period: float, told: bool, tmp_path: Path) -> None:
    """As Velodyne's driver publishes them if its `rpm` is eight times the sensor's."""
    folder = folder_of(tmp_path, [period * k for k in range(20)])
    assert len(list(folder)) == 20
    assert [("parts of a turn" in remark) for remark in folder.remarks] == [True] * told


def test_fractions_are_known_while_scans_are_still_coming(tmp_path: Path) -> None:
    folder = timed_folder(tmp_path, [0.2 * k for k in range(12)], np.linspace(0, 1, 50))
    stream, ends = GrowingFolder(folder.path), []
    for arrival in stream:
        assert arrival.scan.point_times is not None
        ends.append(float(arrival.scan.point_times.max()))
        if len(ends) == 12:
            stream.stop.set()
    assert np.allclose(ends, [0.1, *[0.2] * 11])  # of the first one, nothing is known
    assert len(stream.remarks) == 1


def test_a_point_without_time_costs_itself_and_not_the_others_times(tmp_path: Path) -> None:
    times = np.linspace(0, 0.1, 50)
    times[7] = np.nan
    for scan in timed_folder(tmp_path / "one", [0.0, 0.1], times):
        assert scan.dropped == 1 and scan.point_times is not None and scan.point_times.shape == (49,)
        np.testing.assert_allclose(scan.point_times, np.delete(times, 7), atol=1e-6)
    times[:30] = np.nan
    for scan in timed_folder(tmp_path / "most", [0.0, 0.1], times):
        assert scan.point_times is None and len(scan.points) == 50 and not scan.dropped
