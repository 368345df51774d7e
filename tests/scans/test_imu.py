"""Samples of an IMU: what is refused, which unit they are in, and the files that hold them."""

import logging
from pathlib import Path

import numpy as np
import pytest

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
    with pytest.raises(UserError, match=r"imu\.csv: .*; give lines of"):
        read_imu(tmp_path / "imu.csv")
