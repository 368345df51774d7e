"""LiDAR-inertial odometries of others alone: RKO-LIO and GenZ-LIO, on one thread each.

Both take the turn and the specific force of the beginning for the gyroscope's bias and for gravity. A hand is never at
rest, so they get a rest before the first scan instead.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.imu import GRAVITY, ImuSamples
from data.scans import Scan
from data.trajectory import Trajectory

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]
Library = Callable[[Scan, int, ImuSamples], Array | None]  # a scan, its end (ns), the samples until then: the pose

MIN_RANGE_M, MAX_RANGE_M = 0.3, 60.0
# of RKO-LIO; with the least error in four drives on a hand, of other seeds than the reported ones
VOXEL_M, REACH_M, ITERATIONS = 0.7, 0.3, 100
GENZ_CONFIG = "configs/default/mid360.yaml"  # of any sensor with point times: they are not checked as a Velodyne's
ORIGIN_NS = 1_000_000_000_000  # of the times that they get: RKO-LIO takes 0 for unknown
REST_NS, REST_SAMPLES = 100_000_000, 20
LARGEST_BIAS = 0.03  # rad/s, more than data sheets say; a faster turn is the carrier's


def rko_lio_alone(scans: Iterable[Scan], samples: ImuSamples) -> Trajectory:
    """T_odom_sensor of RKO-LIO (Malladi et al., RA-L 2026) at the ends of the scans, which have points' times; samples
    of an IMU in the sensor's axes. Raises UserError if the samples begin after the scans."""
    return _tracked(scans, samples, _rko_lio)


def genz_lio_alone(scans: Iterable[Scan], samples: ImuSamples) -> Trajectory:
    """As `rko_lio_alone`, of GenZ-LIO (2026)."""
    return _tracked(scans, samples, _genz_lio)


def _tracked(scans: Iterable[Scan], samples: ImuSamples, begin: Callable[[Scan, ImuSamples], Library]) -> Trajectory:
    """The poses of a library that begins at the first scan, after a rest. A scan that it does not register keeps the
    pose before."""
    register: Library | None = None
    T, fed_ns, poses = np.eye(4), -1, dict[int, Array]()
    for scan in scans:
        end_ns = scan.stamp_ns + round(float(_times(scan).max()) * 1e9)
        if register is None:
            register, fed_ns = begin(scan, _at_rest(samples, scan.stamp_ns, end_ns)), scan.stamp_ns - 1
        found = register(scan, end_ns, _between(samples, fed_ns, end_ns))
        fed_ns, T = end_ns, T if found is None else found
        poses[scan.stamp_ns] = T.copy()
    return Trajectory(np.array([*poses], dtype=np.int64), np.stack([*poses.values()]))


def _rko_lio(first: Scan, rest: ImuSamples) -> Library:
    """Point-to-point ICP that begins where the IMU predicts the sensor. It begins at its second scan: the one given
    here only sets the time at which the rest begins."""
    import rko_lio
    from rko_lio.config import LIOConfig
    from rko_lio.rko_lio_pybind import InputError, RegistrationError

    config = LIOConfig(
        voxel_size=VOXEL_M,
        max_range=MAX_RANGE_M,
        min_range=MIN_RANGE_M,
        max_iterations=ITERATIONS,
        max_correspondence_distance=REACH_M,
        initialization_phase=True,
        max_num_threads=1,
    )
    lio: Any = rko_lio.LIO(config)
    began_ns = ORIGIN_NS - int(rest.stamps_ns[0])

    def add(samples: ImuSamples) -> None:
        for stamp_ns, gyro, accel in zip(samples.stamps_ns.tolist(), samples.gyro, samples.accel, strict=True):
            lio.add_imu_measurement(accel, gyro, stamp_ns + began_ns)

    def register(scan: Scan, end_ns: int, samples: ImuSamples) -> Array | None:
        if scan is not first:
            add(samples)
        times = scan.stamp_ns + began_ns + np.rint(_times(scan) * 1e9).astype(np.int64)
        try:
            points = lio.register_scan(scan.points.astype(np.float32), times, end_time_ns=end_ns + began_ns)
        except (InputError, RegistrationError):
            return None
        return np.asarray(lio.pose()) if len(points) else None

    lio.register_scan(first.points.astype(np.float32), np.full(len(first.points), ORIGIN_NS - 1))
    add(rest)
    return register


def _genz_lio(_first: Scan, rest: ImuSamples) -> Library:
    """An error-state Kalman filter on planes of a voxel map, and on points where there are none."""
    try:
        import genz_lio
    except ModuleNotFoundError:
        raise UserError("GenZ-LIO is not installed; pip install genz_lio (GPL-2.0), or leave it out") from None

    config = genz_lio.load_config(Path(genz_lio.__file__).parent / GENZ_CONFIG)
    config.max_threads = 1
    config.preprocess.blind_min, config.preprocess.blind_max = MIN_RANGE_M, MAX_RANGE_M
    lio: Any = genz_lio.GenZLIO(config)
    began_ns = int(rest.stamps_ns[0])

    def seconds(stamps_ns: Stamps | int) -> Any:
        """Since a second before the first sample, small enough for a microsecond to count."""
        return (stamps_ns - began_ns) / 1e9 + 1.0

    def add(points: NDArray[np.float32], times: Array, begin_ns: int, end_ns: int, samples: ImuSamples) -> Any:
        rows = np.column_stack([seconds(samples.stamps_ns), samples.accel, samples.gyro])
        return lio.register_scan(points, seconds(begin_ns), seconds(end_ns), rows, timestamps=times)

    def register(scan: Scan, end_ns: int, samples: ImuSamples) -> Array | None:
        if not len(samples):
            return None
        found = add(scan.points.astype(np.float32), _times(scan), scan.stamp_ns, end_ns, samples)
        return np.asarray(lio.lidar_pose) if found.valid and not found.update_rejected else None

    add(np.empty((0, 3), np.float32), np.empty(0), began_ns, int(rest.stamps_ns[-1]), rest)
    return register


def _times(scan: Scan) -> Array:
    return np.zeros(len(scan.points)) if scan.point_times is None else scan.point_times


def _between(samples: ImuSamples, begin_ns: int, end_ns: int) -> ImuSamples:
    """The samples after a time, until another."""
    inside = (samples.stamps_ns > begin_ns) & (samples.stamps_ns <= end_ns)
    return ImuSamples(samples.stamps_ns[inside], samples.gyro[inside], samples.accel[inside])


def _at_rest(samples: ImuSamples, begin_ns: int, end_ns: int) -> ImuSamples:
    """The sensor at rest, as in the time of the first scan but for the carrier's turn, until just before that."""
    last = int(np.searchsorted(samples.stamps_ns, end_ns, side="right"))
    first = max(int(np.searchsorted(samples.stamps_ns, begin_ns, side="right")) - 1, 0)
    if first >= last:
        raise UserError("the samples of the IMU begin after the scans")
    turn, force = samples.gyro[first:last].mean(axis=0), samples.accel[first:last].mean(axis=0)
    if not np.linalg.norm(turn) < LARGEST_BIAS:
        turn = np.zeros(3)
    gravity = GRAVITY * force / max(float(np.linalg.norm(force)), 1e-9)
    stamps_ns = begin_ns - REST_NS // REST_SAMPLES * np.arange(REST_SAMPLES, 0, -1)
    rest = (np.tile(row, (REST_SAMPLES, 1)) for row in (turn, gravity))
    return ImuSamples(stamps_ns.astype(np.int64), *rest)
