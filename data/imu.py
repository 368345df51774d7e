"""Samples of inertial measurement units, checked where they enter, and their files: bags, and EuRoC's form.

EuRoC: `timestamp [ns], w_x, w_y, w_z [rad/s], a_x, a_y, a_z [m/s2]` a line, as `imu0/data.csv` of the EuRoC MAV dataset
(Burri et al., IJRR 2016).
"""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data.bags import Bag, decoded, is_bag
from data.common.errors import UserError
from data.common.files import parsed_lines, write_atomically
from data.trajectory.stamps import NS, ns_to_seconds

Floats = NDArray[np.float64]
GRAVITY = 9.80665  # m/s2, the standard one, which is also the unit g
_LEAST, _MOST = 0.6, 5.0  # times gravity, the median specific force: a carried sensor's is 1.0, a shaken one's more
_FASTEST = 35.0  # rad/s, 2000 degrees/s: the widest range of the chips that LiDARs carry
_log = logging.getLogger(__name__)
_HEADER = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
_IMU = "sensor_msgs/msg/Imu"
_FORM = "'timestamp [ns], w_x, w_y, w_z, a_x, a_y, a_z'"


@dataclass(frozen=True, eq=False)
class ImuSamples:
    """`stamps_ns` (N,) int64, strictly increasing; `gyro` (N, 3), rad/s, and `accel` (N, 3), m/s2, in the IMU's axes.

    `accel` is the specific force: at rest it points up. Raises ValueError for shapes that do not fit, stamps that do
    not increase, and values that are not finite.
    """

    stamps_ns: NDArray[np.int64]
    gyro: Floats
    accel: Floats

    def __post_init__(self) -> None:
        """Checks shapes, stamps and values."""
        shape = (len(self.stamps_ns), 3)
        if self.stamps_ns.dtype != np.int64 or self.gyro.shape != shape or self.accel.shape != shape:
            raise ValueError(f"IMU: {shape[0]} stamps with gyro {self.gyro.shape} and accel {self.accel.shape}")
        bad = np.flatnonzero(np.diff(self.stamps_ns) <= 0)
        if bad.size:
            at = ns_to_seconds(int(self.stamps_ns[bad[0] + 1]))
            raise ValueError(f"IMU: the stamp at {at} s repeats or goes backwards; sort the samples by time")
        bad = np.flatnonzero(~np.isfinite(np.column_stack([self.gyro, self.accel])).all(axis=1))
        if bad.size:
            at = ns_to_seconds(int(self.stamps_ns[bad[0]]))
            raise ValueError(f"IMU: a value at {at} s is not finite; leave it out")

    def __len__(self) -> int:
        """The number of samples."""
        return len(self.stamps_ns)


def checked_imu(stamps_ns: ArrayLike, gyro: ArrayLike, accel: ArrayLike, where: str) -> ImuSamples:
    """Samples of a user's data: stamps (N,) in ns, gyro (N, 3) in rad/s, accel (N, 3) in m/s2 or in g, N >= 1.

    Specific forces in g are recognised by their median norm and converted. Raises UserError, naming `where` they come
    from, for stamps that do not increase, values that are not finite, rates that no chip measures, and forces that are
    far from gravity.
    """
    stamps, rates = np.asarray(stamps_ns, np.int64), np.asarray(gyro, np.float64)
    try:
        samples = ImuSamples(stamps, rates, np.asarray(accel, np.float64))
    except ValueError as error:
        raise UserError(f"{where}: {str(error).removeprefix('IMU: ')}") from None
    fastest = float(np.abs(rates).max(initial=0.0))
    if fastest > _FASTEST:
        raise UserError(f"{where}: the gyroscope shows up to {fastest:.3g}; give rad/s, not degrees per second")
    unit, usual = unit_of_forces(samples.accel), float(np.median(np.linalg.norm(samples.accel, axis=1)))
    if unit is None:
        raise UserError(
            f"{where}: the accelerometer shows {usual:.3g} in the median, neither 9.8 m/s2 nor 1 g; give the specific "
            "force, with gravity in it"
        )
    if unit != 1.0:
        _log.info("%s: specific forces of %.2f in the median are taken to be in g", where, usual)
    return replace(samples, accel=samples.accel * unit)


def unit_of_forces(forces: Floats) -> float | None:
    """The unit of specific forces (N, 3) by their median norm, in m/s2: 1.0, or that of g; None for neither."""
    usual = float(np.median(np.linalg.norm(forces, axis=1)))
    if _LEAST < usual / GRAVITY < _MOST:
        return 1.0
    return GRAVITY if _LEAST < usual < _MOST else None


def read_imu(path: Path | str, topic: str | None = None) -> ImuSamples:
    """Reads IMU samples from a bag (of several IMUs, the one of `topic`) or from a CSV file in EuRoC's format, in which
    comments (#) and blank lines are skipped.

    Raises UserError, with the line number if there is one, for a file that cannot be read or contains something else,
    for a `topic` of a file that is not a bag, where a bag has no samples or several topics could be meant, and as
    `checked_imu` does.
    """
    if is_bag(Path(path)):
        return _read_bag(path, topic)
    if topic is not None:
        raise UserError(f"--imu-topic {topic}: {path} is not a bag and has no topics")
    rows = parsed_lines(path, f"a bag, or lines of {_FORM}", _row)
    values_of = np.array([values for _, values in rows])
    return checked_imu(np.array([stamp for stamp, _ in rows]), values_of[:, :3], values_of[:, 3:], str(path))


def _row(text: str) -> tuple[np.int64, NDArray[np.float64]]:
    stamp, *values = text.split(",")
    try:
        return np.int64(int(stamp)), np.array(values, np.float64).reshape(6)
    except (ValueError, OverflowError):
        raise ValueError("not in that form, whole nanoseconds first") from None


def _read_bag(path: Path | str, topic: str | None) -> ImuSamples:
    """The samples of one topic, in the order of their headers' stamps; None takes the only one.

    Samples that cannot be read or whose stamp is there already are left out, and counted in the log. Raises UserError
    where there are none, where several topics could be meant, and as `checked_imu` does.
    """
    bag = Bag(path, (_IMU,))
    if not bag.counts:
        raise UserError(f"{path}: contains no IMU samples (sensor_msgs/Imu){bag.damage}")
    chosen = bag.topic(topic, bag.counts, "--imu-topic", "IMU samples")
    rows = np.array(list(_rows(bag, chosen)), dtype=[("stamp", np.int64), ("values", np.float64, 6)])
    stamps, first = np.unique(rows["stamp"], return_index=True)
    if left_out := bag.counts[chosen] - len(stamps):
        _log.info("%s: %d of %d samples of %s are left out", path, left_out, bag.counts[chosen], chosen)
    if not len(stamps):
        raise UserError(f"{path}: none of the samples of {chosen} can be read")
    values = rows["values"][first]
    return checked_imu(stamps, values[:, :3], values[:, 3:], f"{path}, {chosen}")


def _rows(bag: Bag, topic: str) -> Iterator[tuple[int, tuple[float, ...]]]:
    """Stamp, gyro and accel of each sample that can be read; one without a stamp has that of its recording."""
    for record in bag.messages(topic):
        try:
            message = decoded(record.data, record.msgtype, record.is_cdr)
        except Exception:  # rosbags raises many kinds on garbage
            continue
        turn, force, stamp = message.angular_velocity, message.linear_acceleration, message.header.stamp
        stamp_ns = stamp.sec * NS + stamp.nanosec or record.log_ns
        yield stamp_ns, (turn.x, turn.y, turn.z, force.x, force.y, force.z)


def write_imu(samples: ImuSamples, path: Path | str) -> None:
    """Writes the samples in EuRoC's form, atomically."""
    rows = np.column_stack([samples.gyro, samples.accel]).tolist()
    lines = [
        ",".join([str(stamp), *(f"{value:.12g}" for value in row)])
        for stamp, row in zip(samples.stamps_ns.tolist(), rows, strict=True)
    ]
    write_atomically(path, "\n".join([_HEADER, *lines]) + "\n")
