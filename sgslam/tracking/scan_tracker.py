"""Tracks scan after scan: each is registered by the odometry, in a frame that is level and never jumps."""

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.inertial import ImuBuffer, measured_up
from sgslam.odometry import Odometry, make_odometry
from sgslam.odometry.given import GivenPoses
from sgslam.odometry.given_motion import GivenMotion
from sgslam.odometry.timed import TimedOdometry
from sgslam.perception import RawScan
from sgslam.registration import Health, Registration
from sgslam.serialization import Stateful
from sgslam.tracking.level_frame import LevelFrame

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class TrackedScan:
    """A scan with its pose `T_odom_sensor` (4, 4) at its stamp, in a level frame.

    `registration` is in the odometry's frame; its covariance is that of the pose against the odometry's map. The scan
    is `unconfirmed` in the first seconds after the sensor was lost for longer: it may be in a place that looks alike.
    After a pause in the scans the sensor counts as lost for as long.
    """

    raw: RawScan
    registration: Registration
    T_odom_sensor: Floats
    unconfirmed: bool = False

    @property
    def health(self) -> Health:
        """How the scan fits the odometry's map."""
        return self.registration.health

    @property
    def covariance(self) -> Floats:
        """(6, 6), rotation first, in the sensor's axes."""
        return self.registration.covariance

    @property
    def points(self) -> Floats:
        """(N, 3) all points, as at the stamp."""
        return self.registration.undistorted(self.raw.points)

    @property
    def T_begin_sensor(self) -> Floats | None:  # noqa: N802
        """(4, 4) the motion since the first point, where that is before the stamp."""
        motion = self.registration.motion
        if motion.seconds[0] >= 0:
            return None
        return inverse(motion.at(motion.seconds[0])) @ self.registration.T_odom_sensor

    @property
    def waits(self) -> bool:
        """Whether the scan is not to join the map yet."""
        return self.unconfirmed or self.health == "lost"


class ScanTracker(Stateful):
    """Tracks the pose of each scan. The frame `odom` is level, with the first pose's place and heading.

    What the graph knows better, by the plan and by loops, acts as T_map_odom and never moves `odom`.
    """

    _STATE = (
        "waiting", "_found", "_lost_since_ns", "_T_level_source", "_lost_from_ns", "_found_ns", "_again_ns",
        "_seen_ns",
    )  # fmt: skip

    def __init__(
        self, config: Config, odometry: Odometry, imu: ImuBuffer | None = None, motion: GivenMotion | None = None
    ) -> None:
        """`motion` is that of another system, which is measured."""
        self._config, self._odometry, self._imu, self._motion = config, odometry, imu, motion
        self._given = GivenPoses(config.odometry)
        self._level = LevelFrame(config.tracking)
        # until it is known where up is, and what the points' times are: scans, and their poses as of now
        self.waiting: list[RawScan] = []
        self._found: list[Registration] = []
        self._other: Odometry | None = None  # registers lost scans with one another
        self._lost_since_ns: int | None = None  # the first of those that fit one another
        self._seen_ns: int | None = None  # the newest scan that was not lost
        self._lost_from_ns: int | None = None  # the first of the newest lost scans, or the last one before a pause
        self._found_ns: int | None = None  # the first scan from where the sensor was found again
        self._again_ns: int | None = None  # when it was found, for the last time
        self._T_level_source = np.eye(4)  # from the frame in which poses come
        odometry.level(self._level.likely_up)  # as the mount says, until the surfaces do
        if isinstance(odometry, TimedOdometry):
            odometry.hold()

    def track(self, raw: RawScan) -> list[TrackedScan]:
        """The newest scans whose poses are known: none in the first seconds, until up is known, then all."""
        if raw.T_odom_sensor is None:
            found = self._odometry.register(raw.stamp_ns, raw.points, raw.point_times)
        else:
            found = self._given.register(raw.stamp_ns, raw.T_odom_sensor, raw.point_times)
        if self._level.known:
            return [self._tracked(raw, found)]
        self.waiting.append(raw)
        if isinstance(self._odometry, TimedOdometry) and raw.T_odom_sensor is None:
            self._found = self._odometry.held
        else:
            self._found.append(found)
        self._level.add(self.waiting, self._found, self._measured_up())
        self._odometry.level(self._level.likely_up)
        return self.release() if self._is_settled(raw) else []

    @property
    def follows_given(self) -> bool:
        """Whether the scans so far came with poses."""
        return self._given.has_begun

    def _measured_up(self) -> Floats | None:
        """(3,) up by the accelerometer in the frame of the first pose, once it shows more than the carrier's steps."""
        if self._imu is None:
            return None
        T_first_odom = inverse(self._found[0].T_odom_sensor)
        poses = np.stack([T_first_odom @ result.T_odom_sensor for result in self._found])
        return measured_up(self._imu, np.array([raw.stamp_ns for raw in self.waiting]), poses)

    def _is_settled(self, raw: RawScan) -> bool:
        """Whether it is known where up is and what the points' times are, or it has been too long."""
        if raw.stamp_ns - self.waiting[0].stamp_ns >= 1e9 * self._config.tracking.gravity_until:
            return True
        if isinstance(self._odometry, TimedOdometry) and raw.T_odom_sensor is None and self._odometry.kind is None:
            return False
        return self._level.sure

    def release(self) -> list[TrackedScan]:
        """The scans that wait; if up is not known yet, it is where the mount says."""
        if not self._level.known:
            if isinstance(self._odometry, TimedOdometry):
                released = self._odometry.release()
                self._found = self._found if self.follows_given else released
            self._level.settle(self.waiting, self._found)
            self._T_level_source = self._T_level_now()
            self._odometry.level(self._T_level_source[2, :3])
        waiting, found = self.waiting, self._found
        self.waiting, self._found = [], []
        return [self._tracked(*scan) for scan in zip(waiting, found, strict=True)]

    @property
    def advice(self) -> str | None:
        """A line where the stated mount proves wrong, else None."""
        return self._level.advice

    @property
    def is_way_up_assumed(self) -> bool:
        """Whether nothing but the usual mount says that the sensor does not hang upside down."""
        return self._level.is_way_up_assumed

    @property
    def newest(self) -> Floats | None:
        """(4, 4) T_odom_sensor of the newest scan that waits, as far as known; None if none does."""
        return self._T_level_now() @ self._found[-1].T_odom_sensor if self.waiting else None

    def times_of(self, points: Floats, point_times: Floats | None) -> Floats | None:
        """(N,) the times of a scan's points (N, 3), told or not, by what is known now; None for a snapshot."""
        if not isinstance(self._odometry, TimedOdometry):
            return point_times
        return self._odometry.times_of(points, point_times)

    def _T_level_now(self) -> Floats:  # noqa: N802
        """(4, 4) from the frame in which poses come, as far as it is known where up is."""
        if not self._found:
            return np.eye(4)
        return self._level.T_level_first @ inverse(self._found[0].T_odom_sensor)

    def _tracked(self, raw: RawScan, found: Registration) -> TrackedScan:
        return TrackedScan(raw, found, self._T_level_source @ found.T_odom_sensor)

    @property
    def carried_since_ns(self) -> int:
        """The stamp of the first of the lost scans that fit one another, or of the first unconfirmed scan before them;
        to be asked where the sensor was carried elsewhere."""
        assert self._lost_since_ns is not None
        return self._lost_since_ns if self._found_ns is None else self._found_ns

    def confirmed(self, scan: TrackedScan) -> TrackedScan:
        """The scan, marked as unconfirmed where the sensor was lost for longer and found again not long ago.

        To be asked for each scan, before `was_carried_elsewhere`.
        """
        settings, stamp = self._config.tracking, scan.raw.stamp_ns
        if scan.registration.is_after_pause and self._lost_from_ns is None:
            self._lost_from_ns = self._seen_ns
        if scan.health == "lost":
            self._lost_from_ns = stamp if self._lost_from_ns is None else self._lost_from_ns
            return scan
        self._seen_ns = stamp
        self._lost_since_ns = stamp if self._was_unseen(stamp) else None
        if self._lost_from_ns is not None and stamp - self._lost_from_ns >= 1e9 * settings.kidnapped:
            self._again_ns, self._found_ns = stamp, stamp if self._found_ns is None else self._found_ns
        elif self._again_ns is not None and stamp - self._again_ns > 1e9 * settings.unconfirmed:
            self._again_ns, self._found_ns = None, None
        self._lost_from_ns = None
        return replace(scan, unconfirmed=self._again_ns is not None)

    def _was_unseen(self, stamp_ns: int) -> bool:
        """Whether the sensor was lost for so long that it may be in another room by now, which looks the same."""
        since = self._lost_from_ns
        return since is not None and stamp_ns - since >= 1e9 * self._config.tracking.unseen

    def was_carried_elsewhere(self, scan: TrackedScan) -> bool:
        """Whether the sensor was carried elsewhere: lost scans fit one another, for some time, and not the map near
        the place where it was lost. Or nothing was seen of its way for long, which is no different.

        To be asked for each scan.
        """
        if scan.health != "lost":
            self._other = None
            return self._lost_since_ns is not None
        if self._other is None or self._lost_since_ns is None:
            self._other = self._another()
            self._lost_since_ns = scan.raw.stamp_ns
        found = self._other.register(scan.raw.stamp_ns, scan.raw.points, scan.raw.point_times)
        if found.health == "lost":
            self._other, self._lost_since_ns = None, None
            return False
        if scan.raw.stamp_ns - self._lost_since_ns < 1e9 * self._config.tracking.kidnapped:
            return False
        is_here = not self._was_unseen(self._lost_since_ns) and self._odometry.rejoin(self._other)
        if is_here:
            self._found_ns = self._lost_since_ns if self._found_ns is None else self._found_ns
            self._other, self._lost_since_ns = None, None
        return not is_here

    def _another(self) -> Odometry:
        """An odometry that knows of no scan yet."""
        return make_odometry(self._config.odometry, self._config.tracking, self._imu, self._motion)

    def state(self) -> dict[str, Any]:
        """See `Stateful`; with the state of its parts."""
        other = None if self._other is None else self._other.state()
        return {
            **super().state(), "odometry": self._odometry.state(), "given": self._given.state(),
            "level": self._level.state(), "other": other,
        }  # fmt: skip

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self._odometry.restore(state["odometry"])
        self._given.restore(state["given"])
        self._level.restore(state["level"])
        if state["other"] is not None:
            self._other = self._another()
            self._other.restore(state["other"])
