"""Samples of an inertial measurement unit (IMU), checked where they enter."""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data.common.errors import UserError
from data.trajectory.stamps import ns_to_seconds

Floats = NDArray[np.float64]
GRAVITY = 9.80665  # m/s2, the standard one, which is also the unit g
_LEAST, _MOST = 0.6, 5.0  # times gravity, the median specific force: a carried sensor's is 1.0, a shaken one's more
_FASTEST = 35.0  # rad/s, 2000 degrees/s: the widest range of the chips that LiDARs carry
_log = logging.getLogger(__name__)


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
        if np.any(np.diff(self.stamps_ns) <= 0):
            raise ValueError("IMU: the stamps do not increase strictly")
        if not (np.isfinite(self.gyro).all() and np.isfinite(self.accel).all()):
            raise ValueError("IMU: a value is not finite")

    def __len__(self) -> int:
        """The number of samples."""
        return len(self.stamps_ns)


def checked_imu(stamps_ns: ArrayLike, gyro: ArrayLike, accel: ArrayLike, where: str) -> ImuSamples:
    """Samples of a user's data: stamps (N,) in ns, gyro (N, 3) in rad/s, accel (N, 3) in m/s2 or in g, N >= 1.

    Specific forces in g are recognised by their median norm and converted. Raises UserError, naming `where` they come
    from, for stamps that do not increase, values that are not finite, rates that no chip measures, and forces that are
    far from gravity.
    """
    stamps, forces = np.asarray(stamps_ns, np.int64), np.asarray(accel, np.float64)
    bad = np.flatnonzero(np.diff(stamps) <= 0)
    if bad.size:
        at = ns_to_seconds(int(stamps[bad[0] + 1]))
        raise UserError(f"{where}: the stamp at {at} s repeats or goes backwards; sort the samples by time")
    rates = np.asarray(gyro, np.float64)
    bad = np.flatnonzero(~(np.isfinite(rates).all(axis=1) & np.isfinite(forces).all(axis=1)))
    if bad.size:
        raise UserError(f"{where}: a value at {ns_to_seconds(int(stamps[bad[0]]))} s is not finite; leave it out")
    fastest = float(np.abs(rates).max(initial=0.0))
    if fastest > _FASTEST:
        raise UserError(f"{where}: the gyroscope shows up to {fastest:.3g}; give rad/s, not degrees per second")
    unit, usual = unit_of_forces(forces), float(np.median(np.linalg.norm(forces, axis=1)))
    if unit is None:
        raise UserError(
            f"{where}: the accelerometer shows {usual:.3g} in the median, neither 9.8 m/s2 nor 1 g; give the specific "
            "force, with gravity in it"
        )
    if unit != 1.0:
        _log.info("%s: specific forces of %.2f in the median are taken to be in g", where, usual)
    return ImuSamples(stamps, rates, forces * unit)


def unit_of_forces(forces: Floats) -> float | None:
    """The unit of specific forces (N, 3) by their median norm, in m/s2: 1.0, or that of g; None for neither."""
    usual = float(np.median(np.linalg.norm(forces, axis=1)))
    if _LEAST < usual / GRAVITY < _MOST:
        return 1.0
    return GRAVITY if _LEAST < usual < _MOST else None
