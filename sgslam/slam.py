"""The algorithm: from scans to an S-graph, matched with and anchored to a plan, and a trajectory in the BIM frame."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, UserError
from data.control import ControlPoint
from data.plans import Bim
from matching.result import AnyMatcher
from sgslam.config import Config, TrackingSettings
from sgslam.mapping import KeyframeClouds
from sgslam.odometry import Odometry
from sgslam.registration.motion import deskewed, pose_at, pose_of_points
from sgslam.registration.smoothing import smoothed
from sgslam.result import Result
from sgslam.result.finishing import assemble_result
from sgslam.serialization import pack, unpack
from sgslam.session import ActiveMap, PriorMap, Session, Stopwatch
from sgslam.session.run_state import RunState
from sgslam.session.scan_poses import interpolated
from sgslam.tracking import RunTracker, TrackerNotes
from sgslam.types import Health, Motion, TrackedScan, Update

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_WAY_UP = "it is assumed that the sensor was not upside down; if it was, give --mount 180,0,0"


class SceneGraphSlam(RunState):
    """SLAM with an S-graph, anchored to a building's A-graph if one is given.

    `bim` is the result of `load_bim`, or an A-graph in the BIM frame, without the model's elements; `matcher` is any
    object with `.match(s, a)`; `odometry` is any `Odometry`, whose poses are given ones (default: that of the settings,
    by default our own registration in continuous time); `clouds` stores the keyframes' points (default: an anonymous
    temporary file). `prior` is the map of earlier runs: the run is relocalised in it, wherever it starts, and merged
    into it at the end; all results are then in that map's frame. `storey` is the name or id of the A-graph's floor on
    which the run begins; raises UserError if it does not exist. `control` are surveyed points that the sensor stood at
    or saw, to which a finished map is fitted too, if it is anchored. Scans must be added in the order of their stamps.
    """

    def __init__(
        self,
        bim: SceneGraph | Bim | None = None,
        matcher: AnyMatcher | None = None,
        config: Config | None = None,
        odometry: Odometry | None = None,
        clouds: KeyframeClouds | None = None,
        prior: PriorMap | None = None,
        storey: str | None = None,
        control: Sequence[ControlPoint] = (),
    ) -> None:
        config = config or Config()
        a_graph = bim.graph if isinstance(bim, Bim) else bim
        self._plan_file = bim.path if isinstance(bim, Bim) else None
        self._control = control
        clouds = KeyframeClouds(None, config.clouds.keyframe_voxel) if clouds is None else clouds
        self._config, self._stopwatch = config, Stopwatch()
        self._tracking = RunTracker(config, odometry)
        self._session = Session(config, a_graph, matcher, prior, storey)
        self._clouds, self._map = clouds, self._session.begin(clouds, self._stopwatch)
        self._tracked: list[TrackedScan] = []  # scans that are not in the map yet
        self._elsewhere: TrackerNotes | None = None  # of a tracker elsewhere

    def add_scan(
        self,
        stamp_ns: int,
        points: NDArray[np.floating[Any]],
        point_times: Floats | None = None,
        T_odom_sensor: Floats | None = None,
        step_covariance: Floats | None = None,
    ) -> Update:
        """Adds one scan: its stamp in nanoseconds and its points (N, 3) in metres, in the sensor frame. They may also
        be a point cloud of Open3D.

        `point_times` (N,) are the seconds after the stamp at which the points were measured; without them the setting
        `tracking.point_times` counts. `T_odom_sensor` (4, 4), if given, replaces registration of this scan, or
        is an additional measurement for it, depending on the setting `odometry.given`: one that replaces must be given
        for all scans or for none, measured ones may be given for some. `step_covariance` (6, 6) is that of its motion
        since the previous scan, rotation (rad) first, in the sensor's axes (default: from the settings).
        Raises UserError for stamps that do not increase, points or times that are not finite, a `T_odom_sensor` that is
        not a rigid motion or is given for some scans only where it replaces the odometry, and a `step_covariance` that
        is not a covariance; the run continues without that scan, which may come again corrected.

        In the first seconds, scans wait until the direction of gravity is known; until then, the returned pose is
        provisional. Lost scans wait until a scan fits the map again. If they fit one another for some time but not the
        map, the sensor was carried elsewhere: a new map begins, until it is relocalised in the old map or in the
        building.
        """
        with self._stopwatch("odometry"):  # no scan until gravity is known
            self._tracked += self._tracking.track(stamp_ns, points, point_times, T_odom_sensor, step_covariance)
        self._take_all()
        return self._update(int(stamp_ns))

    def add_tracked(self, scan: TrackedScan, notes: TrackerNotes) -> None:
        """Adds a scan that a `RunTracker` elsewhere has tracked, instead of `add_scan`: all of a run's scans, in their
        order, give the same map. `notes` are the tracker's now."""
        self._elsewhere = notes
        self._add(scan)

    def add_imu(self, stamp_ns: int | NDArray[np.int64], gyro: Floats, accel: Floats) -> None:
        """Adds an IMU sample, by the scans' clock: angular velocity (3,) in rad/s and specific force (3,) in m/s2 or g,
        in the IMU's axes (`imu.rotation` turns them into the sensor's); or several: stamps (N,) and values (N, 3).

        Add the samples up to a scan's end before the scan: they predict how the sensor turns during it. Samples that
        are late by less than a scan still count when the next scan is registered together with this one. They must
        begin with the scans to show the vertical. Raises UserError for stamps that do not increase and values that are
        not finite; the run continues without these samples.
        """
        self._tracking.motion.add_imu(stamp_ns, gyro, accel)

    def _take_all(self) -> None:
        """Adds all tracked scans; where one fails, by a matcher for instance, the others are added with the next."""
        while self._tracked:
            self._add(self._tracked.pop(0))

    def _add(self, scan: TrackedScan) -> None:
        """Adds a tracked scan to the map."""
        if scan.begins_elsewhere:
            why = "the sensor was carried elsewhere, or was lost; a new map begins"
            _log.warning("scan at %.2f s: %s", scan.raw.stamp_ns / 1e9, why)
            self._map = self._session.split(self._map)
        current = self._map
        if not current.add_scan(scan):  # no keyframe is due
            return
        # walls and levels are extracted from all points of a keyframe
        current.add_keyframe(deskewed(scan.registration, scan.raw.points))
        if current.has_grown:
            current.update()  # matches and anchors, optimises, closes loops, segments rooms

    def _update(self, stamp_ns: int) -> Update:
        keyframes, T_bim_map = len(self._map.backend.keyframes), self.T_bim_map
        if (waiting := self._tracking.waiting) is not None:  # in a frame that no map is in yet
            return Update(stamp_ns, waiting, keyframes, False, None, None)
        health: Health = "lost"
        if (held := self._tracking.held) is not None:
            T_map_sensor = self._map.T_map_odom @ held.T_odom_sensor
        else:
            T_map_sensor, health = self._map.scans[-1].T_map_sensor, self._map.scans[-1].health
        T_bim_sensor = None if T_bim_map is None else T_bim_map @ T_map_sensor
        return Update(stamp_ns, T_map_sensor, keyframes, self.anchored, T_bim_sensor, health)

    def finish(self, second_pass: bool = False) -> Result:
        """Matches and optimises a last time, and returns the result. Raises UserError if no scan was added.

        A `second_pass` registers all scans to the final map, so that each pose also uses what was seen later. It needs
        scans that follow one another (`ScanSource.is_dense`), and a run in one part, without a prior map and without an
        IMU. If the map is no longer anchored after it, the result of the first pass is returned.
        """
        return replace(self._finish(second_pass), plan_file=self._plan_file, slam=self)

    def _finish(self, second_pass: bool) -> Result:
        self._tracked += self._tracking.release()
        self._take_all()
        if not self._map.scans:
            raise UserError("no scan was added, so there is no result; call add_scan first")
        relocalisation = self._session.finish(self._map)
        session, notes = self._session, self._elsewhere or self._tracking.notes
        single, again = None, False
        if second_pass and session.prior is None and not session.unplaced and not notes.has_imu:
            single = pack(self._map, self._config, **self._given) if self.anchored else None
            again = _pass_again(self._map, self._config.tracking)
        check = self._map.refine(self._control)
        advice = list(notes.advice)
        if not self.anchored and notes.is_way_up_assumed:  # a plan does not fit a map that is upside down
            advice.append(_WAY_UP)
            _log.warning("%s", _WAY_UP)
        if lacking := len(self._control) - len(check.control):
            unused = "the map is not anchored" if not self.anchored else "no scan is near their times"
            advice.append(f"{lacking} of {len(self._control)} control points are not used: {unused}")
            _log.warning("%s", advice[-1])
        finished = session.bim, session.unplaced, relocalisation, self._config, advice
        result = assemble_result(self._map, *finished, again, check)
        if single is None or not again or result.anchored:
            return result
        _log.warning("the second pass is left out: after it, %s", result.reason)
        self._map = unpack(single, self._config, **self._given)
        self._map.complete()
        check = self._map.refine(self._control)
        return assemble_result(self._map, *finished, passed_again=False, check=check)


def _pass_again(final: ActiveMap, settings: TrackingSettings) -> bool:
    """Registers all scans of a map again, and estimates the map with the motion found; returns whether it did."""
    with final.stopwatch("smoothing"):
        stamps = np.array([scan.stamp_ns for scan in final.scans])
        if len(final.points) != len(stamps) or len(stamps) < 3:
            _log.warning("no second pass: the points of %d of %d scans are there", len(final.points), len(stamps))
            return False
        at = (stamps - stamps[0]) / 1e9
        again = [own.later(second) for own, second in zip(final.points.read(), at, strict=True)]
        start = Motion(at, interpolated(final.scans, final.backend.poses))
        is_known = np.array([scan.health != "lost" for scan in final.scans])
        _log.info("second pass: all %d scans are registered again", len(stamps))
        motion = smoothed(again, start, is_known, settings)
        poses = np.stack([pose_at(motion, second) for second in at])
        each = zip(final.scans, again, at, strict=True)
        of_points = [pose_of_points(own, scan.motion.later(second), motion) for scan, own, second in each]
        final.take_tracked(poses, np.stack(of_points))
    final.complete()
    return True
