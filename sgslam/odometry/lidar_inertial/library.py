"""What a LiDAR-inertial library gets and gives."""

import importlib
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.imu import ImuSamples

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InertialScan:
    """Points (N, 3) in the sensor frame, N >= 0, measured `seconds` (N,) after `stamp_ns`; it ends at `end_ns`."""

    stamp_ns: int
    end_ns: int
    points: NDArray[np.float32]
    seconds: Floats


@dataclass(frozen=True, eq=False)
class Registered:
    """`T_library_sensor` (4, 4) at a scan's end, and its points (N, 3) in the sensor frame as at that instant."""

    T_library_sensor: Floats
    points: Floats


class InertialLibrary(Protocol):
    """A library's odometry, from its first scan on. The IMU's samples are in the sensor's axes."""

    def register(self, scan: InertialScan, samples: ImuSamples) -> Registered | None:
        """Registers a scan, with the samples since the last one's end until its own; None where it does not fit. A scan
        without points only lets time pass."""
        ...


def imported(name: str) -> Any:
    """The module of a library, which is an extra of the same name. Raises UserError if it is missing."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise UserError(f"odometry {name}: the library is not installed; pip install 'sgslam[{name}]'") from None
