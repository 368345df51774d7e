"""Times of points in every driver's unit and origin, and the rule by which stamps are judged."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans import ScanFolder
from data.scans.point_times import seconds_after, time_field
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
