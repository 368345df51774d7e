"""Simulated drives as a data set of evalio's: `evalio -M evalio_drive`. Needs evalio."""

from collections.abc import Iterator, Sequence
from enum import auto
from pathlib import Path

import numpy as np
from evalio.datasets import Dataset, DatasetIterator
from evalio.datasets.loaders import RawDataIter
from evalio.types import (
    SE3,
    SO3,
    Duration,
    ImuMeasurement,
    ImuParams,
    LidarMeasurement,
    LidarParams,
    Point,
    Stamp,
    Trajectory,
)

from data.imu import read_imu
from data.scans import Scan, ScanFolder


class SimulatedDrive(Dataset):
    """What `data.simulate --imu` writes, in EVALIO_DATA/simulated_drive/SEQUENCE. The IMU is said to be turned and
    moved against the LiDAR, and its samples are turned likewise."""

    small = auto()
    long = auto()

    def data_iter(self) -> DatasetIterator:
        scans = ScanFolder(self.folder / "scans")
        return RawDataIter(map(_measurement, scans), self._samples(), len(scans))

    def _samples(self) -> Iterator[ImuMeasurement]:
        samples, R_imu_lidar = read_imu(self.folder / "scans/imu.csv"), self.imu_T_lidar().rot.to_mat()
        for stamp, gyro, accel in zip(samples.stamps_ns.tolist(), samples.gyro, samples.accel, strict=True):
            yield ImuMeasurement(Stamp.from_nsec(stamp), R_imu_lidar @ gyro, R_imu_lidar @ accel)

    def ground_truth_raw(self) -> Trajectory:
        return Trajectory.from_csv(
            self.folder / "truth.tum", ["sec", "x", "y", "z", "qx", "qy", "qz", "qw"], delimiter=" "
        )

    def imu_T_lidar(self) -> SE3:  # noqa: N802
        return SE3(SO3.from_rpy(0.1, -0.2, 1.0), np.array([0.03, -0.02, 0.05]))

    def imu_T_gt(self) -> SE3:  # noqa: N802
        return self.imu_T_lidar()

    def imu_params(self) -> ImuParams:
        return ImuParams(gravity=np.array([0.0, 0.0, -9.80665]))

    def lidar_params(self) -> LidarParams:
        rate = 5.0 if self == SimulatedDrive.small else 10.0
        return LidarParams(num_rows=16, num_columns=450, min_range=0.3, max_range=60.0, rate=rate)

    def files(self) -> Sequence[str | Path]:
        return ["scans", "scans/imu.csv", "truth.tum"]


def _measurement(scan: Scan) -> LidarMeasurement:
    after = np.zeros(len(scan.points)) if scan.point_times is None else scan.point_times
    points = [
        Point(x=x, y=y, z=z, t=Duration.from_sec(t))
        for (x, y, z), t in zip(scan.points.tolist(), after.tolist(), strict=True)
    ]
    return LidarMeasurement(Stamp.from_nsec(scan.stamp_ns), points)
