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


def test_a_file_gives_back_what_was_written(tmp_path: Path) -> None:
    write_imu(ImuSamples(STAMPS, GYRO, ACCEL), tmp_path / "imu.csv")
    found = read_imu(tmp_path / "imu.csv")
    assert found.stamps_ns.tolist() == STAMPS.tolist()  # to the nanosecond
    assert found.gyro == pytest.approx(GYRO, abs=1e-12)
    assert found.accel == pytest.approx(ACCEL, abs=1e-10)


@pytest.mark.parametrize(
    ("size", "told"), [(0.7, True), (1.0, True), (4.0, True), (7.0, False), (9.8, False), (40.0, False)]
)
def test_specific_forces_in_g_are_converted_and_that_is_told(
    size: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        found = checked_imu(STAMPS, GYRO, ACCEL / 9.8 * size, "here")
    assert np.median(np.linalg.norm(found.accel, axis=1)) == pytest.approx(size * (9.80665 if told else 1.0), rel=1e-3)
    assert ("in g" in caplog.text) == told


@pytest.mark.parametrize("size", [0.0, 0.5, 5.5, 60.0, 1000.0])
def test_forces_without_gravity_or_in_another_unit_are_refused(size: float) -> None:
    with pytest.raises(UserError, match="gravity in it"):
        checked_imu(STAMPS, GYRO, ACCEL / 9.8 * size, "here")


@pytest.mark.parametrize("step", [0, -1])
def test_stamps_that_do_not_increase_are_refused(step: int) -> None:
    stamps = STAMPS.copy()
    stamps[3] = stamps[2] + step
    with pytest.raises(UserError, match=r"here: the stamp at 1700000000\.133456"):
        checked_imu(stamps, GYRO, ACCEL, "here")
    with pytest.raises(ValueError, match="increase"):
        ImuSamples(stamps, GYRO, ACCEL)


@pytest.mark.parametrize(("fastest", "refused"), [(34.0, False), (36.0, True)])
def test_rates_that_no_chip_measures_are_refused(fastest: float, refused: bool) -> None:
    gyro = GYRO.copy()
    gyro[2, 1] = -fastest
    if refused:
        with pytest.raises(UserError, match="up to 36; give rad/s, not degrees"):
            checked_imu(STAMPS, gyro, ACCEL, "here")
    else:
        assert checked_imu(STAMPS, gyro, ACCEL, "here").gyro[2, 1] == -fastest


def imu_bag(path: Path, kind: str, stamps: list[int], *more: str) -> Path:
    """A bag with a scan and the samples, on `/imu` and on topics of the names in `more`."""
    types = store(kind.startswith("ros1"))
    samples = [(START + k, imu(types, s, GYRO[k], ACCEL[k])) for k, s in enumerate(stamps)]
    scans = [(START, cloud(types, scan_points(0), START))]
    return write_bag(path, kind, {"/points": scans} | dict.fromkeys(("/imu", *more), samples))


@pytest.mark.parametrize(("name", "kind"), [("a.bag", "ros1-lz4"), ("a", "sqlite3"), ("a", "mcap")])
def test_a_bag_gives_the_samples_between_its_scans(name: str, kind: str, tmp_path: Path) -> None:
    found = read_imu(imu_bag(tmp_path / name, kind, STAMPS.tolist()))
    assert found.stamps_ns.tolist() == STAMPS.tolist()
    assert found.gyro.tolist() == GYRO.tolist() and found.accel.tolist() == ACCEL.tolist()


def test_samples_of_a_bag_are_put_in_order_and_repeated_ones_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stamps = [*STAMPS[[0, 2, 1, 3]].tolist(), int(STAMPS[3])]
    with caplog.at_level(logging.INFO):
        found = read_imu(imu_bag(tmp_path / "a.bag", "ros1", stamps))
    assert found.stamps_ns.tolist() == STAMPS[:4].tolist()
    assert found.gyro.tolist() == GYRO[[0, 2, 1, 3]].tolist() and "1 of 5 samples of /imu are left out" in caplog.text


def test_without_a_stamp_the_time_of_recording_counts(tmp_path: Path) -> None:
    found = read_imu(imu_bag(tmp_path / "a", "mcap", [0] * 5))
    assert found.stamps_ns.tolist() == [START + k for k in range(5)]


def test_of_several_imus_one_is_named(tmp_path: Path) -> None:
    bag = imu_bag(tmp_path / "a.bag", "ros1", STAMPS.tolist(), "/camera/imu")
    with pytest.raises(UserError, match=r"several IMUs: /camera/imu \(5\), /imu \(5\); choose one with --imu-topic"):
        read_imu(bag)
    assert len(read_imu(bag, "imu")) == len(read_imu(bag, "/camera/imu")) == 5
    with pytest.raises(UserError, match=r"--imu-topic /imo: no such IMU .* /imu \(5\)"):
        read_imu(bag, "/imo")
    write_imu(read_imu(bag, "imu"), tmp_path / "imu.csv")
    with pytest.raises(UserError, match="is not a bag and has no topics"):
        read_imu(tmp_path / "imu.csv", "imu")


def test_a_bag_without_an_imu_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"contains no IMU samples \(sensor_msgs/Imu\)"):
        read_imu(lidar_bag(tmp_path / "a.bag", "ros1"))
    (tmp_path / "b.bag").write_bytes(b"no bag")
    with pytest.raises(UserError, match=r"contains no IMU samples .*; it does not start"):
        read_imu(tmp_path / "b.bag")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused(bad: float) -> None:
    gyro = GYRO.copy()
    gyro[4, 1] = bad
    with pytest.raises(UserError, match="not finite"):
        checked_imu(STAMPS, gyro, ACCEL, "here")


@pytest.mark.parametrize(
    ("text", "line"),
    [("1,0,0,0,0,0,9.8\n2,0,0,0,0,0\n", 2), ("0.005,0,0,0,0,0,9.8\n", 1), ("# x\n1,0,0,0,0,up,9.8\n", 2)],
)
def test_a_line_of_another_form_is_named(text: str, line: int, tmp_path: Path) -> None:
    (tmp_path / "imu.csv").write_text(text)
    with pytest.raises(UserError, match=f"line {line}: not in the form"):
        read_imu(tmp_path / "imu.csv")


@pytest.mark.parametrize("content", [b"", b"# nothing\n", b"\xff\xfe\x00"])
def test_a_file_without_samples_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "imu.csv").write_bytes(content)
    with pytest.raises(UserError, match=r"imu\.csv: .*; give .*lines of"):
        read_imu(tmp_path / "imu.csv")
