"""Scans with the poses that another SLAM system found for them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans.scan import Scan, ScanSource
from data.trajectory import Trajectory
from data.trajectory.stamps import NOTE_INDICES, NS, SCAN_PERIOD_NS, ns_to_seconds
from data.trajectory.trajectory import PoseList

Floats = NDArray[np.float64]
_GAP_NS = NS  # longest gap between two poses that is interpolated
_NEAR_NS = NS // 10  # from a pose, within which a scan has one beside a longer gap
_SAME_NS = NS // 20  # by which the stamps of scans and poses may differ where one belongs to the other
_SPEED = 1.0  # m/s, at which poses without stamps are taken to follow one another
_DENSE_NS = NS // 2  # median interval up to which poses show how the sensor moved during a scan


class PosedScans(ScanSource):
    """Scans with T_odom_sensor: as many as poses, one for each in order, or joined to them by their stamps.

    By stamps, poses are interpolated over up to a second; scans without a pose are left out, and a remark says how
    many. The times of points count only where poses are at most half a second apart: clouds of keyframes are taken as
    undistorted. There, poses that hold at the ends of scans are taken to hold as long after the stamps as the first
    scan lasts.
    """

    given: Trajectory

    def __init__(self, scans: ScanSource, poses: PoseList, name: str) -> None:
        """`name` is what holds the poses, for messages. Raises UserError where scans and poses do not belong
        together."""
        super().__init__()
        poses = _without_numbers(scans, poses)
        self._scans, self._name_of_poses, self._steps = scans, name, poses.step_covariances
        self.path, self.stamped = scans.path, scans.stamped
        self._in_order = _is_one_each(scans, poses)
        if not self._in_order and (poses.stamps_ns is None or len(poses.poses) < 2):
            raise UserError(
                f"{name}: {len(poses.poses)} poses for the {len(scans)} scans in {scans.path}; give one pose per scan, "
                "or stamps by the scans' clock"
            )
        self.note = None if self._in_order and poses.stamps_ns is not None else scans.note
        stamps = self._stamps(poses)
        self.is_dense = bool(np.median(np.diff(stamps), axis=0) <= _DENSE_NS)
        late_ns = _duration_ns(scans) if poses.at_ends and self.is_dense else 0
        self.given = Trajectory(stamps + late_ns, poses.poses)
        self._poses_in_order = self.given.at(stamps) if late_ns else self.given.poses
        self.stamps_ns = np.array(stamps) if self._in_order else self._covered_stamps()

    def _stamps(self, poses: PoseList) -> NDArray[np.int64]:
        """(N,) the poses' own stamps, else the scans', else those of a steady walk."""
        if poses.stamps_ns is not None:
            return poses.stamps_ns
        if self._scans.stamps_ns is not None and self._scans.note != NOTE_INDICES:
            return self._scans.stamps_ns
        if self._scans.stamps_ns is None:
            raise UserError(f"{self._name_of_poses}: poses have no stamps; give --times, in seconds, one per line")
        self.note = f"neither poses nor scans have stamps; a sensor speed of {_SPEED:g} m/s is assumed"
        return walking_stamps(poses.poses)

    def _covered_stamps(self) -> NDArray[np.int64] | None:
        """(M,) the stamps of the scans that have a pose. Raises UserError if none has."""
        stamps = self._scans.stamps_ns
        if stamps is None:
            return None
        kept = np.array(stamps[self._covered(stamps)])
        if not len(kept):
            own = self.given.stamps_ns
            raise UserError(
                f"{self._name_of_poses}: covers {ns_to_seconds(own[0])} to {ns_to_seconds(own[-1])} s, the scans in "
                f"{self.path} {ns_to_seconds(stamps[0])} to {ns_to_seconds(stamps[-1])} s; give poses by their clock"
            )
        return kept

    def _covered(self, stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(M,) whether there is a pose for each stamp (M,)."""
        own = self.given.stamps_ns
        after = np.clip(np.searchsorted(own, stamps), 1, len(own) - 1)
        nearest = np.minimum(np.abs(stamps - own[after - 1]), np.abs(own[after] - stamps))
        between = (stamps >= own[0]) & (stamps <= own[-1]) & (own[after] - own[after - 1] <= _GAP_NS)
        return np.asarray(between | (nearest <= _NEAR_NS))

    def __len__(self) -> int:
        """The number of scans, with a pose or without."""
        return len(self._scans)

    def __iter__(self) -> Iterator[Scan]:
        """Yields the usable scans that have a pose."""
        self.remarks, without = [], 0
        for scan in self._scans:
            self.skipped = self._scans.skipped
            placed = self._placed(scan)
            without += placed is None
            if placed is not None:
                yield placed
        self.skipped, self.remarks = self._scans.skipped, list(self._scans.remarks)
        if not (self.is_dense or self._in_order):
            self.remarks.append(
                f"the poses of {self._name_of_poses} are more than {_DENSE_NS / 1e9:g} s apart and were taken as they "
                "are; give all poses, or use sgslam run, which registers the scans and is many times more accurate"
            )
        if without:
            self.remarks.append(
                f"{without} of {len(self)} scans have no pose in {self._name_of_poses} and were left out"
            )

    def _placed(self, scan: Scan) -> Scan | None:
        times = scan.point_times if self.is_dense else None
        if self._in_order:
            assert self.stamps_ns is not None
            stamp, pose = int(self.stamps_ns[scan.index]), self._poses_in_order[scan.index].copy()
            step = None if self._steps is None else self._steps[scan.index]
            return replace(scan, stamp_ns=stamp, T_odom_sensor=pose, point_times=times, step_covariance=step)
        stamps = np.array([scan.stamp_ns])
        if not self._covered(stamps)[0]:
            return None
        return replace(scan, T_odom_sensor=self.given.at(stamps)[0], point_times=times)

    def _read(self, index: int) -> Scan:
        return self._scans._read(index)


def _duration_ns(scans: ScanSource) -> int:
    """From the stamp of the first scan to its last point; 0 where its points have no times."""
    first = next(iter(scans), None)
    return 0 if first is None or first.point_times is None else round(NS * float(first.point_times.max(initial=0.0)))


def walking_stamps(poses: Floats) -> NDArray[np.int64]:
    """(N,) ns: stamps of poses (N, 4, 4) that follow one another at a walk, at least 0.1 s apart."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    spans = np.maximum(np.rint(steps / _SPEED * NS).astype(np.int64), SCAN_PERIOD_NS)
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(spans)])


def _without_numbers(scans: ScanSource, poses: PoseList) -> PoseList:
    """The poses, without stamps that only count them (0, 1, 2, ... s) where as many scans have others."""
    own, other = poses.stamps_ns, scans.stamps_ns
    if own is None or other is None or len(other) != len(own) or scans.note == NOTE_INDICES:
        return poses
    counts = np.array_equal(own, NS * np.arange(len(own))) and np.abs(other - own).max() > _SAME_NS
    return replace(poses, stamps_ns=None) if counts else poses


def _is_one_each(scans: ScanSource, poses: PoseList) -> bool:
    """Whether there are as many scans as poses, and their stamps do not contradict."""
    if len(scans) != len(poses.poses):
        return False
    if poses.stamps_ns is None or scans.stamps_ns is None or scans.note == NOTE_INDICES:
        return True
    shifted = np.abs(scans.stamps_ns - poses.stamps_ns)
    if shifted.max() <= _SAME_NS:
        return True
    apart = scans.stamps_ns[-1] < poses.stamps_ns[0] or poses.stamps_ns[-1] < scans.stamps_ns[0]
    return bool(apart)  # two clocks: only the order joins them
