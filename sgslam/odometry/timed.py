"""Finds out by registration whether scans without point times are snapshots or rolling, one point after another."""

import logging
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from data.scans.point_times import BEFORE_STAMP
from sgslam.config import TrackingSettings
from sgslam.config.sensor import CARRIER, SENSOR
from sgslam.geometry.frames import inverse, squared_up
from sgslam.inertial import ImuBuffer, MeasuredMotion
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.perception.point_times import Rule, even_times, guessed_times
from sgslam.registration.motion_prior import velocity_between
from sgslam.types import Motion, Registration

Floats = NDArray[np.float64]
Kind = Literal["snapshot", "order"]
_log = logging.getLogger(__name__)
_MOST = 0.3  # evidence of one scan: the scans after it are not independent
# Sum of the evidence, natural logarithm, that decides. In 24 drives of rolling scans it was at least -2.0,
# in 24 of snapshots at most 3.2, on the way to the right end.
_LIMIT = 8.0
_WITHOUT_ORDER = 20  # so many more scans whose points' order says nothing than others count as snapshots


class TimedOdometry:
    """Our own odometry for scans with point times, given or not.

    Where they are not given, two odometries run side by side until the motion decides: one takes scans as snapshots,
    one with times guessed from the order of their points. The right one finds more points, nearer to its surfaces.
    Poses are those of the better one so far, and do not jump when that changes; but while results are held back, they
    are all replaced by those of the other one. All points of a snapshot are of the instant that its stamp names.
    """

    def __init__(
        self, settings: TrackingSettings, imu: ImuBuffer | None = None, given: GivenMotion | None = None
    ) -> None:
        self._before_stamp, times = BEFORE_STAMP[settings.stamp], settings.point_times
        kinds: tuple[Kind, ...] = ("snapshot", "order") if times == "auto" else (times,)
        motions = {kind: None if imu is None else MeasuredMotion(imu) for kind in kinds}
        self._odometries = {kind: ContinuousTimeOdometry(settings, motions[kind], given) for kind in kinds}
        self._best: Kind = kinds[0]
        self._evidence = 0.0  # for guessed times; natural logarithm
        self._without_order = 0  # scans, less those whose points' order tells their times
        self._last: dict[Kind, Floats] = {}  # T_odom_sensor of the newest scan, each in its own frame
        self._last_ns: int | None = None
        self._duration_s = np.inf
        self._rule: Rule | None = None  # which the points' order has followed so far
        self._shift = np.eye(4)  # from the frame of the best odometry to that of the results
        self._held: dict[Kind, list[Registration]] | None = None  # the results of all scans so far, held back

    @property
    def kind(self) -> Kind | None:
        """What scans without times are; None while that is not known."""
        return self._best if len(self._odometries) == 1 else None

    def hold(self) -> None:
        """Begins to hold results back; to be called before the first scan."""
        self._held = {kind: [] for kind in self._odometries}

    @property
    def held(self) -> list[Registration]:
        """The results held back, one a scan, by the odometry that is better so far."""
        return [] if self._held is None else self._held[self._best]

    def release(self) -> list[Registration]:
        """Ends holding back; returns what was `held`."""
        held, self._held = self.held, None
        return held

    def register(self, stamp_ns: int, points: Floats, point_times: Floats | None = None) -> Registration:
        """See `ContinuousTimeOdometry.register`."""
        interval_s = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) / 1e9
        self._last_ns = stamp_ns
        if interval_s > 0:
            self._duration_s = min(self._duration_s, interval_s)
        guessed, is_ordered = point_times, False
        if not len(points):
            point_times = guessed = None
        elif point_times is None and "order" in self._odometries:
            guessed, is_ordered = self._guessed(points)
        elif point_times is not None and self.kind is None:
            self._odometries = {self._best: self._odometries[self._best]}
        times: dict[Kind, Floats | None] = {"snapshot": point_times, "order": guessed}
        results = {
            kind: odometry.register(stamp_ns, points, times[kind]) for kind, odometry in self._odometries.items()
        }
        if self._held is not None:
            for kind, result in results.items():
                self._held[kind].append(result)
        if self.kind is None:
            self._compare(results, is_ordered, interval_s)
        self._last = {kind: results[kind].T_odom_sensor for kind in self._odometries}
        return _moved(self._shift, results[self._best])

    def level(self, up_in_odom: Floats) -> None:
        """See `ContinuousTimeOdometry.level`."""
        for kind, odometry in self._odometries.items():
            R_own_odom = self._shift[:3, :3].T if kind == self._best else np.eye(3)
            odometry.level(R_own_odom @ up_in_odom)

    def rejoin(self, other: "TimedOdometry") -> bool:
        """See `ContinuousTimeOdometry.rejoin`."""
        return self._odometries[self._best].rejoin(other._odometries[other._best])

    def _compare(self, results: dict[Kind, Registration], is_ordered: bool, interval_s: float) -> None:
        """Adds the evidence of a scan, changes to the better odometry, and drops the other one where it is clear."""
        self._without_order = max(self._without_order + (-1 if is_ordered else 1), 0)
        if self._without_order >= _WITHOUT_ORDER:
            self._prefer("snapshot")
            self._decide("snapshot")
            return
        if is_ordered and interval_s > 0 and self._moves(results, interval_s):
            snapshot, order = (self._misfit(kind, results[kind]) for kind in ("snapshot", "order"))
            if 0 < snapshot < np.inf and 0 < order < np.inf:
                self._evidence += float(np.clip(np.log(snapshot / order), -_MOST, _MOST))
        if abs(self._evidence) > _LIMIT / 2:
            self._prefer("order" if self._evidence > 0 else "snapshot")
        if abs(self._evidence) > _LIMIT:
            self._decide(self._best)

    def _guessed(self, points: Floats) -> tuple[Floats, bool]:
        """The times of points (N, 3), and whether their order gives them; where not, they are those of a sensor that
        does not turn once around, if it is one, or all are the scan's middle."""
        duration_s = self._duration_s if np.isfinite(self._duration_s) else SENSOR.scan_seconds  # of the first scan
        began = -self._before_stamp * duration_s
        found = guessed_times(points, duration_s)
        if found is not None:
            self._rule = found.rule
            return began + found.seconds, True
        if self._rule == "index":  # a close wall hides that it soon covers the whole field of view
            return began + even_times(len(points), duration_s), False
        return np.full(len(points), began + duration_s / 2), False

    def _moves(self, results: dict[Kind, Registration], interval_s: float) -> bool:
        """Whether the sensor moves, as either odometry has it: one that has failed may well stand still."""
        velocities = [self._velocity(kind, result, interval_s).reshape(2, 3) for kind, result in results.items()]
        return bool((np.linalg.norm(velocities, axis=2) > CARRIER.moving).any())

    def _misfit(self, kind: Kind, result: Registration) -> float:
        """Distance of the points that fit, in metres, over their share: where few fit, those that do may be near."""
        return self._odometries[kind].residual / result.share if result.share > 0 else np.inf

    def _velocity(self, kind: Kind, result: Registration, interval_s: float) -> Floats:
        """(6,) the velocity since the last scan, in the sensor's axes."""
        step = inverse(self._last[kind]) @ result.T_odom_sensor
        return np.asarray(velocity_between(np.eye(4), step, interval_s))

    def _prefer(self, kind: Kind) -> None:
        """Takes results from an odometry; its last pose becomes that of the results, unless all are replaced."""
        if kind != self._best:
            if self._held is None:
                self._shift = squared_up(self._shift @ self._last[self._best] @ inverse(self._last[kind]))
            self._best = kind

    def _decide(self, kind: Kind) -> None:
        """Drops the other odometry."""
        self._odometries = {kind: self._odometries[kind]}
        what = "measured one after another, in their order" if kind == "order" else "measured at one instant"
        _log.info("the points of the scans have no times; they are taken as %s", what)


def _moved(T: Floats, result: Registration) -> Registration:
    """The same registration in another frame; T (4, 4) leads there."""
    motion = Motion(result.motion.seconds, T @ result.motion.knots)
    return replace(result, T_odom_sensor=T @ result.T_odom_sensor, motion=motion)
