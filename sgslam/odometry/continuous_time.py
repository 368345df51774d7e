"""Registers each scan in continuous time to a local map of surfels, in a window of two scans.

Sources: CT-ICP (Dellenbach et al., ICRA 2022), Traj-LO (Zheng and Zhu, RA-L 2024), VoxelMap (Yuan et al., RA-L 2022).
"""

import logging
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sgslam.config import ImuSettings, TrackingSettings
from sgslam.geometry.frames import inverse, transform_points
from sgslam.inertial import Changes, ImuBuffer, MeasuredMotion
from sgslam.odometry.base import ROUNDS
from sgslam.odometry.given_motion import GivenMotion
from sgslam.odometry.prediction import USUAL_S, Course, predicted, unobserved
from sgslam.registration.beliefs import Belief, MotionModel
from sgslam.registration.health import SUSPICIOUS, Guess, best_attempt, fits, judged, likely_poses, sees_through
from sgslam.registration.motion import pose_at, steadied_points, thinned, velocity_after
from sgslam.registration.motion_prior import moved_on
from sgslam.registration.points import UNKNOWN, Weights, placed
from sgslam.registration.window import Solved, Window, solve
from sgslam.surfels import SurfelMap
from sgslam.types import Health, Motion, Registration, TimedPoints

Floats = NDArray[np.float64]
_BLIND = 50  # points: fewer do not tell where a scan was taken; the sensor is covered
_TRIED = 8  # of the likely poses of a lost sensor
_PAUSE = 3.0  # times the usual time between scans: what is shorter is no pause
_log = logging.getLogger(__name__)


class _Found(NamedTuple):
    """The fields of a `Registration`, with the knots (K, 4, 4) of the scan."""

    knots: Floats
    covariance: Floats
    health: Health
    share: float
    unconstrained: Floats = np.empty((0, 6))


class ContinuousTimeOdometry:
    """State: the sensor's pose at knots, at most `knot_interval` apart, where each scan begins and ends.

    Two scans are estimated together. The older of them is then added to the map. An `imu` tells how the sensor moves,
    and so does another system by the motion `given`, which carries a lost sensor on.
    """

    def __init__(
        self, settings: TrackingSettings, imu: MeasuredMotion | None = None, given: GivenMotion | None = None
    ) -> None:
        self._settings, self._given = settings, given
        self._imu = imu or MeasuredMotion(ImuBuffer(ImuSettings()))  # one that never measures anything
        self._model, self._map, self._course = MotionModel(settings), SurfelMap(), Course()

    @property
    def residual(self) -> float:
        """The median distance (m) of the newest scan's points from their surfaces."""
        return self._course.residual

    def level(self, up_in_odom: Floats) -> None:
        """Sets the direction of gravity (3,) in `odom`, once it is known."""
        if self._course.beliefs:  # the sensor is as far from its usual height as before
            risen = float((up_in_odom - self._model.up) @ self._course.beliefs[-1].T[:3, 3])
            self._go_on(height=self._course.height + risen)
        self._model.level(up_in_odom)

    def register(self, stamp_ns: int, points: Floats, point_times: Floats | None = None) -> Registration:
        """Registers the points (N, 3), N >= 0, of one scan in the sensor frame, measured `point_times` (N,) seconds
        after its stamp (None if unknown)."""
        if self._course.first_ns is None:
            self._go_on(first_ns=stamp_ns)
            self._imu.begin(stamp_ns)
        began = (stamp_ns - self._first_ns) / 1e9
        # a few points, spread evenly, as a sensor that turns steadily between the knots would have measured them
        scan, side = thinned(points, point_times, began, self._course.side, self._settings)
        unsteady = self._imu.unsteady(scan.knot_seconds)
        scan = scan if unsteady is None else steadied_points(scan, unsteady)
        # after a pause, it is as if the sensor had been covered for as long
        if is_after_pause := self._course.scans > 1 and self._is_after_pause(scan):
            self._go_on(lost=True, lost_at=self._course.beliefs[-1].seconds)
        # its pose and that of the scan before, which then joins the map
        if len(scan.points) < _BLIND:
            found = self._lose(scan, 0.0)
        else:
            self._go_on(scans=self._course.scans + 1, side=side)
            found = self._located(scan)
        # all by seconds after the stamp
        motion = Motion(scan.knot_seconds - began, found.knots)
        return Registration(
            pose_at(motion, 0.0),
            found.covariance,
            found.health,
            found.share,
            motion,
            point_times,
            found.unconstrained,
            None if unsteady is None else unsteady.later(-began),
            is_after_pause,
            scan.later(-began),
        )

    def _go_on(self, **changes: Any) -> None:
        self._course = replace(self._course, **changes)

    @property
    def _first_ns(self) -> int:
        assert self._course.first_ns is not None
        return self._course.first_ns

    @property
    def _oldest(self) -> float:
        """The way (m) at which a surface was last seen that is still in the map."""
        return self._course.way - self._settings.local_map

    def _located(self, scan: TimedPoints) -> _Found:
        """A scan that sees something: the first one, the second one, or the newest with the one before, unless that is
        in the map already."""
        course = self._course
        if course.scans == 1:
            knots = self._imu.turned(scan.knot_seconds, np.tile(np.eye(4), (len(scan.knot_seconds), 1, 1)))
            first = self._model.begin(float(scan.knot_seconds[-1]), knots[-1])
            self._add(scan, knots)
            self._go_on(older=scan, older_knots=knots, beliefs=[first])
            return _Found(knots, first.covariance, "good", 1.0)
        if course.scans == 2 and course.older is not None:
            self._go_on(older=None)  # it is in the map
            return self._judged(scan, *self._second(course.older, scan))
        return self._judged(scan, *self._solved([scan] if course.older is None else [course.older, scan]))

    def _second(self, first: TimedPoints, scan: TimedPoints) -> tuple[Solved, list[int]]:
        """The second scan; the first is put right by the motion between them, and again by that of the result."""
        solved, firsts = self._solved([scan])
        velocity, begins = np.zeros(6), first.knot_seconds[0]
        for _ in range(ROUNDS if len(first.knot_seconds) > 1 else 0):
            # where the first scan was given too little motion, the second shows as much too much
            velocity = (velocity + velocity_after(Motion(solved.seconds, solved.knots), 0)) / 2
            steady = np.stack([moved_on(np.eye(4), velocity, second - begins) for second in first.knot_seconds])
            knots = self._imu.turned(first.knot_seconds, steady)
            self._go_on(beliefs=[self._model.begin(float(first.knot_seconds[-1]), knots[-1])])
            self._map.clear()
            self._add(first, knots)
            solved, firsts = self._solved([scan])
        return solved, firsts

    def _is_after_pause(self, scan: TimedPoints) -> bool:
        """Whether no scan came for long before this one, and nothing else measured how the sensor moved."""
        last, begins, ends = self._course.beliefs[-1].seconds, float(scan.knot_seconds[0]), float(scan.knot_seconds[-1])
        usual = self._course.interval
        self._go_on(interval=min(usual, ends - last))
        if begins - last <= max(self._settings.pause, _PAUSE * usual):
            return False
        if self._given is not None and self._given.tells(self._first_ns, last, begins):
            return False
        turns = self._imu.turns(np.array([last, begins]))
        return not (len(turns.information) and bool((turns.information[:, 0] > 0).all()))

    def _solved(self, scans: list[TimedPoints]) -> tuple[Solved, list[int]]:
        """The knots of a window, and the index of each scan's first one; tried again where the result is suspicious."""
        course, settings = self._course, self._settings
        at = predicted(course, scans, self._model.up, self._imu, self._given)
        prior = self._model.expected(course.beliefs[-len(scans)], at.seconds, course.height, at.changes)
        window = Window(
            np.concatenate([scan.points for scan in scans]),
            np.concatenate([scan.seconds for scan in scans]),
            np.concatenate([scan.plane_of for scan in scans]),
            np.cumsum([0, *(len(scan.points) for scan in scans)]),
            np.array(at.firsts),
            np.array([len(scan.knot_seconds) for scan in scans]),
            at.seconds,
            prior,
            self._model.prior,
            at.turns,
            at.changes,
            at.steps,
            self._map.arrays,
            self._oldest,
            Weights.of(settings),
        )

        def attempt(guess: Guess, kernel: float, iterations: int, every: int) -> Solved:
            return solve(window, np.stack([*at.known, *guess]), kernel, iterations, every)

        def fits_well(solved: Solved) -> bool:
            return fits(solved, course.usual)

        return best_attempt(
            attempt, fits_well, at.ahead, at.stopped, at.given, course.lost, at.turn_known, settings
        ), at.firsts

    def _judged(self, scan: TimedPoints, solved: Solved, firsts: list[int]) -> _Found:
        """Adds the older scan to the map and remembers the newest one, unless it is lost.

        People who went away leave surfaces: a scan that sees through some where the sensor was followed is in doubt. It
        is called lost and not added, but the sensor is lost only if its scans stay in doubt.
        """
        course = self._course
        cautious, covariance = solved.covariances_in_sensor(firsts[-1], len(scan.knot_seconds) == 1)
        relative = solved.share / max(course.usual, 1e-9) if course.scans > 2 else 1.0
        health, unconstrained = judged(solved, cautious, relative, course.lost, self._settings)
        if health == "lost":
            return self._lose(scan, solved.share)
        knots, ends = solved.knots[firsts[-1] :], float(scan.knot_seconds[-1])
        in_doubt = self._is_in_doubt(scan, knots, relative)
        if in_doubt and (course.lost or ends - course.held_at > self._settings.kidnapped):
            return self._lose(scan, solved.share)
        if course.older is not None:
            self._add(course.older, solved.knots[firsts[0] :][: len(course.older_knots)])
        if in_doubt:
            self._go_on(beliefs=[Belief.of(solved)], older=None)
            return _Found(knots, covariance, "lost", solved.share)
        self._remember(scan, solved, firsts)
        return _Found(knots, covariance, health, solved.share, unconstrained)

    def _remember(self, scan: TimedPoints, solved: Solved, firsts: list[int]) -> None:
        """Goes on from a scan that fits the map."""
        course, before = self._course, self._course.end_of_older(firsts)
        if not solved.converged:
            _log.debug("scan at %.2f s: no convergence in %d iterations", scan.knot_seconds[-1], solved.iterations)
        changes = self._imu.changes(solved.seconds, solved.predicted, course.beliefs[0].lasted, self._model.up)
        later = Changes(changes.values[before:], changes.information[before:])
        self._imu.follow(solved.seconds[before:], solved.knots[before:], later)
        self._course = course.after(scan, solved, firsts, self._model.up, self._settings)

    def _is_in_doubt(self, scan: TimedPoints, knots: Floats, relative: float) -> bool:
        """Whether a suspicious scan, its knots at (K, 4, 4), sees through too many surfaces of the map.

        A place where the sensor is found again is suspicious until the usual share of points is that of this place.
        """
        is_new = float(scan.knot_seconds[-1]) - self._course.lost_at < USUAL_S
        if not is_new and relative >= SUSPICIOUS:
            return False
        points = placed(scan.points, scan.seconds, scan.knot_seconds, knots)[0]
        return sees_through(points, knots[0, :3, 3], self._map.arrays, self._oldest, self._settings)

    def _lose(self, scan: TimedPoints, share: float) -> _Found:
        """A scan that tells nothing, or does not fit the map: its pose is a prediction."""
        course, seconds = self._course, scan.knot_seconds
        if course.older is not None:
            self._add(course.older, course.older_knots)
        belief, knots = unobserved(course, seconds, self._model, self._imu, self._given)
        self._imu.lose()
        beliefs = [belief] if course.beliefs else []
        self._go_on(lost=True, lost_at=float(seconds[-1]), older=None, beliefs=beliefs)
        return _Found(knots, belief.covariance, "lost", share)

    def rejoin(self, other: "ContinuousTimeOdometry") -> bool:
        """Tries to register the scan that `other` registered last near the place where the sensor was lost, and
        continues from there. Returns whether it fits."""
        course, there = self._course, other._course
        if there.older is None or not self._model.up.any():
            return False
        later, last = (other._first_ns - self._first_ns) / 1e9, there.older_knots[-1]
        unknown = np.full_like(there.older.plane_of, UNKNOWN)  # in this map
        scan = replace(there.older, plane_of=unknown).later(later)
        # the places near the last known one where the other's newest scan would fit best
        in_odom = placed(scan.points, scan.seconds, scan.knot_seconds, there.older_knots)[0]
        seen = np.hstack([transform_points(inverse(last), in_odom), scan.points[:, 3:]])
        near = course.beliefs[-1].T @ last
        found = []
        for T in likely_poses(seen, near, self._model.up, self._map.arrays, self._oldest, _TRIED):
            T_odom_other, begin = T @ inverse(last), there.beliefs[-2]
            velocity = np.kron(np.eye(2), T_odom_other[:3, :3]) @ there.beliefs[-1].velocity
            belief = self._model.moving(begin.seconds + later, T_odom_other @ begin.T, 0.5, velocity)
            self._go_on(beliefs=[belief])
            found.append((belief, *self._solved([scan])))
        belief, solved, firsts = max(found, key=lambda own: own[1].close)
        self._go_on(beliefs=[belief])
        if self._judged(scan, solved, firsts).health != "lost":
            return True
        self._go_on(beliefs=course.beliefs)
        return False

    def _add(self, scan: TimedPoints, knots: Floats) -> None:
        """Adds a scan to the map."""
        seen = placed(scan.points, scan.seconds, scan.knot_seconds, knots)
        self._map.add(*seen, self._course.way, self._settings.local_map)
