"""What an odometry remembers, and what is known of the motion in a window before its points are looked at."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.inertial import NO_STEPS, Changes, MeasuredMotion, Steps
from sgslam.odometry.given_motion import GivenMotion
from sgslam.registration.beliefs import Belief, MotionModel
from sgslam.registration.health import Guess
from sgslam.registration.motion_prior import moved_on
from sgslam.registration.window import Solved, window_knots
from sgslam.types import TimedPoints

Floats = NDArray[np.float64]
USUAL_S = 1.0  # s, time constant of the usual share of explained points


@dataclass(frozen=True, eq=False)
class Course:
    """What an odometry remembers from scan to scan. Times are in seconds after its first stamp.

    Two scans are estimated together: `older` is the newer one of the last two, its knots at `older_knots` (K, 4, 4);
    None if it is in the map already. `beliefs` are about the ends of both, each as its own window left it.
    """

    first_ns: int | None = None
    scans: int = 0  # that saw something
    beliefs: list[Belief] = field(default_factory=list)
    older: TimedPoints | None = None
    older_knots: Floats = field(default_factory=lambda: np.empty((0, 4, 4)))
    side: float = 0.0  # m, between the points that are used of the next scan
    interval: float = np.inf  # s, the usual time from scan to scan: the shortest so far
    way: float = 0.0  # m, the length of the path
    usual: float = 0.0  # share of a scan's points on known surfaces
    height: float = 0.0  # m, the usual one along up
    residual: float = np.inf  # m, the median distance of the newest scan's points from their surfaces
    lost: bool = False
    lost_at: float = -np.inf  # s, of the last lost scan
    held_at: float = -np.inf  # s, of the last scan that was good or degraded

    def end_of_older(self, firsts: list[int]) -> int:
        """The knot at the end of the older scan, of a window whose scans' first knots are these; else the first one."""
        return firsts[0] + len(self.older_knots) - 1 if self.older is not None else 0

    def after(
        self, scan: TimedPoints, solved: Solved, firsts: list[int], up: Floats, settings: TrackingSettings
    ) -> "Course":
        """Goes on with a scan that fits the map, the newest one of a window; up (3,) is zero while it is unknown."""
        knots, last, seconds = solved.knots[firsts[-1] :], self.beliefs[-1], float(scan.knot_seconds[-1])
        interval = seconds - last.seconds
        follow = 1 - np.exp(-interval / settings.sway_memory)
        weight = max(1 - np.exp(-interval / USUAL_S), 1 / self.scans)
        return replace(
            self,
            beliefs=[last.smoothed(solved, self.end_of_older(firsts)), Belief.of(solved)],
            older=replace(scan, plane_of=solved.plane_of),
            older_knots=knots,
            way=self.way + float(np.linalg.norm(knots[-1, :3, 3] - last.T[:3, 3])),
            usual=self.usual + weight * (solved.share - self.usual),
            height=self.height + follow * (float(up @ knots[-1, :3, 3]) - self.height),
            residual=solved.residual,
            lost=False,
            held_at=seconds,
        )


@dataclass(frozen=True, eq=False)
class Prediction:
    """The knots of a window at `seconds` (K,), the first of each scan number `firsts`: `known` ones as found before,
    the others where the sensor goes on `ahead`, where it has `stopped`, unless an accelerometer knows that it did not,
    and as another system has `given` them, if one does; and what was measured between them."""

    seconds: Floats
    firsts: list[int]
    known: Guess
    ahead: Guess
    stopped: Guess | None
    given: Guess | None
    turns: Steps
    changes: Changes
    steps: Steps

    @property
    def turn_known(self) -> bool:
        """Whether a gyroscope tells how the sensor turned after the known knots."""
        information = self.turns.information
        return len(information) > 0 and bool((information[len(self.known) - 1 :, 0] > 0).all())


def predicted(
    course: Course, scans: list[TimedPoints], up: Floats, imu: MeasuredMotion, others: GivenMotion | None
) -> Prediction:
    """The prediction of a window of the newest one or two scans; up (3,) is zero while it is unknown."""
    belief, newest = course.beliefs[-len(scans)], course.beliefs[-1]
    seconds, firsts = window_knots(belief.seconds, [scan.knot_seconds for scan in scans])
    known = [belief.T] if len(scans) == 1 else [*[belief.T][: firsts[0]], *course.older_knots]
    after = seconds[len(known) - 1 :]
    moved = [known[-1], *(moved_on(known[-1], newest.velocity, s - after[0]) for s in after[1:])]
    moved = list(imu.turned(after, np.stack(moved)))[1:]
    changes = imu.changes(seconds, np.stack([*known, *moved]), belief.lasted, up)
    is_pushed = bool((changes.information[len(known) - 1 :] > 0).all())
    stopped = None if is_pushed else list(imu.turned(after, np.stack([known[-1]] * len(after))))[1:]
    steps, given = NO_STEPS, None
    if others is not None and course.first_ns is not None:
        steps = others.steps(course.first_ns, seconds)
        if others.tells(course.first_ns, after[0], after[-1]):
            given = list(others.moved(course.first_ns, known[-1], after[0], after[1:]))
    ahead = _pushed(known[-1], moved, after, newest.velocity[3:], changes.values[len(known) - 1 :])
    return Prediction(seconds, firsts, known, ahead, stopped, given, imu.turns(seconds), changes, steps)


def unobserved(
    course: Course, seconds: Floats, model: MotionModel, imu: MeasuredMotion, others: GivenMotion | None
) -> tuple[Belief, Floats]:
    """What remains to be believed at the end of a scan that tells nothing, and its knots (K, 4, 4) at times (K,): where
    the sensor was last, turned as a gyroscope tells, or moved from there as another system has it."""
    before = course.beliefs[-1] if course.beliefs else model.begin(float(seconds[0]), np.eye(4))
    belief, last = model.unobserved(before, float(seconds[-1])), before.observed or before
    turned = imu.turned(np.array([before.seconds, belief.seconds]), np.stack([before.T, belief.T]))[1]
    first_ns, seen = course.first_ns, bool(course.beliefs)
    if others is not None and first_ns is not None and seen and others.tells(first_ns, last.seconds, belief.seconds):
        knots = others.moved(first_ns, last.T, last.seconds, seconds)
        moved = others.covariance(first_ns, last.seconds, belief.seconds)
        return replace(belief, T=knots[-1], covariance=last.covariance + moved), knots
    return replace(belief, T=turned), np.tile(turned, (len(seconds), 1, 1))


def _pushed(last: Floats, moved: Guess, seconds: Floats, velocity: Floats, changes: Floats) -> Guess:
    """The poses `moved` on from the `last` known one, at times (K,), where the velocity (3,) before it changes as
    measured at each knot but the last (K-1, 3), zero where it is not."""
    place, ahead = last[:3, 3], []
    for pose, change, lasted in zip(moved, changes, np.diff(seconds), strict=True):
        velocity = velocity + change
        place = place + velocity * lasted
        ahead.append(pose.copy())
        ahead[-1][:3, 3] = place
    return ahead
