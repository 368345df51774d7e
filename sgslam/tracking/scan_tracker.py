"""Where each scan was taken: foretold by the step before it and held to the walls and the floor; the odometry is asked
where these leave something open."""

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.geometry.frames import angle_of, inverse, level_map, raised, squared_up
from sgslam.mapping.floors import Floors
from sgslam.mapping.wall_map import WallMap
from sgslam.odometry import Odometry
from sgslam.perception.column_scan import ColumnScan
from sgslam.perception.deskew import checked_times, deskewed, part_of
from sgslam.perception.scan_checks import RawScan
from sgslam.serialization.state_tree import Stateful
from sgslam.tracking.floor_transition import Climb
from sgslam.tracking.front_end import FrontEnd, align
from sgslam.tracking.motion import predict, upright_step
from sgslam.tracking.step_uncertainty import Slack, surfaces_of, turned

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_LONGEST_SWEEP = 1.5  # intervals between scans; what takes longer is of another unit
_LEAP = 5.0, 10.0  # rad/s and m/s by which a step is uncertain where a given odometry leaps
_FAST, _TURNING = 5.0, 3.0  # m/s and rad/s, the most that anything carries a sensor at indoors
_CLEARLY = 0.05  # of a scan's points by which one pose explains more than another
_PACE = 0.3  # of a step goes into the mean of the last ones
_LURCH = 0.05, 5.0  # m and m/s2 by which a step may differ from a steady one where no walls hold it
_BRISK = 2.5  # m/s; scans that seem to come faster are some of a drive, or their stamps are not theirs
_LONGEST_LURCH = 10**9  # ns; what lasts is no slip: the robot was stopped or pushed


@dataclass(frozen=True)
class Located:
    """T_odom_sensor and T_map_sensor (4, 4) of one scan; `T_map_landed` where it has come back to a floor that was
    known, which shows how far heights have drifted: T_map_sensor without that."""

    T_odom_sensor: Floats
    T_map_sensor: Floats
    T_map_landed: Floats | None = None


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """A scan with its points (N, 3) as of one instant, `offset_ns` after its stamp, and sorted into columns."""

    stamp_ns: int
    offset_ns: int
    points: Floats
    columns: ColumnScan
    T_odom_sensor: Floats | None


@dataclass(frozen=True)
class _Guessed:
    """T_map_sensor after the correction of a guess, the `share` of the points that it explains, whether walls hold it
    in all directions, and whether it lies far from the guess."""

    T_map_sensor: Floats
    share: float
    firm: bool
    surprising: bool
    information: Floats  # (3, 3) of yaw, x and y in level axes, from walls

    def better_than(self, other: "_Guessed") -> bool:
        return self.firm > other.firm or (self.firm == other.firm and self.share > other.share + _CLEARLY)


class ScanTracker(Stateful):
    """Locates scan after scan.

    A robot moves nearly as it did a scan ago, which indoors foretells more exactly than KISS-ICP does, where few rings
    see much of a wall. A scan that was foretold, and that the walls then hold firmly and close by, needs no odometry.
    """

    _STATE = (
        "_last", "_step", "_stamp_ns", "_interval_ns", "_leapt", "_external", "_T_odom_source", "_pace", "_before",
        "_lurches_ns",
    )  # fmt: skip

    def __init__(self, config: Config, odometry: Odometry, floors: Floors) -> None:
        self._config, self._odometry, self._floors = config, odometry, floors
        self.front_end = FrontEnd(config)
        self._last: Located | None = None
        self._step: Floats | None = None  # T_last_sensor as it was found
        self._stamp_ns, self._interval_ns = 0, 0
        self._leapt = False  # a given odometry, at some time
        self._pace = np.zeros(3)  # m in the last steps, their mean, sensor frame
        self._before: Located | None = None  # the last scan before the own one had steps that no robot makes
        self._lurches_ns = 0  # for so long it has had them
        self._external: bool | None = None  # whether the last T_odom_sensor was given
        self._T_odom_source: Floats | None = None  # the frame of those who give it now; None where it is their own
        self.slack = Slack(config.odometry, config.tracking)
        self._climb = Climb(config.tracking)

    @property
    def _parts(self) -> dict[str, Any]:
        return {
            "climb": self._climb, "slack": self.slack, "front_end": self.front_end, "odometry": self._odometry,
        }  # fmt: skip

    def state(self) -> dict[str, Any]:
        """See `Stateful`; with what its parts know."""
        return {**super().state(), **{name: part.state() for name, part in self._parts.items()}}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        for name, part in self._parts.items():
            part.restore(state[name])

    @property
    def climbing(self) -> bool:
        """Whether the robot is on no floor."""
        return self._climb.active

    @property
    def ground(self) -> float:
        """Metres above the floor at which the robot goes, where that has steps or ramps."""
        return self._climb.ground

    @property
    def T_ground_map(self) -> Floats:  # noqa: N802
        """(4, 4) the levelled map of the floor that the robot is on, with z from the ground on which it goes."""
        return raised(self._walls.T_level_map, -self._climb.ground)

    @property
    def _walls(self) -> WallMap:
        """Of the floor that the robot is on."""
        return self._floors.current.walls

    def prepare(self, raw: RawScan) -> PreparedScan:
        """Deskews a scan and sorts it into columns. Raises UserError for times of points that are none."""
        points, offset_ns = raw.points, 0
        if raw.point_times is not None:
            seconds = checked_times(raw.point_times, len(points), raw.stamp_ns)
            points, offset_ns = self._deskewed(raw.stamp_ns, points, seconds, raw.T_odom_sensor)
        columns = self.front_end.columns(points, whole=self.climbing)
        return PreparedScan(raw.stamp_ns, offset_ns, points, columns, raw.T_odom_sensor)

    def _deskewed(self, stamp_ns: int, points: Floats, seconds: Floats, given: Floats | None) -> tuple[Floats, int]:
        """(N, 3) a scan's points as if they had been measured in one instant, and that instant, in ns after the stamp;
        `seconds` (N,) after the stamp they were measured. The sensor is taken to move on as in its last step.

        The instant is the middle of the scan, where an error of that step turns and moves the points on both sides of
        it against each other; at the stamp it would move the whole scan, and be fed into the next step. With `given`
        T_odom_sensor at the stamp nothing is fed back, and the instant is the stamp.
        """
        if self._last is None:
            return points, 0
        instant, step, interval_s = float(seconds.min() + seconds.max()) / 2, self._step, self._interval_ns / 1e9
        if given is not None:
            instant = 0.0
            if self._external:
                told = inverse(self._last.T_odom_sensor) @ self._shown(given, True)
                if not self._leap(told, stamp_ns - self._stamp_ns):
                    step, interval_s = told, (stamp_ns - self._stamp_ns) / 1e9
        if np.ptp(seconds) > _LONGEST_SWEEP * ((stamp_ns - self._stamp_ns) / 1e9 + instant):
            return points, 0
        if step is not None:
            points = deskewed(points, seconds - instant, step, interval_s)
        return points, round(instant * 1e9)

    def live(self, T_map_sensor: Floats, offset_ns: int) -> Floats:
        """(4, 4) the pose of the newest scan `offset_ns` earlier, by its step."""
        if self._step is None or not offset_ns:
            return T_map_sensor
        return T_map_sensor @ part_of(self._step, -offset_ns / self._interval_ns)

    def locate(self, prepared: PreparedScan, last_map: Floats | None) -> Located:
        """Locates a scan. `last_map` (4, 4) is T_map_sensor of the scan before it by the newest estimates, None for the
        first scan."""
        stamp_ns, scan, given = prepared.stamp_ns + prepared.offset_ns, prepared.columns, prepared.T_odom_sensor
        interval_ns = stamp_ns - self._stamp_ns
        regular, leap = self._is_regular(interval_ns), False
        given = None if given is None else self._shown(given, True)
        if given is not None and self._last is not None:
            leap = self._told(self._leap(inverse(self._last.T_odom_sensor) @ given, interval_ns), stamp_ns)
        self._stamp_ns, self._interval_ns = stamp_ns, interval_ns
        if last_map is None or self._last is None:
            self._walls.level_by(level_map(None, self.front_end.height))
            T_odom_sensor = self._shown(self._odometry.register(self._points(scan)), False) if given is None else given
            self._last = Located(T_odom_sensor, np.eye(4))
            return self._last
        if not self._config.tracking.correct:
            T_odom_sensor, guess = self._ask(scan, last_map, given)
            self._last = Located(T_odom_sensor, guess)
        else:
            self._climb.moved(last_map @ inverse(self._last.T_map_sensor))
            foretold = None
            if regular and self._step is not None:
                foretold = upright_step(last_map @ self._step, last_map, self._walls.T_level_map[2, :3])
            if self._climb.active:
                self._climb.begin(self.T_ground_map)
                if foretold is not None:
                    foretold = self._climb.possible(foretold, last_map, self._walls.T_level_map[2, :3])
            if given is None:
                self._last = self._best(scan, last_map, foretold)
            else:
                self._last = self._by_given(scan, last_map, given, foretold, leap)
        started, self._step = self._step is not None, inverse(last_map) @ self._last.T_map_sensor
        self._pace = self._pace + (_PACE if started else 1.0) * (self._step[:3, 3] - self._pace)
        if self._config.tracking.correct:
            self._follow(scan)
        return self._last

    def leave_keyframe(self) -> Floats | None:
        """(6, 6) the covariance of the step from the last keyframe to the newest scan, which is the next one, beyond
        what every step has; None where there is nothing beyond."""
        assert self._last is not None
        return self.slack.leave((self._walls.T_level_map @ self._last.T_map_sensor)[:3, :3])

    def _follow(self, scan: ColumnScan) -> None:
        """Takes note of how the sensor is carried, and of floors that are left or reached."""
        assert self._last is not None
        T_map_sensor = self._last.T_map_sensor
        if not self._climb.active:
            carried = self.front_end.carried()
            left = self._climb.watch(scan, self._walls.lines, T_map_sensor, self.T_ground_map, carried)
            if left is None and not self._climb.suspected:
                self.front_end.follow(self.T_ground_map @ T_map_sensor)
            elif left is not None:
                self._last = replace(self._last, T_map_sensor=left)
            return
        T_level_map = self._walls.T_level_map
        arrival = self._climb.follow(scan, T_map_sensor, T_level_map, self.front_end.height, self._floors)
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
        self._climb.end(arrival)

    def _best(self, scan: ColumnScan, last_map: Floats, foretold: Floats | None) -> Located:
        """By what was foretold where that is certain, else by the odometry, if it explains the scan as well."""
        settings = self._config.odometry
        tracked = None if foretold is None else self._align(scan, foretold)
        if tracked is not None and tracked.firm and not tracked.surprising:
            step = inverse(last_map) @ tracked.T_map_sensor
            self._loosen(tracked.information, settings.unheld_turn, settings.unheld_speed)
            followed = self._odometry.follow(lambda: self._points(scan), step)
            return Located(self._shown(followed, False), tracked.T_map_sensor)
        T_odom_sensor, guess = self._ask(scan, last_map, None)
        best = self._align(scan, guess)
        if tracked is not None:
            best = self._without_lurch(scan, best, tracked, T_odom_sensor, last_map)
            best = tracked if tracked.better_than(best) else best
        registered = turned(surfaces_of(scan.points[scan.upright]), self._walls.T_level_map @ best.T_map_sensor)
        self._loosen(best.information + registered, settings.unheld_turn, settings.unheld_speed)
        return Located(T_odom_sensor, best.T_map_sensor)

    def _without_lurch(
        self, scan: ColumnScan, best: _Guessed, foretold: _Guessed, T_odom_sensor: Floats, last_map: Floats
    ) -> _Guessed:
        """What the odometry says, or a steady step where that lurches away from what was `foretold`.

        A scan later it may be back where it should be, or it slipped and goes on from there: either is believed.
        """
        assert self._last is not None and self._step is not None
        up = self._walls.T_level_map[2, :3]
        if self._before is not None:
            moved = last_map @ inverse(self._last.T_map_sensor)
            before = self._before = replace(self._before, T_map_sensor=moved @ self._before.T_map_sensor)
            guess = predict(before.T_map_sensor, before.T_odom_sensor, T_odom_sensor)
            back = self._align(scan, upright_step(guess, last_map, up))
            best = min((best, back), key=lambda g: _between(g, foretold))
        if _between(best, foretold) > self._lurch:
            step = self._step.copy()
            step[:3, 3] = self._pace
            steady = self._align(scan, upright_step(last_map @ step, last_map, up))
            if self._lurches(best, steady) and self._lurches_ns < _LONGEST_LURCH:
                self._before = self._before or Located(self._last.T_odom_sensor, last_map)
                self._lurches_ns += self._interval_ns
                return steady
        self._before, self._lurches_ns = None, 0
        return best

    @property
    def _lurch(self) -> float:
        """Metres by which no robot's step differs from a steady one."""
        seconds = self._interval_ns / 1e9
        if np.linalg.norm(self._pace) > _BRISK * seconds:
            return np.inf
        return _LURCH[0] + _LURCH[1] * seconds**2

    def _lurches(self, best: _Guessed, steady: _Guessed) -> bool:
        """Whether a step differs from a steady one as no robot's does, where walls do not hold it, though the steady
        one explains the scan as well."""
        apart = (best.T_map_sensor - steady.T_map_sensor)[:2, 3]
        off = _between(best, steady)
        loose = float(apart @ best.information[1:, 1:] @ apart) < self._config.tracking.firm_points * off**2
        return off > self._lurch and loose and steady.share > best.share - _CLEARLY

    def _by_given(
        self, scan: ColumnScan, last_map: Floats, given: Floats, foretold: Floats | None, leap: bool
    ) -> Located:
        """By somebody else's odometry; where that leaps, by what was foretold, unless the walls bear the leap out;
        where it lurches, by a steady step for a while."""
        settings = self._config.odometry
        best = self._align(scan, self._ask(scan, last_map, given)[1])
        rates, interval_ns = (settings.given_turn, settings.given_speed), self._interval_ns
        if leap:
            instead = self._align(scan, last_map if foretold is None else foretold)
            best, rates = best if best.better_than(instead) else instead, _LEAP
        elif foretold is not None and (self._before is not None or _apart(best.T_map_sensor, foretold) > self._lurch):
            told, best = best, self._without_lurch(scan, best, self._align(scan, foretold), given, last_map)
            rates = rates[0], max(rates[1], 1e9 * _between(told, best) / interval_ns)
        self._loosen(best.information, *rates)
        return Located(given, best.T_map_sensor)

    def _loosen(self, information: Floats, turn: float, speed: float) -> None:
        """One more scan since the keyframe, whose step may be wrong by so many rad/s and m/s where nothing holds it."""
        seconds = self._interval_ns / 1e9
        self.slack.add(information, turn * seconds, speed * seconds)

    def _leap(self, step: Floats, interval_ns: int) -> tuple[float, float] | None:
        """The metres and radians of a given step (4, 4) that no robot makes, or by which it differs from the one before
        it as no robot's does; None where it is a step like others."""
        settings, seconds = self._config.odometry, interval_ns / 1e9
        farthest, widest = settings.leap_distance, settings.leap_angle
        if self._step is not None and self._is_regular(interval_ns):
            step = inverse(self._step) @ step
        else:  # nobody knows how fast it went
            farthest, widest = max(settings.max_step, _FAST * seconds), max(settings.max_turn, _TURNING * seconds)
        metres, radians = float(np.linalg.norm(step[:3, 3])), angle_of(step)
        return None if metres < farthest and radians < widest else (metres, radians)

    def _told(self, leap: tuple[float, float] | None, stamp_ns: int) -> bool:
        """Whether there is a leap; the first is told."""
        if leap is not None and not self._leapt:
            _log.warning(
                "the odometry that is given leaps, by %.2f m and %.0f degrees at %.3f s; such steps are not believed "
                "(told once)", leap[0], np.degrees(leap[1]), stamp_ns / 1e9,
            )  # fmt: skip
            self._leapt = True
        return leap is not None

    def _ask(self, scan: ColumnScan, last_map: Floats, given: Floats | None) -> tuple[Floats, Floats]:
        """T_odom_sensor, and T_map_sensor by it."""
        assert self._last is not None
        if given is not None:
            return given, predict(last_map, self._last.T_odom_sensor, given)
        T_odom_sensor = self._shown(self._odometry.register(self._points(scan), self._step), False)
        guess = predict(last_map, self._last.T_odom_sensor, T_odom_sensor)
        return T_odom_sensor, upright_step(guess, last_map, self._walls.T_level_map[2, :3])

    def _shown(self, T_source_sensor: Floats, external: bool) -> Floats:
        """T_odom_sensor. Where another source begins to tell (poses are given for some scans only), its frame is laid
        so that the sensor goes on as before."""
        if external != self._external and self._last is not None:
            step = np.eye(4) if self._step is None else self._step
            self._T_odom_source = self._last.T_odom_sensor @ step @ inverse(T_source_sensor)
        self._external = external
        return T_source_sensor if self._T_odom_source is None else self._T_odom_source @ T_source_sensor

    def _points(self, scan: ColumnScan) -> Floats:
        """(N, 3) what the odometry is given of a scan."""
        return scan.points[scan.upright] if self._odometry.upright_only else scan.points

    def _align(self, scan: ColumnScan, guess: Floats) -> _Guessed:
        """Corrected by walls and floor, on a stair by walls and what is level there."""
        settings, walls = self._config.tracking, self._walls.lines
        if self._climb.active:
            tracked = self._climb.align(scan, walls, self.T_ground_map @ guess)
            tracked = replace(tracked, T=squared_up(inverse(self.T_ground_map) @ tracked.T))
        else:
            tracked = align(scan, walls, guess, self.T_ground_map, self.front_end.carried(), self._config)
        missed = inverse(guess) @ tracked.T
        turn = angle_of(missed)
        return _Guessed(
            tracked.T, tracked.share,
            tracked.share > settings.firm_share and tracked.held > settings.firm_points,
            bool(np.linalg.norm(missed[:3, 3]) > settings.surprise_distance or turn > settings.surprise_angle),
            tracked.information,
        )  # fmt: skip

    def _is_regular(self, interval_ns: int) -> bool:
        """Whether a scan comes after the last one as that one after the one before it."""
        return 2 * self._interval_ns < 3 * interval_ns < 4.5 * self._interval_ns


def _between(one: _Guessed, other: _Guessed) -> float:
    """Metres in plan view."""
    return _apart(one.T_map_sensor, other.T_map_sensor)


def _apart(one: Floats, other: Floats) -> float:
    """Metres in plan view between two poses (4, 4)."""
    return float(np.linalg.norm((one - other)[:2, 3]))
