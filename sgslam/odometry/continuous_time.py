"""Registers each scan in continuous time to a local map of surfels, in a window of two scans.

Sources: CT-ICP (Dellenbach et al., ICRA 2022), Traj-LO (Zheng and Zhu, RA-L 2024), VoxelMap (Yuan et al., RA-L 2022).
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.geometry.frames import inverse, transform_points
from sgslam.inertial import NO_TURNS, Changes, MeasuredMotion, no_changes
from sgslam.odometry.base import State
from sgslam.odometry.given_motion import GivenMotion
from sgslam.registration.attempts import best_attempt
from sgslam.registration.beliefs import Belief, MotionModel
from sgslam.registration.free_space import shares_seen_through
from sgslam.registration.health import judged
from sgslam.registration.motion import points_and_rays, pose_at, velocity_after
from sgslam.registration.motion_prior import NO_STEPS, moved_on
from sgslam.registration.points import UNKNOWN, Weights
from sgslam.registration.relocation import likely_poses
from sgslam.registration.sampling import steadied_points, thinned
from sgslam.registration.window import Solved, Window, solve, window_knots
from sgslam.surfels import SurfelMap
from sgslam.types import Health, Motion, Registration, TimedPoints

Floats = NDArray[np.float64]
_BLIND = 50  # points: fewer do not tell where a scan was taken; the sensor is covered
_MOST_RAYS = 0.5  # share that no person who went away leaves free, since he stood on one side of the sensor
_TRIED = 8  # of the likely poses of a lost sensor
_UNSURE = 3.0  # s, at the beginning, in which a map of a few scans may mislead
_KNOWN = 0.5  # s, after it, whose scans are the map for the first ones
_PAUSE = 3.0  # times the usual time between scans: what is shorter is no pause
_ROUNDS = 3  # in which the first scan is put right by the motion to the second


@dataclass(frozen=True, eq=False)
class _Found:
    """The fields of a `Registration`, with the knots (K, 4, 4) of the scan."""

    knots: Floats
    covariance: Floats
    health: Health
    share: float
    unconstrained: Floats = field(default_factory=lambda: np.empty((0, 6)))


class ContinuousTimeOdometry:
    """State: the sensor's pose at knots, at most `knot_interval` apart, where each scan begins and ends.

    Two scans are estimated together. The older of them is then added to the map. An `imu` tells how the sensor moves,
    and so does another system by the motion `given`, which carries a lost sensor on.
    """

    _STATE = (
        "_side", "_first_ns", "_scans", "_lost", "_way", "_usual", "_height", "_older", "_older_knots", "_beliefs",
        "residual", "_up", "_early", "_lost_at", "_held_at", "_interval",
    )  # fmt: skip

    def __init__(
        self, settings: TrackingSettings, imu: MeasuredMotion | None = None, given: GivenMotion | None = None
    ) -> None:
        self._imu, self._given = imu, given
        self._settings, self._model, self._weights = settings, MotionModel(settings), Weights.of(settings)
        self._map, self._side = SurfelMap(), 0.0
        self._first_ns: int | None = None
        self._scans, self._lost, self._lost_at = 0, False, -np.inf  # the latter: seconds, of the last lost scan
        self._held_at = -np.inf  # s, of the last scan that was good or degraded
        self._up: Floats | None = None  # in `odom`, once it is known
        self._way, self._usual = 0.0, 0.0  # m; share of a scan's points on known surfaces
        self._height = 0.0  # m, the usual one along `up`
        self._older: TimedPoints | None = None  # the newest scan, if it is not in the map yet
        self._older_knots = np.empty((0, 4, 4))  # its knots
        self._beliefs: list[Belief] = []  # of the ends of the last two scans, each as its own window left it
        self._early: list[TimedPoints] | None = []  # all scans so far, while the first ones may be looked back at
        self._interval = np.inf  # s, the usual time from scan to scan: the shortest so far
        self.residual = np.inf  # m, the median distance of the newest scans' points from their surfaces

    @property
    def surfels(self) -> tuple[Floats, Floats, Floats]:
        """Means (N, 3) and normals (N, 3) in `odom`, and numbers of points (N,) of all surfaces in the local map."""
        return self._map.surfels()

    def level(self, up_in_odom: Floats) -> None:
        """Sets the direction of gravity (3,) in `odom`, once it is known."""
        if self._beliefs:  # the sensor is as far from its usual height as before
            self._height += float((up_in_odom - self._model.up) @ self._beliefs[-1].T[:3, 3])
        self._up = up_in_odom
        self._model.level(up_in_odom)

    def register(self, stamp_ns: int, points: Floats, point_times: Floats | None = None) -> Registration:
        """Registers the points (N, 3), N >= 0, of one scan in the sensor frame, measured `point_times` (N,) seconds
        after its stamp (None if unknown)."""
        if self._first_ns is None:
            self._first_ns = stamp_ns
            if self._imu is not None:
                self._imu.begin(stamp_ns)
        began = (stamp_ns - self._first_ns) / 1e9
        scan, side = thinned(points, point_times, began, self._side, self._settings)
        unsteady = None if self._imu is None else self._imu.unsteady(scan.knot_seconds)
        scan = scan if unsteady is None else steadied_points(scan, unsteady)
        if is_after_pause := self._scans > 1 and self._is_after_pause(scan):
            self._lost, self._lost_at = True, self._beliefs[-1].seconds  # as if it had been covered for as long
        found = self._lose(scan, 0.0) if len(scan.points) < _BLIND else self._found(scan, side)
        if self._early is not None:
            self._early.append(scan)
            if began > 2 * self._settings.gravity_until:
                self._early = None
        motion = Motion(scan.knot_seconds - began, found.knots)
        return Registration(
            pose_at(motion, 0.0), found.covariance, found.health, found.share, motion, point_times, found.unconstrained,
            None if unsteady is None else unsteady.later(-began), is_after_pause, scan.later(-began),
        )  # fmt: skip

    def _found(self, scan: TimedPoints, side: float) -> _Found:
        """A scan that sees something; `side` as in `thinned`."""
        self._side = side
        self._scans += 1
        if self._scans == 1:
            return self._begin(scan)
        return self._second(scan) if self._scans == 2 and self._older is not None else self._next(scan)

    def _begin(self, scan: TimedPoints) -> _Found:
        """The first scan: its pose is the frame `odom`."""
        still = np.tile(np.eye(4), (len(scan.knot_seconds), 1, 1))
        self._older, self._older_knots = scan, self._turned(scan.knot_seconds, still)
        self._beliefs = [self._model.begin(float(scan.knot_seconds[-1]))]
        self._add(scan, self._older_knots)
        return _Found(self._older_knots, np.eye(6) * 1e-8, "good", 1.0)

    def _second(self, scan: TimedPoints) -> _Found:
        """The second scan; the first is put right by the motion between them, and again by that of the result."""
        assert self._older is not None
        first, self._older = self._older, None  # it is in the map
        solved, firsts = self._solved(self._beliefs[-1], [scan])
        velocity = np.zeros(6)
        for _ in range(_ROUNDS if len(first.knot_seconds) > 1 else 0):
            # where the first scan was given too little motion, the second shows as much too much
            velocity = (velocity + velocity_after(Motion(solved.seconds, solved.knots), 0)) / 2
            steady = self._model.steady(np.eye(4), velocity, first.knot_seconds)
            knots = self._turned(first.knot_seconds, steady)
            self._beliefs = [self._model.known(float(first.knot_seconds[-1]), knots[-1])]
            self._map.clear()
            self._add(first, knots)
            solved, firsts = self._solved(self._beliefs[-1], [scan])
        return self._judged(scan, solved, firsts)

    def _next(self, scan: TimedPoints) -> _Found:
        """The newest scan, together with the one before unless that is in the map already."""
        if self._older is None:
            solved, firsts = self._solved(self._beliefs[-1], [scan])
        else:
            solved, firsts = self._solved(self._beliefs[-2], [self._older, scan])
        return self._judged(scan, solved, firsts)

    def _is_after_pause(self, scan: TimedPoints) -> bool:
        """Whether no scan came for long before this one, and nothing else measured how the sensor moved."""
        last, begins, ends = self._beliefs[-1].seconds, float(scan.knot_seconds[0]), float(scan.knot_seconds[-1])
        usual, self._interval = self._interval, min(self._interval, ends - last)
        if begins - last <= max(self._settings.pause, _PAUSE * usual) or self._is_given(last, begins):
            return False
        turns = NO_TURNS if self._imu is None else self._imu.turns(np.array([last, begins]))
        return not (len(turns.information) and bool((turns.information > 0).all()))

    def _solved(self, belief: Belief, scans: list[TimedPoints]) -> tuple[Solved, list[int]]:
        """The knots of a window, and the index of each scan's first one; tried again where the result is suspicious."""
        settings = self._settings
        seconds, firsts = window_knots(belief.seconds, [scan.knot_seconds for scan in scans])
        known = [belief.T] if len(scans) == 1 else [*[belief.T][: firsts[0]], *self._older_knots]
        newest, after = self._beliefs[-1], seconds[len(known) - 1 :]
        moved = [known[-1], *(moved_on(known[-1], newest.velocity, s - after[0]) for s in after[1:])]
        predicted = np.stack([*known, *self._turned(after, np.stack(moved))[1:]])
        changes = self._changes(belief, seconds, predicted)
        ahead = _pushed(seconds, predicted, len(known), newest.velocity[3:], changes)
        turns = NO_TURNS if self._imu is None else self._imu.turns(seconds)
        steps, given = NO_STEPS, None
        if self._given is not None and self._first_ns is not None:
            steps = self._given.steps(self._first_ns, seconds)
            if self._is_given(after[0], after[-1]):
                given = list(self._given.moved(self._first_ns, known[-1], after[0], after[1:]))

        window = Window(
            np.concatenate([scan.points for scan in scans]), np.concatenate([scan.seconds for scan in scans]),
            np.concatenate([scan.plane_of for scan in scans]), np.cumsum([0, *(len(scan.points) for scan in scans)]),
            np.array(firsts), np.array([len(scan.knot_seconds) for scan in scans]), seconds,
            self._model.expected(belief, seconds, self._height, changes), self._model.prior, turns, changes, steps,
            self._map.arrays, self._way - settings.local_map, self._weights,
        )  # fmt: skip

        def attempt(guess: list[Floats], kernel: float, iterations: int) -> Solved:
            return solve(window, np.stack([*known, *guess]), kernel, iterations)

        velocity_known = bool((changes.information[len(known) - 1 :] > 0).all())
        stopped = None if velocity_known else list(self._turned(after, np.stack([known[-1]] * len(after))))[1:]
        turn_known = len(turns.information) > 0 and bool(np.all(turns.information[len(known) - 1 :] > 0))
        return best_attempt(attempt, self._fits, ahead, stopped, given, self._lost, turn_known, settings), firsts

    def _turned(self, seconds: Floats, knots: Floats) -> Floats:
        """Predicted knots (K, 4, 4) at times (K,), as far as a gyroscope tells how the sensor turned."""
        return knots if self._imu is None else self._imu.turned(seconds, knots)

    def _changes(self, belief: Belief, seconds: Floats, predicted: Floats) -> Changes:
        """The changes of velocity at all but the last of the predicted knots (K, 4, 4), as an accelerometer tells."""
        if self._imu is None:
            return no_changes(len(seconds) - 1)
        return self._imu.changes(seconds, predicted, belief.lasted, self._model.up)

    def _fits(self, solved: Solved) -> bool:
        """Whether about as many points of the newest scan as usual lie on known surfaces."""
        usual = self._settings.suspicious * self._usual
        return solved.share >= usual and solved.agreement >= self._settings.agreement

    def _judged(self, scan: TimedPoints, solved: Solved, firsts: list[int]) -> _Found:
        """Adds the older scan to the map and remembers the newest one, unless it is lost.

        People who went away leave surfaces: a scan that sees through some where the sensor was followed is in doubt. It
        is called lost and not added, but the sensor is lost only if its scans stay in doubt.
        """
        covariance = solved.covariance_in_sensor(firsts[-1], len(scan.knot_seconds) == 1)
        relative = solved.share / max(self._usual, 1e-9) if self._scans > 2 else 1.0
        health, unconstrained = judged(solved, covariance, relative, self._lost, self._settings)
        if health == "lost":
            return self._lose(scan, solved.share)
        knots, ends = solved.knots[firsts[-1] :], float(scan.knot_seconds[-1])
        in_doubt = self._sees_through(scan, knots, relative)
        if in_doubt and (self._lost or ends - self._held_at > self._settings.kidnapped):
            return self._lose(scan, solved.share)
        if self._older is not None:
            self._add(self._older, solved.knots[firsts[0] :][: len(self._older_knots)])
        if in_doubt:
            self._beliefs, self._older = [Belief.of(solved)], None
            return _Found(knots, covariance, "lost", solved.share)
        self._remember(scan, solved, firsts)
        return _Found(knots, covariance, health, solved.share, unconstrained)

    def _remember(self, scan: TimedPoints, solved: Solved, firsts: list[int]) -> None:
        """Goes on from a scan that fits the map."""
        knots, ends = solved.knots[firsts[-1] :], float(scan.knot_seconds[-1])
        interval = ends - self._beliefs[-1].seconds
        self._lost, self._held_at = False, ends
        self._way += float(np.linalg.norm(knots[-1, :3, 3] - self._beliefs[-1].T[:3, 3]))
        before = firsts[0] + len(self._older_knots) - 1 if self._older is not None else 0
        if self._imu is not None:
            changes = self._changes(self._beliefs[0], solved.seconds, solved.predicted)
            later = Changes(changes.values[before:], changes.information[before:])
            self._imu.follow(solved.seconds[before:], solved.knots[before:], later)
        self._beliefs = [self._beliefs[-1].smoothed(solved, before), Belief.of(solved)]
        self._older, self._older_knots = replace(scan, plane_of=solved.plane_of), knots
        self.residual = solved.residual
        follow = 1 - np.exp(-interval / self._settings.sway_memory)
        self._height += follow * (float(self._model.up @ knots[-1, :3, 3]) - self._height)
        weight = max(1 - np.exp(-interval / self._settings.usual_memory), 1 / self._scans)
        self._usual += weight * (solved.share - self._usual)

    def _sees_through(self, scan: TimedPoints, knots: Floats, relative: float) -> bool:
        """Whether the rays of a suspicious scan, its knots at (K, 4, 4), pass through too many surfaces of the map.

        A place where the sensor is found again is suspicious until the usual share of points is that of this place.
        """
        settings = self._settings
        is_new = float(scan.knot_seconds[-1]) - self._lost_at < settings.usual_memory
        if not is_new and relative >= settings.suspicious:
            return False
        points, _ = points_and_rays(Motion(scan.knot_seconds, knots), scan.points, scan.seconds)
        oldest = self._way - settings.local_map
        of_rays, of_surfaces = shares_seen_through(points, knots[0, :3, 3], self._map.arrays, oldest)
        return of_rays > _MOST_RAYS or of_surfaces > settings.seen_through

    def _lose(self, scan: TimedPoints, share: float) -> _Found:
        """A scan that tells nothing, or does not fit the map: its pose is a prediction."""
        if self._older is not None:
            self._add(self._older, self._older_knots)
        before = self._beliefs[-1] if self._beliefs else self._model.begin(float(scan.knot_seconds[0]))
        belief = self._model.unobserved(before, float(scan.knot_seconds[-1]))
        if self._imu is not None:
            T = self._imu.turned(np.array([before.seconds, belief.seconds]), np.stack([before.T, belief.T]))[1]
            belief = replace(belief, T=T)
            self._imu.lose()
        knots = np.tile(belief.T, (len(scan.knot_seconds), 1, 1))
        last = before.observed or before
        if self._beliefs and self._is_given(last.seconds, belief.seconds):
            belief, knots = self._carried_on(belief, last, scan.knot_seconds)
        self._lost, self._lost_at, self._older = True, float(scan.knot_seconds[-1]), None
        self._beliefs = [belief] if self._beliefs else []
        return _Found(knots, belief.covariance, "lost", share)

    def _is_given(self, begin: float, end: float) -> bool:
        """Whether another system tells the motion between two times (s)."""
        return self._given is not None and self._first_ns is not None and self._given.tells(self._first_ns, begin, end)

    def _carried_on(self, belief: Belief, last: Belief, seconds: Floats) -> tuple[Belief, Floats]:
        """A belief, and the knots (K, 4, 4) of a lost scan at times (K,), where the sensor moved from the `last`
        observed one as another system has it."""
        assert self._first_ns is not None and self._given is not None
        knots = self._given.moved(self._first_ns, last.T, last.seconds, seconds)
        covariance = last.covariance + self._given.covariance(self._first_ns, last.seconds, belief.seconds)
        return replace(belief, T=knots[-1], covariance=covariance), knots

    def look_back(self, results: list[Registration]) -> list[Registration]:
        """Returns the results of all scans so far, with the first ones registered again, as these had hardly any map
        before: the later scans are the map, and they are registered to it from the last of them to the first. To be
        called once, after some seconds."""
        early, self._early = self._early, None
        if early is None or len(early) != len(results) or any(result.health == "lost" for result in results):
            return results
        ages = np.array([scan.knot_seconds[0] - early[0].knot_seconds[0] for scan in early])
        count = int(np.searchsorted(ages, _UNSURE))
        if len(early) - count < 2 or ages[-1] < _UNSURE + _KNOWN:
            return results
        imu = None if self._imu is None else self._imu.backwards()
        back = ContinuousTimeOdometry(self._settings, imu, None if self._given is None else self._given.backwards())
        back._first_ns = self._first_ns
        if self._up is not None:
            back.level(self._up)
        for scan, result in zip(early[count:-1], results[count:-1], strict=True):
            back._add(scan, result.motion.knots)
        knots = np.concatenate([result.motion.knots for result in results[count : count + 2]])
        seconds = np.concatenate([scan.knot_seconds for scan in early[count : count + 2]])
        velocity, lasted = -velocity_after(Motion(seconds, knots), 0), float(seconds[1] - seconds[0])
        back._beliefs = [back._model.moving(-float(seconds[0]), knots[0], velocity, lasted)]
        back._scans, back._usual, back._height = self._scans, self._usual, self._height
        again = []
        for scan, result in zip(early[:count][::-1], results[:count][::-1], strict=True):
            found = back._next(scan.reversed())
            motion = Motion(result.motion.seconds, found.knots[::-1].copy())
            again.append(
                replace(
                    result, T_odom_sensor=pose_at(motion, 0.0), covariance=found.covariance, health=found.health,
                    share=found.share, motion=motion, unconstrained=found.unconstrained,
                )
            )  # fmt: skip
        if any(result.health == "lost" for result in again):
            return results
        if back._older is not None:
            back._add(back._older, back._older_knots)
        self._map = back._map
        return [*again[::-1], *results[count:]]

    def rejoin(self, other: "ContinuousTimeOdometry") -> bool:
        """Tries to register the scan that `other` registered last near the place where the sensor was lost, and
        continues from there. Returns whether it fits."""
        if other._older is None or self._up is None:
            return False
        assert self._first_ns is not None and other._first_ns is not None
        lost = self._beliefs
        unknown = np.full_like(other._older.plane_of, UNKNOWN)  # in this map
        scan = replace(other._older, plane_of=unknown).later((other._first_ns - self._first_ns) / 1e9)
        found = []
        for T_odom_other in self._likely_poses(other, scan):
            begin, velocity = other._beliefs[-2], np.kron(np.eye(2), T_odom_other[:3, :3]) @ other._beliefs[-1].velocity
            before = begin.seconds + (other._first_ns - self._first_ns) / 1e9
            self._beliefs = [self._model.near(before, T_odom_other @ begin.T, velocity)]
            found.append((self._beliefs, *self._solved(self._beliefs[-1], [scan])))
        self._beliefs, solved, firsts = max(found, key=lambda own: own[1].close)
        if self._judged(scan, solved, firsts).health != "lost":
            return True
        self._beliefs = lost
        return False

    def _likely_poses(self, other: "ContinuousTimeOdometry", newest: TimedPoints) -> list[Floats]:
        """T_odom_other (4, 4) of the places near the last known one where the other's newest scan would fit best."""
        last = other._older_knots[-1]
        motion = Motion(newest.knot_seconds, other._older_knots)
        placed, _ = points_and_rays(motion, newest.points, newest.seconds)
        seen = np.hstack([transform_points(inverse(last), placed), newest.points[:, 3:]])
        local = self._map.arrays, self._way - self._settings.local_map
        assert self._up is not None
        return [T @ inverse(last) for T in likely_poses(seen, self._beliefs[-1].T @ last, self._up, *local, _TRIED)]

    def _add(self, scan: TimedPoints, knots: Floats) -> None:
        """Adds a scan to the map."""
        seen = points_and_rays(Motion(scan.knot_seconds, knots), scan.points, scan.seconds)
        self._map.add(*seen, self._way, self._settings.local_map)

    def state(self) -> dict[str, Any]:
        """Returns the state as a tree; another instance with the same settings continues identically."""
        imu = None if self._imu is None else self._imu.state()
        return {"map": self._map.state(), "imu": imu} | {name: getattr(self, name) for name in self._STATE}

    def restore(self, state: State) -> None:
        """Restores what `state` returned."""
        self._map.restore(state["map"])
        if self._imu is not None:
            self._imu.restore(state["imu"])
        for name in self._STATE:
            setattr(self, name, state[name])
        if self._up is not None:
            self._model.level(self._up)


def _pushed(seconds: Floats, predicted: Floats, known: int, velocity: Floats, changes: Changes) -> list[Floats]:
    """The predicted knots (4, 4) after the first `known` ones, where the velocity (3,) before them changes as measured.

    Where no change is measured, the velocity remains.
    """
    place, ahead = predicted[known - 1, :3, 3], []
    for k in range(known, len(seconds)):
        velocity = velocity + changes.values[k - 1]
        place = place + velocity * (seconds[k] - seconds[k - 1])
        ahead.append(predicted[k].copy())
        ahead[-1][:3, 3] = place
    return ahead
