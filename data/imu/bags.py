"""IMU samples in bags: sensor_msgs/Imu."""

import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from data.bags import Bag
from data.bags.messages import BrokenMessageError, decoded, stamp_of
from data.common.errors import UserError
from data.imu.samples import ImuSamples, checked_imu

IMU = "sensor_msgs/msg/Imu"
_log = logging.getLogger(__name__)


def read_imu_bag(path: Path | str, topic: str | None = None) -> ImuSamples:
    """Reads the samples of one topic of a bag, in the order of their headers' stamps; `topic` None takes the only one.

    Samples that cannot be read or whose stamp is there already are left out, and counted in the log. Raises UserError
    where there are none, where several topics could be meant, and as `checked_imu` does.
    """
    bag = Bag(path, (IMU,))
    chosen = _chosen(bag, topic)
    rows = np.array(list(_rows(bag, chosen)), dtype=[("stamp", np.int64), ("values", np.float64, 6)])
    stamps, first = np.unique(rows["stamp"], return_index=True)
    if left_out := bag.counts[chosen] - len(stamps):
        _log.info("%s: %d of %d samples of %s are left out", path, left_out, bag.counts[chosen], chosen)
    if not len(stamps):
        raise UserError(f"{path}: none of the samples of {chosen} can be read")
    values = rows["values"][first]
    return checked_imu(stamps, values[:, :3], values[:, 3:], f"{path}, {chosen}")


def _chosen(bag: Bag, wanted: str | None) -> str:
    if not bag.counts:
        why = "".join(f"; {damage}" for damage in [*bag.damages().values()][:1])
        raise UserError(f"{bag.path}: contains no IMU samples (sensor_msgs/Imu){why}")
    if wanted is not None:
        named = bag.named(wanted)
        if named is None:
            raise UserError(f"--imu-topic {wanted}: no such IMU in {bag.path}; there are: {bag.listed}")
        return named
    if len(bag.counts) > 1:
        raise UserError(f"{bag.path}: several IMUs: {bag.listed}; choose one with --imu-topic NAME")
    return next(iter(bag.counts))


def _rows(bag: Bag, topic: str) -> Iterator[tuple[int, tuple[float, ...]]]:
    """Stamp, gyro and accel of each sample that can be read."""
    for record in bag.messages(topic):
        try:
            message = decoded(record.data, record.msgtype, record.is_cdr)
        except BrokenMessageError:
            continue
        turn, force = message.angular_velocity, message.linear_acceleration
        yield stamp_of(message, record), (turn.x, turn.y, turn.z, force.x, force.y, force.z)
