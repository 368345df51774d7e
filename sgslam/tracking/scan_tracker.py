"""Tracks scan after scan: predicts each pose from the last step and aligns the scan with the walls and the floor.

The odometry is used where these leave the pose uncertain.
"""

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.geometry.frames import angle_of, inverse, level_map, raised, squared_up
from sgslam.mapping import Floors, WallMap
from sgslam.odometry import Odometry
from sgslam.perception import ColumnScan, RawScan
from sgslam.perception.deskew import checked_times, deskewed, part_of
from sgslam.serialization import Stateful
from sgslam.tracking.floor_transition import FloorTransition
from sgslam.tracking.front_end import FrontEnd, align
from sgslam.tracking.motion import predict, upright_step
from sgslam.tracking.step_history import OdometryFrame, StepHistory
from sgslam.tracking.step_uncertainty import StepUncertainty, surfaces_of, turned

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_LONGEST_SWEEP = 1.5  # intervals between scans; a longer sweep means that point_times has another unit
_OUTLIER_RATES = 5.0, 10.0  # rad/s and m/s, the uncertainty of a step at which an external odometry has an outlier
_FAST, _TURNING = 5.0, 3.0  # m/s and rad/s, the fastest that a sensor is carried indoors
_CLEAR_MARGIN = 0.05  # of a scan's points by which the better of two poses must explain more
_LONGEST_OUTLIER = 10**9  # ns; a deviation that lasts is no slip: the robot was stopped or pushed


@dataclass(frozen=True)
class Located:
    """T_odom_sensor and T_map_sensor (4, 4) of one scan.

    `T_map_landed` (4, 4) is set where the scan arrives at a known floor: T_map_sensor without the drift in height.
    """

    T_odom_sensor: Floats
    T_map_sensor: Floats
    T_map_landed: Floats | None = None


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """A scan deskewed to one instant, `offset_ns` after its stamp, and sorted into columns.

    `points` (N, 3) are in the sensor frame; `T_odom_sensor` (4, 4) is that of an external odometry, else None.
    """

    stamp_ns: int
    offset_ns: int
    points: Floats
    columns: ColumnScan
    T_odom_sensor: Floats | None


@dataclass(frozen=True)
class _AlignedGuess:
    """T_map_sensor (4, 4) after the alignment of a guess, and the `share` of the points that it explains.

    `well_constrained`: walls constrain it in all directions. `unexpected`: it is far from the guess.
    """

    T_map_sensor: Floats
    share: float
    well_constrained: bool
    unexpected: bool
    information: Floats  # (3, 3) of yaw, x and y in level axes, from walls

    def better_than(self, other: "_AlignedGuess") -> bool:
        return self.well_constrained > other.well_constrained or (
            self.well_constrained == other.well_constrained and self.share > other.share + _CLEAR_MARGIN
        )


class ScanTracker(Stateful):
    """Tracks the pose of each scan.

    A robot moves nearly as it did one scan ago. Indoors, where few rings see much of a wall, this predicts the pose
    more exactly than KISS-ICP. If the walls constrain the aligned scan well, close to its prediction, the odometry is
    not needed.
    """

    _STATE = ("_last", "_warned_of_outlier", "_before_outlier", "_outlier_ns")

    def __init__(self, config: Config, odometry: Odometry, floors: Floors) -> None:
        self._config, self._odometry, self._floors = config, odometry, floors
        self.front_end = FrontEnd(config)
        self._last: Located | None = None
        self._steps, self._frame = StepHistory(), OdometryFrame()
        self._warned_of_outlier = False
        self._before_outlier: Located | None = None  # the last scan before a run of outlier steps
        self._outlier_ns = 0  # duration of that run
        self.step_uncertainty = StepUncertainty(config.odometry, config.tracking)
        self._transition = FloorTransition(config.tracking)

    @property
    def _parts(self) -> dict[str, Any]:
        return {
            "transition": self._transition, "step_uncertainty": self.step_uncertainty, "front_end": self.front_end,
            "odometry": self._odometry, "steps": self._steps, "frame": self._frame,
        }  # fmt: skip

    def state(self) -> dict[str, Any]:
        """See `Stateful`; with the state of its parts."""
        return {**super().state(), **{name: part.state() for name, part in self._parts.items()}}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        for name, part in self._parts.items():
            part.restore(state[name])

    @property
    def between_floors(self) -> bool:
        """Whether the robot is between two floors, on a stair or a ramp."""
        return self._transition.active

    @property
    def ground(self) -> float:
        """Height (m) of the ground under the robot above the floor, on steps or ramps."""
        return self._transition.ground

    @property
    def T_ground_map(self) -> Floats:  # noqa: N802
        """(4, 4) the levelled map of the present floor, with z = 0 at the ground under the robot."""
        return raised(self._walls.T_level_map, -self._transition.ground)

    @property
    def _walls(self) -> WallMap:
        """The walls of the present floor."""
        return self._floors.current.walls

    def prepare(self, raw: RawScan) -> PreparedScan:
        """Deskews a scan and sorts it into columns. Raises UserError for invalid `point_times`."""
        points, offset_ns = raw.points, 0
        if raw.point_times is not None:
            seconds = checked_times(raw.point_times, len(points), raw.stamp_ns)
            points, offset_ns = self._deskewed(raw.stamp_ns, points, seconds, raw.T_odom_sensor)
        columns = self.front_end.columns(points, whole=self.between_floors)
        return PreparedScan(raw.stamp_ns, offset_ns, points, columns, raw.T_odom_sensor)

    def _deskewed(self, stamp_ns: int, points: Floats, seconds: Floats, external: Floats | None) -> tuple[Floats, int]:
        """Deskews points (N, 3), measured `seconds` (N,) after the stamp, to one instant: the points, and ns after it.

        The sensor is taken to move on as in its last step. The instant is the middle of the scan: there, an error of
        the step shifts both halves of the scan in opposite directions. At the stamp it would shift the whole scan and
        feed into the next step. An `external` T_odom_sensor (4, 4) has no such feedback, and the instant is the stamp.
        """
        if self._last is None:
            return points, 0
        instant, step, interval_s = (
            float(seconds.min() + seconds.max()) / 2,
            self._steps.step,
            self._steps.interval_ns / 1e9,
        )
        if external is not None:
            instant = 0.0
            if self._frame.external:
                external_step = inverse(self._last.T_odom_sensor) @ self._in_odom_frame(external, True)
                if not self._outlier_size(external_step, stamp_ns - self._steps.stamp_ns):
                    step, interval_s = external_step, (stamp_ns - self._steps.stamp_ns) / 1e9
        if np.ptp(seconds) > _LONGEST_SWEEP * ((stamp_ns - self._steps.stamp_ns) / 1e9 + instant):
            return points, 0
        if step is not None:
            points = deskewed(points, seconds - instant, step, interval_s)
        return points, round(instant * 1e9)

    def live(self, T_map_sensor: Floats, offset_ns: int) -> Floats:
        """(4, 4) the pose of the newest scan `offset_ns` earlier, interpolated along its step."""
        if self._steps.step is None or not offset_ns:
            return T_map_sensor
        return T_map_sensor @ part_of(self._steps.step, -offset_ns / self._steps.interval_ns)

    def locate(self, prepared: PreparedScan, last_map: Floats | None) -> Located:
        """Tracks a scan. `last_map` (4, 4) is the newest T_map_sensor of the scan before it, None for the first."""
        stamp_ns, scan, external = prepared.stamp_ns + prepared.offset_ns, prepared.columns, prepared.T_odom_sensor
        interval_ns = stamp_ns - self._steps.stamp_ns
        regular, outlier = self._steps.is_regular(interval_ns), False
        external = None if external is None else self._in_odom_frame(external, True)
        if external is not None and self._last is not None:
            outlier = self._warn_of_outlier(
                self._outlier_size(inverse(self._last.T_odom_sensor) @ external, interval_ns), stamp_ns
            )
        self._steps.advance(stamp_ns)
        if last_map is None or self._last is None:
            self._walls.level_by(level_map(None, self.front_end.height))
            T_odom_sensor = (
                self._in_odom_frame(self._odometry.register(self._points(scan)), False)
                if external is None
                else external
            )
            self._last = Located(T_odom_sensor, np.eye(4))
            return self._last
        if not self._config.tracking.correct:
            T_odom_sensor, guess = self._by_odometry(scan, last_map, external)
            self._last = Located(T_odom_sensor, guess)
        else:
            self._transition.moved(last_map @ inverse(self._last.T_map_sensor))
            predicted = None
            if regular and self._steps.step is not None:
                predicted = upright_step(last_map @ self._steps.step, last_map, self._walls.T_level_map[2, :3])
            if self._transition.active:
                self._transition.begin(self.T_ground_map)
                if predicted is not None:
                    predicted = self._transition.possible(predicted, last_map, self._walls.T_level_map[2, :3])
            if external is None:
                self._last = self._without_external(scan, last_map, predicted)
            else:
                self._last = self._by_external(scan, last_map, external, predicted, outlier)
        self._steps.add(inverse(last_map) @ self._last.T_map_sensor)
        if self._config.tracking.correct:
            self._update_floor(scan)
        return self._last

    def leave_keyframe(self) -> Floats | None:
        """Makes the newest scan the next keyframe: returns the excess covariance (6, 6) of the step to it.

        Rotation first, sensor axes; None where the step is as certain as the default.
        """
        assert self._last is not None
        return self.step_uncertainty.leave((self._walls.T_level_map @ self._last.T_map_sensor)[:3, :3])

    def _update_floor(self, scan: ColumnScan) -> None:
        """Updates how the sensor is carried, and detects that a floor is left or reached."""
        assert self._last is not None
        T_map_sensor = self._last.T_map_sensor
        if not self._transition.active:
            carried = self.front_end.carried()
            left = self._transition.watch(scan, self._walls.lines, T_map_sensor, self.T_ground_map, carried)
            if left is None and not self._transition.suspected:
                self.front_end.follow(self.T_ground_map @ T_map_sensor)
            elif left is not None:
                self._last = replace(self._last, T_map_sensor=left)
            return
        T_level_map = self._walls.T_level_map
        arrival = self._transition.follow(scan, T_map_sensor, T_level_map, self.front_end.height, self._floors)
        if arrival is None:
            return
        if arrival.floor is None:
            self._floors.begin().walls.level_by(raised(T_level_map, -arrival.height))
            _log.info("a new floor begins, %+.2f m from the one that was left", arrival.height)
        else:
            self._floors.current = arrival.floor
        if arrival.drift:
            landed = inverse(T_level_map) @ raised(T_level_map @ T_map_sensor, -arrival.drift)
            self._last = replace(self._last, T_map_landed=landed)
        self._transition.end(arrival)

    def _without_external(self, scan: ColumnScan, last_map: Floats, predicted: Floats | None) -> Located:
        """Tracks from the prediction where that is certain, else from the odometry if it explains the scan as well."""
        settings = self._config.odometry
        tracked = None if predicted is None else self._align(scan, predicted)
        if tracked is not None and tracked.well_constrained and not tracked.unexpected:
            step = inverse(last_map) @ tracked.T_map_sensor
            self._add_uncertainty(
                tracked.information, settings.unconstrained_turn_error, settings.unconstrained_speed_error
            )
            followed = self._odometry.follow(lambda: self._points(scan), step)
            return Located(self._in_odom_frame(followed, False), tracked.T_map_sensor)
        T_odom_sensor, guess = self._by_odometry(scan, last_map, None)
        best = self._align(scan, guess)
        if tracked is not None:
            best = self._without_outlier(scan, best, tracked, T_odom_sensor, last_map)
            best = tracked if tracked.better_than(best) else best
        registered = turned(surfaces_of(scan.points[scan.upright]), self._walls.T_level_map @ best.T_map_sensor)
        self._add_uncertainty(
            best.information + registered, settings.unconstrained_turn_error, settings.unconstrained_speed_error
        )
        return Located(T_odom_sensor, best.T_map_sensor)

    def _without_outlier(
        self, scan: ColumnScan, best: _AlignedGuess, predicted: _AlignedGuess, T_odom_sensor: Floats, last_map: Floats
    ) -> _AlignedGuess:
        """The odometry's pose `best`, or that of a steady step where the odometry has an outlier against `predicted`.

        One scan later the odometry may have recovered, or it slipped and goes on from there; the closer one is taken.
        """
        assert self._last is not None
        up = self._walls.T_level_map[2, :3]
        if self._before_outlier is not None:
            moved = last_map @ inverse(self._last.T_map_sensor)
            before = self._before_outlier = replace(
                self._before_outlier, T_map_sensor=moved @ self._before_outlier.T_map_sensor
            )
            guess = predict(before.T_map_sensor, before.T_odom_sensor, T_odom_sensor)
            back = self._align(scan, upright_step(guess, last_map, up))
            best = min((best, back), key=lambda g: _distance(g, predicted))
        if _distance(best, predicted) > self._steps.max_error:
            steady = self._align(scan, upright_step(last_map @ self._steps.steady, last_map, up))
            if self._is_outlier(best, steady) and self._outlier_ns < _LONGEST_OUTLIER:
                self._before_outlier = self._before_outlier or Located(self._last.T_odom_sensor, last_map)
                self._outlier_ns += self._steps.interval_ns
                return steady
        self._before_outlier, self._outlier_ns = None, 0
        return best

    def _is_outlier(self, best: _AlignedGuess, steady: _AlignedGuess) -> bool:
        """Whether a step is an outlier.

        It differs implausibly from a steady one, walls do not constrain it, and the steady one explains the scan as
        well.
        """
        apart = (best.T_map_sensor - steady.T_map_sensor)[:2, 3]
        off = _distance(best, steady)
        loose = float(apart @ best.information[1:, 1:] @ apart) < self._config.tracking.firm_points * off**2
        return off > self._steps.max_error and loose and steady.share > best.share - _CLEAR_MARGIN

    def _by_external(
        self, scan: ColumnScan, last_map: Floats, external: Floats, predicted: Floats | None, outlier: bool
    ) -> Located:
        """Tracks from the pose of an external odometry.

        At an outlier step the prediction is used unless the walls confirm the step. Where steps merely deviate, a
        steady step is used for a while.
        """
        settings = self._config.odometry
        best = self._align(scan, self._by_odometry(scan, last_map, external)[1])
        rates, interval_ns = (settings.external_turn_error, settings.external_speed_error), self._steps.interval_ns
        if outlier:
            instead = self._align(scan, last_map if predicted is None else predicted)
            best, rates = best if best.better_than(instead) else instead, _OUTLIER_RATES
        elif predicted is not None and (
            self._before_outlier is not None or _plan_distance(best.T_map_sensor, predicted) > self._steps.max_error
        ):
            external_step, best = (
                best,
                self._without_outlier(scan, best, self._align(scan, predicted), external, last_map),
            )
            rates = rates[0], max(rates[1], 1e9 * _distance(external_step, best) / interval_ns)
        self._add_uncertainty(best.information, *rates)
        return Located(external, best.T_map_sensor)

    def _add_uncertainty(self, information: Floats, turn: float, speed: float) -> None:
        """Adds a scan to the step uncertainty; `turn` (rad/s) and `speed` (m/s) are the step's unconstrained errors."""
        seconds = self._steps.interval_ns / 1e9
        self.step_uncertainty.add(information, turn * seconds, speed * seconds)

    def _outlier_size(self, step: Floats, interval_ns: int) -> tuple[float, float] | None:
        """The size (m, rad) of an outlier step (4, 4) of an external odometry; None where the step is plausible.

        A step is an outlier if it differs too much from the one before it, or is too long where that one is unknown.
        """
        settings, seconds = self._config.odometry, interval_ns / 1e9
        farthest, widest = settings.outlier_distance, settings.outlier_angle
        if self._steps.step is not None and self._steps.is_regular(interval_ns):
            step = inverse(self._steps.step) @ step
        else:  # the speed is not known
            farthest, widest = max(settings.max_step, _FAST * seconds), max(settings.max_turn, _TURNING * seconds)
        metres, radians = float(np.linalg.norm(step[:3, 3])), angle_of(step)
        return None if metres < farthest and radians < widest else (metres, radians)

    def _warn_of_outlier(self, outlier: tuple[float, float] | None, stamp_ns: int) -> bool:
        """Whether there is an outlier; warns of the first one."""
        if outlier is not None and not self._warned_of_outlier:
            _log.warning(
                "the external odometry has an outlier of %.2f m and %.0f degrees at %.3f s; such steps are ignored "
                "(reported once)", outlier[0], np.degrees(outlier[1]), stamp_ns / 1e9,
            )  # fmt: skip
            self._warned_of_outlier = True
        return outlier is not None

    def _by_odometry(self, scan: ColumnScan, last_map: Floats, external: Floats | None) -> tuple[Floats, Floats]:
        """T_odom_sensor (4, 4), `external` or registered now, and T_map_sensor (4, 4) predicted from it."""
        assert self._last is not None
        if external is not None:
            return external, predict(last_map, self._last.T_odom_sensor, external)
        T_odom_sensor = self._in_odom_frame(self._odometry.register(self._points(scan), self._steps.step), False)
        guess = predict(last_map, self._last.T_odom_sensor, T_odom_sensor)
        return T_odom_sensor, upright_step(guess, last_map, self._walls.T_level_map[2, :3])

    def _in_odom_frame(self, T_source_sensor: Floats, is_external: bool) -> Floats:
        """T_odom_sensor (4, 4) from the pose (4, 4) of an odometry in its own frame."""
        last_odom = None if self._last is None else self._last.T_odom_sensor
        return self._frame.to_odom(T_source_sensor, is_external, last_odom, self._steps.step)

    def _points(self, scan: ColumnScan) -> Floats:
        """(N, 3) the points of a scan that the odometry uses."""
        return scan.points[scan.upright] if self._odometry.upright_only else scan.points

    def _align(self, scan: ColumnScan, guess: Floats) -> _AlignedGuess:
        """Aligns a guess (4, 4) with walls and floor; on a stair, with walls and level surfaces."""
        settings, walls = self._config.tracking, self._walls.lines
        if self._transition.active:
            tracked = self._transition.align(scan, walls, self.T_ground_map @ guess)
            tracked = replace(tracked, T=squared_up(inverse(self.T_ground_map) @ tracked.T))
        else:
            tracked = align(scan, walls, guess, self.T_ground_map, self.front_end.carried(), self._config)
        missed = inverse(guess) @ tracked.T
        turn = angle_of(missed)
        return _AlignedGuess(
            tracked.T, tracked.share,
            tracked.share > settings.firm_share and tracked.held > settings.firm_points,
            bool(np.linalg.norm(missed[:3, 3]) > settings.surprise_distance or turn > settings.surprise_angle),
            tracked.information,
        )  # fmt: skip


def _distance(one: _AlignedGuess, other: _AlignedGuess) -> float:
    """Distance (m) in plan view."""
    return _plan_distance(one.T_map_sensor, other.T_map_sensor)


def _plan_distance(one: Floats, other: Floats) -> float:
    """Distance (m) in plan view between two poses (4, 4)."""
    return float(np.linalg.norm((one - other)[:2, 3]))
