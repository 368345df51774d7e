"""The newest samples of an IMU, in the LiDAR's axes."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.imu import ImuSamples, unit_of_forces
from sgslam.config import ImuSettings

Floats = NDArray[np.float64]
_BEFORE_NS = 10_000_000_000  # before a scan: the one before, and the last measurement of the biases, are later
_GAP_NS = 50_000_000  # longest time between samples, or beyond them, over which the rate of turn is interpolated


class ImuBuffer:
    """Samples are added in the order of their stamps, and kept until `forget`."""

    def __init__(self, settings: ImuSettings) -> None:
        self.settings = settings
        roll, pitch, yaw = settings.rotation
        self._R_sensor_imu: Floats = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_matrix()
        self._stamps, self._values = np.empty(0, np.int64), np.empty((0, 6))  # gyro and accel
        self._newer: list[ImuSamples] = []
        self.unit: float | None = None  # m/s2, of the specific forces; None before the first, and far from gravity

    def add(self, samples: ImuSamples) -> None:
        """Adds samples later than all before, in the IMU's axes."""
        self._newer.append(samples)

    def forget(self, stamp_ns: int) -> None:
        """Forgets the samples that no scan from a stamp on needs, but never the newest one."""
        first = int(np.searchsorted(self._stamps[:-1], stamp_ns - _BEFORE_NS))
        self._stamps, self._values = self._stamps[first:], self._values[first:]

    @property
    def newest_ns(self) -> int | None:
        """The stamp of the newest sample; None before the first."""
        if self._newer:
            return int(self._newer[-1].stamps_ns[-1])
        return int(self._stamps[-1]) if len(self._stamps) else None

    def around(self, begin_ns: int, end_ns: int) -> ImuSamples | None:
        """The samples from the last one before a time to the first one after another; None where there is a gap."""
        self._take_newer()
        first = max(int(self._stamps.searchsorted(begin_ns, side="right")) - 1, 0)
        last = int(self._stamps.searchsorted(end_ns)) + 1
        stamps, values = self._stamps[first:last], self._values[first:last]
        if not len(stamps) or stamps[0] - begin_ns > _GAP_NS or end_ns - stamps[-1] > _GAP_NS:
            return None
        if (stamps[1:] - stamps[:-1] > _GAP_NS).any():
            return None
        return ImuSamples(stamps, values[:, :3], values[:, 3:])

    def turned(self, begin_ns: int, end_ns: int) -> tuple[NDArray[np.int64], Floats] | None:
        """The stamps (N,) of `around`, and the sum (N, 3) of all small turns until each, rad; None where there is a
        gap."""
        found = self.around(begin_ns, end_ns)
        if found is None:
            return None
        steps = (found.gyro[1:] + found.gyro[:-1]) / 2 * np.diff(found.stamps_ns)[:, None] / 1e9
        return found.stamps_ns, np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])

    def _take_newer(self) -> None:
        if not self._newer:
            return
        gyro, accel = (
            np.concatenate([getattr(own, name) for own in self._newer]) @ self._R_sensor_imu.T
            for name in ("gyro", "accel")
        )
        newer = np.concatenate([own.stamps_ns for own in self._newer])
        accel = accel - self._beside(newer, gyro)
        self._stamps = np.concatenate([self._stamps, newer])
        self._values = np.concatenate([self._values, np.hstack([gyro, accel])])
        self.unit = unit_of_forces(self._values[:, 3:])
        self._newer = []

    def _beside(self, stamps_ns: NDArray[np.int64], gyro: Floats) -> Floats:
        """(N, 3) how much more acceleration the IMU feels than the sensor, as it turns about it."""
        place = np.array(self.settings.translation)
        seconds = np.concatenate([self._stamps[-1:], stamps_ns]) / 1e9
        if not place.any() or len(seconds) < 2:
            return np.zeros_like(gyro)
        rates = np.concatenate([self._values[-1:, :3], gyro])
        changed = np.gradient(rates, seconds, axis=0)
        both = np.cross(changed, place) + np.cross(rates, np.cross(rates, place))
        return np.asarray(both[len(both) - len(gyro) :])
