"""Samples of an IMU: what is refused, which unit they are in, and the files that hold them."""

import logging
from pathlib import Path

import numpy as np
import pytest
from bag_files import START, cloud, imu, lidar_bag, scan_points, store, write_bag

from data.common.errors import UserError
from data.imu import ImuSamples, checked_imu, read_imu, write_imu

STAMPS = np.arange(5, dtype=np.int64) * 5_000_000 + 1_700_000_000_123_456_789
GYRO = np.arange(15, dtype=np.float64).reshape(5, 3) / 100
ACCEL = np.tile([0.1, -0.2, 9.8], (5, 1))


def imu_bag(path: Path, kind: str, stamps: list[int], *more: str) -> Path:
    """A bag with a scan and the samples, on `/imu` and on topics of the names in `more`."""
    types = store(kind.startswith("ros1"))
    samples = [(START + k, imu(types, s, GYRO[k], ACCEL[k])) for k, s in enumerate(stamps)]
    scans = [(START, cloud(types, scan_points(0), START))]
    return write_bag(path, kind, {"/points": scans} | dict.fromkeys(("/imu", *more), samples))


@pytest.mark.parametrize("kind", ["csv", "ros1-lz4", "sqlite3", "mcap"])
def test_every_form_gives_the_same_samples(kind: str, tmp_path: Path) -> None:
    path = tmp_path / {"csv": "imu.csv", "ros1-lz4": "a.bag"}.get(kind, "a")
    if kind == "csv":
        write_imu(ImuSamples(STAMPS, GYRO, ACCEL), path)
    else:
        imu_bag(path, kind, STAMPS.tolist())
    found = read_imu(path)
    assert found.stamps_ns.tolist() == STAMPS.tolist()  # to the nanosecond
    assert found.gyro == pytest.approx(GYRO, abs=1e-12) and found.accel == pytest.approx(ACCEL, abs=1e-10)


@pytest.mark.parametrize(("size", "in_g"), [(0.7, True), (4.0, True), (7.0, False), (40.0, False)])
def test_specific_forces_in_g_are_converted_and_that_is_logged(
    size: float, in_g: bool, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        found = checked_imu(STAMPS, GYRO, ACCEL / 9.8 * size, "here")
    assert np.median(np.linalg.norm(found.accel, axis=1)) == pytest.approx(size * (9.80665 if in_g else 1.0), rel=1e-3)
    assert ("in g" in caplog.text) == in_g


def replaced(array: np.ndarray, k: int, value: float) -> np.ndarray:
    changed = array.copy()
    changed[k] = value
    return changed


@pytest.mark.parametrize(
    ("stamps", "gyro", "accel", "message"),
    [
        *((STAMPS, GYRO, ACCEL / 9.8 * size, "gravity in it") for size in (0.0, 0.5, 5.5, 60.0, 1000.0)),
        (replaced(STAMPS, 3, STAMPS[2] - 1), GYRO, ACCEL, r"here: the stamp at 1700000000\.133456"),
        (STAMPS, replaced(GYRO, 2, -36.0), ACCEL, "up to 36; give rad/s, not degrees"),
        (STAMPS, GYRO, replaced(ACCEL, 1, np.inf), "not finite"),
    ],
)
def test_wrong_samples_are_refused(stamps: np.ndarray, gyro: np.ndarray, accel: np.ndarray, message: str) -> None:
    with pytest.raises(UserError, match=message):
        checked_imu(stamps, gyro, accel, "here")
    if not message.startswith(("gravity", "up to")):
        with pytest.raises(ValueError, match="IMU"):
            ImuSamples(stamps, gyro, accel)
    assert len(checked_imu(STAMPS, replaced(GYRO, 2, -34.0), ACCEL, "here")) == 5  # as fast as chips measure


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"1,0,0,0,0,0,9.8\n2,0,0,0,0,0\n", "line 2: not in that form"),
        (b"0.005,0,0,0,0,0,9.8\n", "line 1: not in that form"),
        (b"", "; give .*lines of"),
        (b"\xff\xfe\x00", "; give .*lines of"),
    ],
)
def test_wrong_files_are_refused(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "imu.csv").write_bytes(content)
    with pytest.raises(UserError, match=rf"imu\.csv.*{message}"):
        read_imu(tmp_path / "imu.csv")


def test_samples_of_a_bag_are_put_in_order_and_repeated_ones_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stamps = [*STAMPS[[0, 2, 1, 3]].tolist(), int(STAMPS[3])]
    with caplog.at_level(logging.INFO):
        found = read_imu(imu_bag(tmp_path / "a.bag", "ros1", stamps))
    assert found.stamps_ns.tolist() == STAMPS[:4].tolist()
    assert found.gyro.tolist() == GYRO[[0, 2, 1, 3]].tolist() and "1 of 5 samples of /imu are left out" in caplog.text
    unstamped = read_imu(imu_bag(tmp_path / "b", "mcap", [0] * 5))  # the time of recording counts
    assert unstamped.stamps_ns.tolist() == [START + k for k in range(5)]


def test_of_several_imus_one_is_named(tmp_path: Path) -> None:
    bag = imu_bag(tmp_path / "a.bag", "ros1", STAMPS.tolist(), "/camera/imu")
    with pytest.raises(
        UserError, match=r"several .* IMU samples: /camera/imu \(5\), /imu \(5\); choose one with --imu-topic"
    ):
        read_imu(bag)
    assert len(read_imu(bag, "imu")) == len(read_imu(bag, "/camera/imu")) == 5
    (tmp_path / "b.bag").write_bytes(b"no bag")
    write_imu(read_imu(bag, "imu"), tmp_path / "imu.csv")
    for path, topic, message in (
        (bag, "/imo", r"--imu-topic /imo: no such topic with IMU samples .* /imu \(5\)"),
        (tmp_path / "imu.csv", "imu", "is not a bag and has no topics"),
        (lidar_bag(tmp_path / "c.bag", "ros1"), None, r"contains no IMU samples \(sensor_msgs/Imu\)"),
        (tmp_path / "b.bag", None, r"contains no IMU samples .*; it was cut off or is damaged"),
    ):
        with pytest.raises(UserError, match=message):
            read_imu(path, topic)
