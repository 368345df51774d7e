"""Tracks all scans of a run in level frames, and begins another one where the sensor was carried elsewhere.

It is a state machine, and knows nothing of the map.
"""

import logging
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.inertial import measured_up
from sgslam.odometry import Odometry
from sgslam.odometry.timed import TimedOdometry
from sgslam.perception import checked_scan
from sgslam.tracking.level_frame import LevelFrame
from sgslam.tracking.other_motion import OtherMotion
from sgslam.types import RawScan, TrackedScan

Floats = NDArray[np.float64]
Mode = Literal["waiting", "tracking", "lost", "unconfirmed"]
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Losses:
    """Stamps: of the newest scan that was not lost; of the first of the newest lost ones, or the last before a pause;
    of the first from where the sensor was found again; and of when that was, for the last time."""

    seen_ns: int | None = None
    lost_ns: int | None = None
    found_ns: int | None = None
    again_ns: int | None = None


@dataclass(frozen=True)
class TrackerNotes:
    """What the result of a run says of its tracking: lines of advice, whether nothing but the usual mount says that the
    sensor does not hang upside down, and whether there is an IMU."""

    advice: tuple[str, ...] = ()
    is_way_up_assumed: bool = False
    has_imu: bool = False


class RunTracker:
    """The tracker of a run: raw scans in, tracked scans for the map out. What it does with a scan depends on its state:

    - `waiting`, in the first seconds: the scan is registered and kept, until it is known where up is and what the
      points' times are. Then all are given out: `tracking`.
    - `tracking`: the scan is registered and given out. If it does not fit the local map: `lost`.
    - `lost`: the scan is kept, and registered with the other lost ones. If it fits the local map: `tracking`, or, after
      a longer loss, `unconfirmed`. If lost scans fit one another for some time, but not the map near the place where
      the sensor was lost, it was carried elsewhere; so it counts where nothing was seen of its way for long, which is
      no different. Then a new frame begins with them: `waiting`.
    - `unconfirmed`: the scan is kept, as the sensor may be in another place that looks alike. After some time without a
      loss all are given out: `tracking`.

    The frame `odom` is level, with the first pose's place and heading. What the graph knows better, by the plan and by
    loops, acts as T_map_odom and never moves `odom`. The map may be in another process: nothing comes back from it.
    `newest_ns` is the stamp of the newest scan, None before the first, and `part` the number of frames before this one.
    """

    def __init__(self, config: Config, odometry: Odometry | None = None) -> None:
        """`odometry` is that of the settings by default."""
        self._config, self.motion = config, OtherMotion(config, odometry)
        self.newest_ns: int | None = None
        self.part, self._advice = 0, list[str]()  # the latter: of the frames before
        self._begin()

    def _begin(self) -> None:
        """Begins a frame: nothing is known of where the sensor is."""
        self._mode: Mode = "waiting"
        self._kept: list[TrackedScan] = []  # that are not given out yet; while waiting, with poses of the odometry
        self._odometry, self._level = self._another_odometry(), LevelFrame(self._config.tracking)
        self._T_level_source = np.eye(4)  # from the frame in which poses come
        self._losses = Losses()
        self._other: TimedOdometry | None = None  # registers lost scans with one another
        self._other_ns = 0  # the first of them
        self._odometry.level(self._level.likely_up)  # as the mount says, until the surfaces do
        self._odometry.hold()

    def _another_odometry(self) -> TimedOdometry:
        """An odometry that knows of no scan yet."""
        return TimedOdometry(self._config.tracking, self.motion.imu, self.motion.measured)

    def track(
        self,
        stamp_ns: int,
        points: NDArray[np.floating[Any]],
        point_times: Floats | None = None,
        T_odom_sensor: Floats | None = None,
        step_covariance: Floats | None = None,
    ) -> list[TrackedScan]:
        """The scans that are given out, in their order; the first one of another frame `begins_elsewhere`.

        The arguments and what is raised are those of `SceneGraphSlam.add_scan`.
        """
        raw = checked_scan(stamp_ns, points, point_times, T_odom_sensor, step_covariance, self.newest_ns)
        given_out = self._taken(self.motion.located(raw))
        self.newest_ns = raw.stamp_ns
        self.motion.imu.forget(self._kept[0].raw.stamp_ns if self._kept else raw.stamp_ns)
        return given_out

    def release(self) -> list[TrackedScan]:
        """All scans that are kept: the run ends."""
        given_out = list[TrackedScan]()
        while self._mode == "waiting" and self._kept:
            given_out += self._settle()
        return [*given_out, *self._give_out()]

    def _taken(self, raw: RawScan) -> list[TrackedScan]:
        """The scans that a scan with all that is known of it makes ready."""
        if raw.T_odom_sensor is None:
            found = self._odometry.register(raw.stamp_ns, raw.points, raw.point_times)
        else:
            found = self.motion.given.newest(raw.point_times)
        if self._mode != "waiting":
            return self._followed([TrackedScan(raw, found, self._T_level_source @ found.T_odom_sensor)])
        self._kept.append(TrackedScan(raw, found, found.T_odom_sensor))
        if raw.T_odom_sensor is None:  # another odometry may be the better one by now
            self._kept = _with_results(self._kept, self._odometry.held)
        self._level.add(self._kept, self._measured_up())
        self._odometry.level(self._level.likely_up)
        lasted = raw.stamp_ns - self._kept[0].raw.stamp_ns
        is_known = self._level.sure and (raw.T_odom_sensor is not None or self._odometry.kind is not None)
        return self._settle() if is_known or lasted >= 1e9 * self._config.tracking.gravity_until else []

    def _measured_up(self) -> Floats | None:
        """(3,) up by the accelerometer in the frame of the first pose, once it shows more than the carrier's steps."""
        T_first_odom = inverse(self._kept[0].T_odom_sensor)
        poses = np.stack([T_first_odom @ scan.T_odom_sensor for scan in self._kept])
        stamps_ns = np.array([scan.raw.stamp_ns for scan in self._kept])
        return measured_up(self.motion.imu, stamps_ns, poses, self._config.tracking.speed)

    def _settle(self) -> list[TrackedScan]:
        """Ends waiting: if up is not known yet, it is where the mount says."""
        self._kept = _with_results(self._kept, self._odometry.release())
        self._level.settle(self._kept)
        self._T_level_source = self._T_level_now()
        self._odometry.level(self._T_level_source[2, :3])
        waited, self._kept = self._kept, []
        waited = [replace(scan, T_odom_sensor=self._T_level_source @ scan.T_odom_sensor) for scan in waited]
        self._mode = "tracking"
        return self._followed([replace(waited[0], begins_elsewhere=self.part > 0), *waited[1:]])

    def _T_level_now(self) -> Floats:  # noqa: N802
        """(4, 4) from the frame in which poses come while scans wait, as far as it is known where up is."""
        return self._level.T_level_first @ inverse(self._kept[0].T_odom_sensor)

    def _followed(self, scans: list[TrackedScan]) -> list[TrackedScan]:
        """The scans that newly registered ones make ready."""
        given_out = list[TrackedScan]()
        for number, scan in enumerate(scans):
            elsewhere_ns = None
            if scan.raw.T_odom_sensor is not None:  # which says where the sensor is
                self._mode = "lost" if scan.health == "lost" else "tracking"
            else:
                elsewhere_ns = self._take_lost(scan) if scan.health == "lost" else self._take_found(scan)
            if elsewhere_ns is not None:
                return [*given_out, *self._begin_elsewhere(elsewhere_ns, scans[number:])]
            self.motion.compare_clock(scan)
            self._kept.append(scan)
            if self._mode == "tracking":
                given_out += self._give_out()
        return given_out

    def _take_lost(self, scan: TrackedScan) -> int | None:
        """Takes a scan that does not fit the map; since when the sensor is elsewhere, None where it is not."""
        raw, known, self._mode = scan.raw, self._losses, "lost"
        if known.lost_ns is None:
            since_ns = known.seen_ns if scan.registration.is_after_pause else None
            known = self._losses = replace(known, lost_ns=raw.stamp_ns if since_ns is None else since_ns)
        if self._other is None:
            self._other, self._other_ns = self._another_odometry(), raw.stamp_ns
        if self._other.register(raw.stamp_ns, raw.points, raw.point_times).health == "lost":
            self._other = None
            return None
        if raw.stamp_ns - self._other_ns < 1e9 * self._config.tracking.kidnapped:
            return None
        found_ns = self._other_ns if known.found_ns is None else known.found_ns
        if self._is_unseen(self._other_ns) or not self._odometry.rejoin(self._other):
            return found_ns
        self._losses, self._other = replace(known, found_ns=found_ns), None
        return None

    def _take_found(self, scan: TrackedScan) -> int | None:
        """Takes a scan that fits the map; since when the sensor is elsewhere, None where it is not."""
        stamp_ns, known, settings = scan.raw.stamp_ns, self._losses, self._config.tracking
        if scan.registration.is_after_pause and known.lost_ns is None:
            known = self._losses = replace(known, lost_ns=known.seen_ns)
        is_unseen, again_ns, found_ns = self._is_unseen(stamp_ns), known.again_ns, known.found_ns
        if known.lost_ns is not None and stamp_ns - known.lost_ns >= 1e9 * settings.kidnapped:
            again_ns, found_ns = stamp_ns, stamp_ns if found_ns is None else found_ns
        elif again_ns is not None and stamp_ns - again_ns > 1e9 * settings.unconfirmed:
            again_ns, found_ns = None, None
        self._other, self._losses = None, Losses(stamp_ns, None, found_ns, again_ns)
        self._mode = "tracking" if again_ns is None else "unconfirmed"
        return (stamp_ns if found_ns is None else found_ns) if is_unseen else None

    def _is_unseen(self, stamp_ns: int) -> bool:
        """Whether the sensor was lost for so long that it may be in another room by now, which looks the same."""
        lost_ns = self._losses.lost_ns
        return lost_ns is not None and stamp_ns - lost_ns >= 1e9 * self._config.tracking.unseen

    def _give_out(self) -> list[TrackedScan]:
        """The scans that were kept, the lost ones at their predicted poses: it is sure by now where the sensor is, or
        the run ends."""
        kept, self._kept = self._kept, []
        lost = [scan.raw.stamp_ns / 1e9 for scan in kept if scan.health == "lost"]
        if lost:
            _log.warning("scans at %.2f to %.2f s are lost: %d poses are predicted", lost[0], lost[-1], len(lost))
        return kept

    def _begin_elsewhere(self, since_ns: int, newest: list[TrackedScan]) -> list[TrackedScan]:
        """Begins another frame with the scans since the sensor was carried elsewhere, and the `newest` ones; those
        before stay with the frame before."""
        again = [scan.raw for scan in (*self._kept, *newest) if scan.raw.stamp_ns >= since_ns]
        self._kept = [scan for scan in self._kept if scan.raw.stamp_ns < since_ns]
        given_out = self._give_out()
        self._advice, self.part = self.advice, self.part + 1
        self.motion.interrupt()
        self._begin()
        for raw in again:
            given_out += self._taken(raw)
        return given_out

    @property
    def waiting(self) -> Floats | None:
        """(4, 4) T_odom_sensor of the newest scan that waits until it is known where up is, as far as known; None if
        none does."""
        is_waiting = self._mode == "waiting" and self._kept
        return self._T_level_now() @ self._kept[-1].T_odom_sensor if is_waiting else None

    @property
    def held(self) -> TrackedScan | None:
        """The newest scan, while it is kept as the sensor is lost, or was so long ago that it may be elsewhere."""
        return self._kept[-1] if self._mode != "waiting" and self._kept else None

    @property
    def advice(self) -> list[str]:
        """Lines where the stated mount, or the clock of what else measures the motion, proves wrong."""
        newest = (self._level.advice, self.motion.advice)
        return [*self._advice, *(line for line in newest if line and line not in self._advice)]

    @property
    def notes(self) -> TrackerNotes:
        """What is known so far."""
        has_imu = self.motion.imu.newest_ns is not None
        return TrackerNotes(tuple(self.advice), self._level.is_way_up_assumed, has_imu)


def _with_results(scans: list[TrackedScan], results: list[Any]) -> list[TrackedScan]:
    """The scans with other registrations, as far as these are known."""
    if len(results) != len(scans):
        return scans
    return [
        replace(scan, registration=found, T_odom_sensor=found.T_odom_sensor)
        for scan, found in zip(scans, results, strict=True)
    ]
