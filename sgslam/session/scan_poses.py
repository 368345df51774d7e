"""The poses of a run's scans: the live estimates, and those between the keyframes once these have moved; and how
uncertain the motion between two keyframes is."""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.trajectory import Trajectory
from sgslam.config import OdometrySettings
from sgslam.geometry.frames import inverse, level_at
from sgslam.types import Health, Motion

Floats = NDArray[np.float64]
_DOUBLED = 2.0  # variance relative to that of other odometries' steps, from which on a step is weak


@dataclass
class ScanPose:
    """The live pose of one scan.

    `keyframe` is the index of the last keyframe at or before it. All poses (4, 4) are at its stamp.
    `T_keyframe_sensor` is the motion since that keyframe; `T_previous_sensor`, for a keyframe, the motion since the
    keyframe before it. `health` is what the tracker says of the scan, `covariance` (6, 6) that of its pose against the
    odometry's map, rotation first, in the sensor's axes. `motion` is that during the scan, by seconds after its
    stamp, in the sensor's frame there.
    """

    stamp_ns: int
    T_odom_sensor: Floats
    T_map_sensor: Floats
    keyframe: int
    T_keyframe_sensor: Floats
    T_previous_sensor: Floats | None = None
    health: Health = "good"
    covariance: Floats = field(default_factory=lambda: np.zeros((6, 6)))
    motion: Motion = field(default_factory=lambda: Motion(np.zeros(1), np.eye(4)[None]))


def interpolated(scans: list[ScanPose], keyframe_poses: Floats) -> Floats:
    """(N, 4, 4) T_map_sensor of all scans, given the final keyframe poses (K, 4, 4).

    Each scan keeps its motion since the keyframe before it; the residual at the next keyframe is distributed linearly
    over the scans between the two.
    """
    keyframe_of = np.array([scan.keyframe for scan in scans])
    poses = keyframe_poses[keyframe_of] @ np.stack([scan.T_keyframe_sensor for scan in scans])
    keyframes, first = np.unique(keyframe_of, return_index=True)
    left, share = np.tile(np.eye(4), (len(scans), 1, 1)), np.zeros((len(scans), 1))
    for keyframe, following, start, end in zip(keyframes, keyframes[1:], first, first[1:], strict=False):
        arrived = scans[end].T_previous_sensor
        if following == keyframe + 1 and arrived is not None:  # else another run begins there
            left[start:end] = inverse(keyframe_poses[keyframe] @ arrived) @ keyframe_poses[following]
            share[start:end, 0] = np.arange(end - start) / (end - start)
    turn = Rotation.from_rotvec(share * Rotation.from_matrix(left[:, :3, :3]).as_rotvec()).as_matrix()
    poses[:, :3, 3] += np.einsum("nij,nj->ni", poses[:, :3, :3], share * left[:, :3, 3])
    poses[:, :3, :3] = poses[:, :3, :3] @ turn
    return poses


def at_stamps(scans: list[ScanPose], poses: Floats) -> Trajectory:
    """The trajectory at the scans' stamps, sorted, from the scans' poses (N, 4, 4)."""
    stamps = np.array([scan.stamp_ns for scan in scans], dtype=np.int64)
    order = np.argsort(stamps, kind="stable")
    return Trajectory(stamps[order], poses[order])


def odometry_begins(scans: list[ScanPose]) -> list[int]:
    """The numbers of the scans, in the order of their stamps, at which the odometry begins: its frame is another one
    after the sensor was carried elsewhere."""
    order = sorted(scans, key=lambda scan: scan.stamp_ns)
    return [0] + [
        number
        for number, (before, scan) in enumerate(pairwise(order), 1)
        if scan.keyframe != before.keyframe and scan.T_previous_sensor is None
    ]


def with_unplaced(known: Trajectory, parts: list[tuple[list[ScanPose], Floats]]) -> Trajectory:
    """`known` with the scans of the submaps that could not be relocalised: each begins at the last known place, with
    the last known heading."""
    stamps, poses = [known.stamps_ns], [known.poses]
    for scans, keyframes in parts:
        part = at_stamps(scans, interpolated(scans, keyframes))
        before = max(int(np.searchsorted(known.stamps_ns, part.stamps_ns[0])) - 1, 0)
        stamps.append(part.stamps_ns)
        poses.append(level_at(known.poses[before]) @ inverse(level_at(part.poses[0])) @ part.poses)
    order = np.argsort(np.concatenate(stamps), kind="stable")
    return Trajectory(np.concatenate(stamps)[order], np.concatenate(poses)[order])


@dataclass(frozen=True, eq=False)
class RunPoses:
    """The newest run of a map, which begins at the map's scan number `begin`: its `scans` in the map, and `all_scans`,
    in the order of their stamps, with those of submaps that were not relocalised.

    Trajectories are in the map frame: `in_map` has the `scans`, `with_unplaced` has `all_scans`; `earlier` are those of
    the runs before.
    """

    begin: int
    scans: list[ScanPose]
    all_scans: list[ScanPose]
    in_map: Trajectory
    with_unplaced: Trajectory
    earlier: list[Trajectory]

    @property
    def tracked(self) -> dict[Health, int]:
        """The number of scans of each health."""
        return {health: sum(scan.health == health for scan in self.all_scans) for health in get_args(Health)}


def newest_run(
    scans: list[ScanPose], begins: list[int], keyframes: Floats, unplaced: list[tuple[list[ScanPose], Floats]]
) -> RunPoses:
    """The newest of the runs of a map that begin at its scans number `begins`.

    `keyframes` (K, 4, 4) are the poses of the map's keyframes; `unplaced` has the scans of each submap that was not
    relocalised, and the poses of its keyframes.
    """
    poses = interpolated(scans, keyframes)
    runs = [slice(a, b) for a, b in zip(begins, [*begins[1:], len(scans)], strict=True)]
    *earlier, in_map = [at_stamps(scans[run], poses[run]) for run in runs]
    own = scans[runs[-1]]
    all_scans = sorted([*own, *(s for part, _ in unplaced for s in part)], key=lambda s: s.stamp_ns)
    return RunPoses(runs[-1].start, own, all_scans, in_map, with_unplaced(in_map, unplaced), earlier)


def odometry_of(scans: list[ScanPose]) -> Trajectory:
    """The poses of scans by the odometry alone, in its frame."""
    return at_stamps(scans, np.stack([scan.T_odom_sensor for scan in scans]))


class StepUncertainty:
    """Compares the covariances (6, 6) of the poses of one keyframe after another: rotation first, sensor axes.

    The covariance of a pose against the odometry's map grows while nothing constrains it, along a bare corridor, and
    shrinks where it is found again: the step is as uncertain as the two differ, besides what every step errs.
    """

    def __init__(self, settings: OdometrySettings) -> None:
        self._own = np.repeat([settings.sigma_rotation, settings.sigma_translation], 3)
        self._other = np.repeat([settings.other_sigma_rotation, settings.other_sigma_translation], 3)
        self._last: Floats | None = None
        self._stated: Floats | None = None  # since the last keyframe, where an external odometry states it

    def add(self, step_covariance: Floats, R_sensor_before: Floats) -> None:
        """Adds the covariance (6, 6) of the motion since the scan before, in the sensor's axes, as an external odometry
        states it; (3, 3) turns the axes of the scan before into the sensor's."""
        turn = np.kron(np.eye(2), R_sensor_before)
        before = np.zeros((6, 6)) if self._stated is None else turn @ self._stated @ turn.T
        self._stated = np.asarray(before + step_covariance)

    def leave(self, covariance: Floats, external: bool) -> tuple[Floats, bool]:
        """Goes on to a keyframe: the covariance (6, 6) of the step to it, and whether it is weak.

        `external`: an external odometry gave its pose.
        """
        base = self._other if external else self._own
        before, self._last = self._last, covariance
        stated, self._stated = np.zeros((6, 6)) if self._stated is None else self._stated, None
        if before is None:
            return np.diag(base**2), False
        variances, axes = np.linalg.eigh((covariance - before + stated) / np.outer(self._other, self._other))
        root = self._other[:, None] * axes * np.sqrt(np.abs(variances))
        return np.asarray(np.diag(base**2) + root @ root.T), bool(np.abs(variances).max() > _DOUBLED)
